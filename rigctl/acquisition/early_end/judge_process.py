"""The process that judges conditions: it reads the growing session and never touches the rig.

It sends ``{"judged": n}`` whenever it has taken in n committed trials, and the fields of
:class:`~rigctl.acquisition.early_end.condition_end.ConditionEnd` for a condition that may end.
"""

from __future__ import annotations

import os
import sys
from collections import defaultdict
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.analysis.learning.mean_interval import half_width
from rigctl.encoding.encoder import encode_trials
from rigctl.errors import SessionError
from rigctl.protocol.early_end import Condition, EarlyEnd
from rigctl.session.part import existing_parts
from rigctl.session.session import Session
from rigctl.values import SAMPLE_RATE_HZ

LOOK_S = 0.2
ENGINE_FIRST = 10
"""By how much the process is nicer than the engine."""
FIELDS = ("texture", "speed_mm_s", "force_g", "depth_mm")


def judge_session(pipe: Connection, folder: str, rule: EarlyEnd) -> None:
    """Judge the session until the engine closes its end of the pipe."""
    if sys.platform != "win32":
        os.nice(ENGINE_FIRST)
    with suppress(EOFError, OSError, KeyboardInterrupt):
        judge_folder(pipe, Path(folder), rule)


def judge_folder(pipe: Connection, folder: Path, rule: EarlyEnd) -> None:
    """Judge a session until the pipe closes; one that cannot be read now is opened again."""
    judge, session = Judge(rule), None
    try:
        while not pipe.poll(LOOK_S):
            found: list[dict[str, Any]] = []
            try:
                if session is None and existing_parts(folder):
                    session = Session.open(folder)
                if session is not None:
                    found = _look(session, judge)
            except (SessionError, OSError):
                if session is not None:
                    session.close()
                session = None
            for message in found:
                pipe.send(message)
    finally:
        if session is not None:
            session.close()


def _look(session: Session, judge: Judge) -> list[dict[str, Any]]:
    """Take in what is new; return the messages about it."""
    session.refresh()
    before = len(judge.rates_hz)
    found = judge.take(session)
    n_judged = len(judge.rates_hz)
    return [*found, {"judged": n_judged}] if n_judged != before else found


class Judge:
    """Keeps the rate of each committed trial, and finds conditions that are known well enough."""

    def __init__(self, rule: EarlyEnd) -> None:
        self.rates_hz: dict[tuple[int, int], float] = {}
        """By trial and attempt: rows of /trials move where a part cannot be read for a while."""
        self._rule = rule
        self._ended: set[Condition] = set()

    def take(self, session: Session) -> list[dict[str, Any]]:
        """Take in what is new in a session; return the conditions that may end now."""
        committed = session.committed().tolist()
        rates: defaultdict[Condition, list[float]] = defaultdict(list)
        for row in committed:
            trial = session.trials[row]
            attempt = int(trial["trial_id"]), int(trial["attempt"])
            if attempt not in self.rates_hz:
                self.rates_hz[attempt] = mean_rate_hz(session, row, self._rule.of)
            speed, force, depth = (float(trial[name]) for name in FIELDS[1:])
            rates[str(trial["texture"]), speed, force, depth].append(self.rates_hz[attempt])
        return [end for key, found in rates.items() if (end := self._judge(key, found)) is not None]

    def _judge(self, condition: Condition, rates: list[float]) -> dict[str, Any] | None:
        if condition in self._ended or len(rates) < self._rule.least_trials:
            return None
        width_hz = half_width(rates, self._rule.confidence_percent)
        if width_hz > self._rule.half_width_hz:
            return None
        self._ended.add(condition)
        found = {"trials": len(rates), "mean_hz": float(np.mean(rates)), "half_width_hz": width_hz}
        return {**dict(zip(FIELDS, condition, strict=True)), **found}


def mean_rate_hz(session: Session, row: int, of: str) -> float:
    """Return the spikes of all SA or RA neurons in a trial, a neuron and second."""
    ranges, samples = session.header.calibrated_ranges, session.readings(row)
    assert ranges is not None  # no run with an early end begins without
    (spikes,) = encode_trials([samples], ranges, session.header.encoder_parameters)
    n = spikes.n_trains // 2
    first = 0 if of == "sa_rate" else n
    count = int(spikes.row_start[first + n] - spikes.row_start[first])
    return count / n / (len(samples) / SAMPLE_RATE_HZ)
