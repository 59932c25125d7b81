"""Conditions that end before their repeats, where the protocol allows it.

A process of its own judges what is recorded: it reads the growing session and never touches the
rig, and the engine never waits for it. It sends the number of committed trials that it has taken
in whenever that grows, and a :class:`ConditionEnd` for a condition that may end.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import inf, sqrt
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.encoder.encoder import encode_trials
from rigctl.errors import SessionError, WrongUse
from rigctl.protocol.plan import Condition, EarlyEnd, Plan, condition_of
from rigctl.session.part import existing_parts
from rigctl.session.session import ConditionEnd, Session, rows_by_condition
from rigctl.values import SAMPLE_RATE_HZ

LATE_TRIALS = 10
"""Committed trials that are not judged yet, from which on the log says so."""
END_S = 0.1
LOOK_S = 0.2
ENGINE_FIRST = 10
"""By how much the process is nicer than the engine."""
PRIOR_TRIALS = 1.0
"""Weight of the mixture over means, in trials: any positive one is valid, this one suits few."""

RatesHz = dict[tuple[int, int], float]
"""By trial and attempt: rows of /trials move where a part cannot be read for a while."""


def checked_rule(
    end: ConditionEnd, plan: Plan, committed_attempt: Callable[[int], int]
) -> EarlyEnd:
    """Return the protocol's rule. Raises WrongUse where it does not allow this end.

    ``committed_attempt`` returns the attempt at a trial that counts, 0 for none.
    """
    rule = plan.protocol.early_end
    if rule is None:
        raise WrongUse("this protocol has no [early_end]: every trial of it is recorded")
    if end.trials < rule.least_trials or end.half_width_hz > rule.half_width_hz:
        raise WrongUse(
            f"the condition may end from {rule.least_trials} trials and "
            f"± {rule.half_width_hz:g} Hz on: {end.trials} trials and "
            f"± {end.half_width_hz:g} Hz are not enough"
        )
    own = (t.trial_id for t in plan.trials if condition_of(t) == end.condition)
    counted = sum(committed_attempt(trial_id) > 0 for trial_id in own)
    if counted < end.trials:
        raise WrongUse(f"{counted} trials of the condition count, not {end.trials}")
    return rule


class EarlyEndProcess:
    """Starts the process for one run, and hands on what it has decided.

    ``publish`` takes a kind of event and a sentence.
    """

    def __init__(self, folder: Path, rule: EarlyEnd, publish: Callable[[str, str], Any]) -> None:
        self._publish = publish
        self._judged = 0
        self._is_late = False
        self._waiting: list[ConditionEnd] = []
        context = multiprocessing.get_context("spawn")
        self._pipe, far_end = context.Pipe()
        self.process = context.Process(
            target=judge_session, args=(far_end, folder, rule), daemon=True
        )
        self.process.start()
        far_end.close()
        self._is_open = True

    def poll(self, committed: int, end_condition: Callable[[ConditionEnd], bool]) -> None:
        """Hand on decisions; those that are not taken now are kept.

        ``committed``: trials of the session that count. The log says where the process has ended or
        is late.
        """
        self._receive()
        self._waiting = [end for end in self._waiting if not self._is_taken(end, end_condition)]
        behind = committed - self._judged
        is_late = self._is_open and behind >= LATE_TRIALS
        if is_late and not self._is_late:
            self._log(f"{behind} trials are not judged yet; the run goes on")
        self._is_late = is_late

    @property
    def has_decided(self) -> bool:
        """Whether a decision waits for the run to record again."""
        return bool(self._waiting)

    def close(self) -> None:
        """End the process."""
        self._is_open = False
        self._pipe.close()
        if self.process.is_alive():
            self.process.kill()
        self.process.join(END_S)

    def _is_taken(self, end: ConditionEnd, end_condition: Callable[[ConditionEnd], bool]) -> bool:
        try:
            return end_condition(end)
        except WrongUse as error:
            self._log(str(error))
            return True

    def _receive(self) -> None:
        try:
            while self._is_open and self._pipe.poll():
                message = self._pipe.recv()
                if isinstance(message, ConditionEnd):
                    self._waiting.append(message)
                else:
                    self._judged = message
        except (EOFError, OSError):
            self._is_open = False
            self._log(
                "the process that judges the conditions has ended; no further one ends early in "
                "this run"
            )

    def _log(self, sentence: str) -> None:
        self._publish("log", f"early end: {sentence}")


def judge_session(pipe: Connection, folder: Path, rule: EarlyEnd) -> None:
    """Judge the session until the engine closes its end of the pipe."""
    if sys.platform != "win32":
        os.nice(ENGINE_FIRST)
    with suppress(EOFError, OSError, KeyboardInterrupt):
        judge_folder(pipe, folder, rule)


def judge_folder(pipe: Connection, folder: Path, rule: EarlyEnd) -> None:
    """Judge a session until the pipe closes; one that cannot be read now is opened again."""
    session, rates_hz, ended = None, RatesHz(), set[Condition]()
    try:
        while not pipe.poll(LOOK_S):
            before, found = len(rates_hz), []
            try:
                if session is None and existing_parts(folder):
                    session = Session.open(folder)
                if session is not None:
                    session.refresh()
                    found = known_conditions(session, rule, rates_hz)
            except (SessionError, OSError):
                if session is not None:
                    session.close()
                session = None
            for end in found:
                if end.condition not in ended:
                    pipe.send(end)
                    ended.add(end.condition)
            if len(rates_hz) != before:
                pipe.send(len(rates_hz))
    finally:
        if session is not None:
            session.close()


def known_conditions(session: Session, rule: EarlyEnd, rates_hz: RatesHz) -> list[ConditionEnd]:
    """Return the conditions whose mean is known well enough; adds new trials to ``rates_hz``."""
    found = []
    for condition, rows in rows_by_condition(session, session.committed().tolist()).items():
        rates = []
        for row in rows:
            attempt = int(session.trials["trial_id"][row]), int(session.trials["attempt"][row])
            if attempt not in rates_hz:
                rates_hz[attempt] = mean_rate_hz(session, row, rule.of)
            rates.append(rates_hz[attempt])
        width_hz = half_width(rates, rule.confidence_percent)
        if len(rates) >= rule.least_trials and width_hz <= rule.half_width_hz:
            found.append(ConditionEnd(*condition, len(rates), float(np.mean(rates)), width_hz))
    return found


def mean_rate_hz(session: Session, row: int, of: str) -> float:
    """Return the spikes of all SA or RA neurons in a trial, a neuron and second."""
    ranges, samples = session.header.calibrated_ranges, session.readings(row)
    assert ranges is not None  # no run with an early end begins without
    (spikes,) = encode_trials([samples], ranges, session.header.encoder_parameters)
    n = spikes.n_trains // 2
    first = 0 if of == "sa_rate" else n
    count = int(spikes.row_start[first + n] - spikes.row_start[first])
    return count / n / (len(samples) / SAMPLE_RATE_HZ)


def half_width(values: Sequence[float], confidence_percent: float) -> float:
    """Return half the width of the interval around the mean of ``values``; infinite if unknown.

    It holds at every number of values, so that one may look after each and stop at any: Student's
    interval would be right less often. Too few values are unknown, and equal ones: silent neurons
    have no spread to judge by. For independent values of one normal distribution, whatever its mean
    and variance: with the given probability the intervals after 2, 3, 4, … values all hold the
    mean. It is the set of means m that the scale-invariant likelihood ratio of values − m, mixed
    over normal means with the variance σ² / PRIOR_TRIALS, does not refuse by Ville's inequality
    (a confidence sequence, Lai 1976).
    """
    n = len(values)
    if n < 2:
        return inf
    share = 1 - confidence_percent / 100
    k = ((n + PRIOR_TRIALS) / PRIOR_TRIALS / share**2) ** (1 / n)
    room = 1 - k * PRIOR_TRIALS / (n + PRIOR_TRIALS)
    variance = float(np.var(values, ddof=1))
    if room <= 0 or variance == 0:
        return inf
    return sqrt((k - 1) * (n - 1) * variance / (n * room))
