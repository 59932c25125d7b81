"""Find the calls that make the Qt thread wait while the window should answer.

A sampler looks at the Qt thread every few milliseconds. Time counts as a wait only if the thread
waits for a file, a socket, a lock or a process at two samples and did not run between them. Time
without a processor does not count, so that a busy machine finds the same as an idle one: neither
the Qt thread's, nor that of another thread of this process, which the Qt thread may wait for, as
one does that starts a thread or wants the interpreter.

The sampler keeps no frame of the Qt thread: whoever drops the last reference to a frame destroys
its widgets and events, and Qt ends the process if another thread does that.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from types import FrameType, TracebackType
from typing import NamedTuple, Self

from PySide6.QtCore import QEventLoop, QTimer

from tests.gui.watchdog.thread_time import ThreadState, others_without_processor_ns

LIMIT_MS = 50.0
_SAMPLE_S = 0.004
_CHECK_MS = 10
_DEEPEST = 8
_DRAWING = ("paint", "draw", "refresh", "set_theme", "polish", "resize")


class Call(NamedTuple):
    """What the Qt thread is doing: which call of our code it handles, and the innermost calls."""

    handler: tuple[int, int] | None
    """The address of the frame that Qt has called, and how often the event loop had turned."""
    chain: str


@dataclass
class HandledEvent:
    """One call of our code by Qt: how long it waited and worked, and in which calls."""

    handler: tuple[int, int]
    first: ThreadState
    delayed_ns: int
    """How long other threads had been without a processor before it began."""
    slept_ms: float = 0.0
    worked_ms: float = 0.0
    waits: Counter[str] = field(default_factory=Counter)
    work: Counter[str] = field(default_factory=Counter)

    def __str__(self) -> str:
        return (
            f"waited {self.slept_ms:.0f} ms in {_most(self.waits)}; "
            f"worked {self.worked_ms:.0f} ms in {_most(self.work)}"
        )

    @property
    def draws(self) -> bool:
        """Whether its work was painting."""
        return any(word in _most(self.work) for word in _DRAWING)


class QtThreadWatchdog:
    """A context in which the calls of our code by Qt are watched. Made in the Qt thread."""

    def __init__(self) -> None:
        self.blocked: list[HandledEvent] = []
        """Calls that waited longer than the limit."""
        self.busy: list[HandledEvent] = []
        """Calls that worked longer than the limit, and not to draw."""
        self.samples = 0
        self._turns = 0
        self._native_id, self._ident = threading.get_native_id(), threading.get_ident()
        self._ended = threading.Event()
        self._sampler = threading.Thread(target=self._sample, name="qt-thread-watchdog")

    def __enter__(self) -> Self:
        self._sampler.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._sampler.join()

    def run_until(self, done: Callable[[], bool], timeout_s: float = 120.0) -> None:
        """Run the event loop until a condition is true, as the window's own loop runs."""
        loop, timer, left = QEventLoop(), QTimer(), [round(1000 * timeout_s / _CHECK_MS)]

        def check() -> None:
            self._turns += 1
            left[0] -= 1
            if done() or left[0] <= 0:
                loop.quit()

        timer.timeout.connect(check)
        timer.start(_CHECK_MS)
        loop.exec()
        timer.stop()
        assert left[0] > 0, f"the condition is not true after {timeout_s} s"

    def run(self, action: Callable[[], object]) -> None:
        """Let Qt call an action, and wait until it has returned."""
        finished: list[bool] = []

        def act() -> None:
            try:
                action()
            finally:
                finished.append(True)

        QTimer.singleShot(0, act)
        self.run_until(lambda: bool(finished))

    def _sample(self) -> None:
        """Look at the Qt thread again and again; a handled event ends where another begins."""
        event: HandledEvent | None = None
        before, before_s = ThreadState.of(self._native_id), time.monotonic()
        while not self._ended.wait(_SAMPLE_S):
            call = self._look()
            now, now_s = ThreadState.of(self._native_id), time.monotonic()
            if event is not None and call.handler != event.handler:
                self._judge(event)
                event = None
            if call.handler is not None and event is None:
                event = HandledEvent(call.handler, now, self._delayed_ns())
            elif event is not None:
                event.worked_ms = (now.worked_ns - event.first.worked_ns) / 1e6
                if now.slept_since(before):
                    event.slept_ms += 1000 * (now_s - before_s)
                    event.waits[call.chain] += 1
                else:
                    event.work[call.chain] += 1
            before, before_s = now, now_s
            self.samples += 1
        if event is not None:
            self._judge(event)

    def _look(self) -> Call:
        """Return what the Qt thread is doing.

        The interpreter runs this function without a break, as it has just begun the sampler's
        turn, so that the frames have not ended when their references are dropped.
        """
        turns = self._turns
        innermost = sys._current_frames()[self._ident]
        handler = _handler_address(innermost)
        return Call(None if handler is None else (handler, turns), _chain(innermost))

    def _delayed_ns(self) -> int:
        return others_without_processor_ns(self._native_id, threading.get_native_id())

    def _judge(self, event: HandledEvent) -> None:
        if event.slept_ms > LIMIT_MS:
            event.slept_ms -= max(0, self._delayed_ns() - event.delayed_ns) / 1e6
        if event.slept_ms > LIMIT_MS:
            self.blocked.append(event)
        if event.worked_ms > LIMIT_MS and not event.draws:
            self.busy.append(event)


def _handler_address(frame: FrameType | None) -> int | None:
    """Return the address of the frame that :meth:`QtThreadWatchdog.run_until` has called, if any.

    A later call may have the same address. The loop turns at least every few milliseconds between
    two calls, so that at most that much of another call is counted with the first.
    """
    inner: FrameType | None = None
    while frame is not None:
        if frame.f_code is QtThreadWatchdog.run_until.__code__:
            return None if inner is None or inner.f_code.co_name == "check" else id(inner)
        inner, frame = frame, frame.f_back
    return None


def _most(calls: Counter[str]) -> str:
    return max(calls, key=lambda chain: calls[chain], default="no call")


def _chain(frame: FrameType | None) -> str:
    """Return the innermost calls, outermost first, without those of the watchdog."""
    calls: list[str] = []
    while frame is not None and frame.f_globals.get("__name__") != __name__:
        name = frame.f_globals.get("__name__", "?")
        calls.append(f"{name}.{frame.f_code.co_name}:{frame.f_lineno}")
        frame = frame.f_back
    return " > ".join(reversed(calls[:_DEEPEST]))
