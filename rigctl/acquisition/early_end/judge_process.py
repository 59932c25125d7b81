"""The process that judges conditions: it reads the growing session and never touches the rig.

It sends ``{"judged": n}`` whenever it has taken in n committed trials, and the fields of
:class:`~rigctl.acquisition.early_end.condition_end.ConditionEnd` for a condition that may end.
"""

from __future__ import annotations

import os
import sys
from collections import defaultdict
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.analysis.learning.mean_interval import half_width
from rigctl.encoding.encoder import encode_trials
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, PRESETS
from rigctl.errors import SessionError
from rigctl.protocol.early_end import Condition, EarlyEnd
from rigctl.session.read.part_file import existing_parts
from rigctl.session.read.session import Session
from rigctl.values import SAMPLE_RATE_HZ

LOOK_S = 0.2
ENGINE_FIRST = 10
"""By how much the process is nicer than the engine."""
FIELDS = ("texture", "speed_mm_s", "force_g", "depth_mm")


def judge_session(pipe: Connection, folder: str, rule: EarlyEnd) -> None:
    """Judge the session until the engine closes its end of the pipe."""
    if sys.platform != "win32":
        os.nice(ENGINE_FIRST)
    judge = Judge(rule)
    path = Path(folder)
    session: Session | None = None
    try:
        while not pipe.poll(LOOK_S):
            if session is None and existing_parts(path):
                session = Session.open(path)
            if session is not None:
                _look(session, judge, pipe)
    except (EOFError, OSError, KeyboardInterrupt, SessionError):
        return
    finally:
        if session is not None:
            session.close()


def _look(session: Session, judge: Judge, pipe: Connection) -> None:
    session.refresh()
    before = len(judge.rates_hz)
    for ended in judge.take(session):
        pipe.send(ended)
    if len(judge.rates_hz) != before:
        pipe.send({"judged": len(judge.rates_hz)})


class Judge:
    """Keeps the rate of each committed trial, and finds conditions that are known well enough."""

    def __init__(self, rule: EarlyEnd) -> None:
        self.rates_hz: dict[int, float] = {}
        """By row of /trials."""
        self._rule = rule
        self._ended: set[Condition] = set()

    def take(self, session: Session) -> list[dict[str, Any]]:
        """Take in what is new in a session; return the conditions that may end now."""
        committed = session.committed().tolist()
        for row in committed:
            if row not in self.rates_hz:
                self.rates_hz[row] = mean_rate_hz(session, row, self._rule.of)
        rows: defaultdict[Condition, list[int]] = defaultdict(list)
        for row in committed:
            trial = session.trials[row]
            speed, force, depth = (float(trial[name]) for name in FIELDS[1:])
            rows[str(trial["texture"]), speed, force, depth].append(row)
        return [end for key, found in rows.items() if (end := self._judge(key, found)) is not None]

    def _judge(self, condition: Condition, rows: list[int]) -> dict[str, Any] | None:
        rates = [self.rates_hz[row] for row in rows]
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
    header = session.header
    low, high = (np.array(side, np.uint16) for side in (header.taxel_low, header.taxel_high))
    samples = np.ascontiguousarray(session.samples(row))
    parameters = PRESETS.get(header.encoder_preset, DEFAULT)
    (spikes,) = encode_trials([samples], Normalisation(low, high), parameters)
    n = spikes.n_trains // 2
    first = 0 if of == "sa_rate" else n
    count = int(spikes.row_start[first + n] - spikes.row_start[first])
    return count / n / (len(samples) / SAMPLE_RATE_HZ)
