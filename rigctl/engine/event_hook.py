"""The command of ``[run] on_event``: run with the kind and the text of what somebody must know.

Each process has a thread of its own, so that none can hold up the loop, and a limited time.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence

from rigctl.engine.copy_process import COPY
from rigctl.engine.rpc.messages import OPERATOR, UNRECORDED
from rigctl.values import Event

LIMIT_S = 10.0
"""A process that has not ended by then is killed."""
MAX_PROCESSES = 8
"""At a time: an event that comes on top of them is not told."""
TEXT_LETTERS = 500


class EventHook:
    """Runs ``command`` for events, without one nothing; subscribe it to the event bus.

    ``tell`` gets a sentence, from any thread, where that fails: once until it works again.
    """

    def __init__(
        self, command: Sequence[str], tell: Callable[[str], None], limit_s: float = LIMIT_S
    ) -> None:
        self._command = command
        self._tell = tell
        self._limit_s = limit_s
        self._threads: list[threading.Thread] = []
        self._problem = ""

    def __call__(self, event: Event) -> None:
        """Run the command for an event that somebody must know of."""
        kind = hook_kind(event)
        if not self._command or not kind:
            return
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        if len(self._threads) == MAX_PROCESSES:
            self._report(f"has not ended {MAX_PROCESSES} times: the next events are not told")
            return
        command = (*self._command, kind, event.text[:TEXT_LETTERS].replace("\0", ""))
        thread = threading.Thread(target=self._run, args=(command,), name="on_event", daemon=True)
        try:
            thread.start()
        except RuntimeError as error:  # the system has no more threads
            self._report(f"cannot be started ({error})")
        else:
            self._threads.append(thread)

    def close(self) -> None:
        """Wait until each process has ended, for the limited time at most."""
        for thread in self._threads:
            thread.join()

    def _run(self, command: Sequence[str]) -> None:
        null = subprocess.DEVNULL
        try:
            process = subprocess.Popen(
                command, stdin=null, stdout=null, stderr=null, start_new_session=True
            )
        except (OSError, ValueError) as error:  # ValueError: a text that is no argument
            self._report(f"cannot be started ({error})")
            return
        try:
            code = process.wait(self._limit_s)
        except subprocess.TimeoutExpired:
            _kill(process)
            self._report(f"did not end within {self._limit_s:g} s and was killed")
            return
        self._report(f"ended with exit code {code}" if code else "")

    def _report(self, problem: str) -> None:
        """Tell of a problem unless it is the last one; an empty one is none."""
        if problem and problem != self._problem:
            self._tell(
                f"on_event: {self._command[0]} {problem}; the run goes on, and nobody is told: "
                "try the command of rig.toml in a terminal"
            )
        self._problem = problem


def hook_kind(event: Event) -> str:
    """Return the first word that the command gets for an event, empty for one that is not told.

    A pause that a person asked for is not told. Only a latched fault of the drum is a fault here:
    one that ends a run is told with its end.
    """
    match event.kind:
        case "run":
            return str(event.data.get("state", ""))
        case "pause" if event.data["reason"] != OPERATOR:
            return "paused"
        case "prompt":
            return "plate" if event.data["texture"] else "question"
        case "fault" if "fault" in event.data:
            return "fault"
        case kind if kind in (UNRECORDED, COPY):
            return kind
    return ""


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process, and on Unix all that it has started."""
    if sys.platform == "win32":
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
