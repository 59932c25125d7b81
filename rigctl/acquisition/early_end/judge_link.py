"""The engine's end of the judging process: it never waits for it."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rigctl.acquisition.early_end.condition_end import ConditionEnd
from rigctl.acquisition.early_end.judge_process import judge_session
from rigctl.acquisition.rpc.commands import read_arguments
from rigctl.errors import WrongUse
from rigctl.protocol.early_end import EarlyEnd

LATE_TRIALS = 10
"""Committed trials that are not judged yet, from which on the log says so."""
END_S = 0.1


class JudgeLink:
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
            target=judge_session, args=(far_end, str(folder), rule), daemon=True
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
        late = self._is_open and committed - self._judged >= LATE_TRIALS
        if late and not self._is_late:
            text = (
                f"early end: {committed - self._judged} trials are not judged yet; the run goes on"
            )
            self._publish("log", text)
        self._is_late = late

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
            self._publish("log", f"early end: {error}")
            return True

    def _receive(self) -> None:
        try:
            while self._is_open and self._pipe.poll():
                message = self._pipe.recv()
                if "judged" in message:
                    self._judged = int(message["judged"])
                else:
                    self._waiting.append(read_arguments("early end", ConditionEnd, message))
        except (EOFError, OSError):
            self._is_open = False
            text = "early end: the process that judges the conditions has ended; no further one "
            self._publish("log", text + "ends early in this run")
