"""A process for slow tasks, so that the window never waits."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from PySide6.QtCore import QObject, QTimer, Signal

from gui.analysis import worker_tasks
from gui.widgets.background import Background

WORKER_THREAD = "rigctl-worker"
CLOSE_TIMEOUT_S = 10.0
START_MS = 100
"""A process starts this long after the events that waited at its first task, such as the window's
first picture."""
ENDED = "the analysis process ended unexpectedly: try again"


class Worker(QObject):
    """One spawned process, started by the first task; it works through the tasks in order."""

    progressed = Signal(str, float)
    """The stage of the task, and its progress from 0 to 1."""
    finished = Signal(str, object)
    """The name of the task, and its result."""
    failed = Signal(str, str)
    """The name of the task, and the error message."""
    _progress_received = Signal(object, str, float)

    def __init__(self) -> None:
        super().__init__()
        self._background = Background(WORKER_THREAD)
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._pending: list[tuple[str, dict[str, Any]]] = []
        self._progress_received.connect(self._show_progress)

    @property
    def is_busy(self) -> bool:
        """Whether a task is pending."""
        return bool(self._pending)

    def submit(self, task: str, **args: Any) -> None:
        """Run a method of :class:`gui.analysis.worker_tasks.WorkerTasks` in the process."""
        self._pending.append((task, args))
        if self._process is None:
            QTimer.singleShot(0, self, self._start_soon)
        elif len(self._pending) == 1:
            self._begin()

    def cancel(self) -> None:
        """End the process and its task; the next task starts another process.

        Nothing waits for the end: it takes a while on a busy computer, and without end for a
        process that the system keeps, as on a share that hangs.
        """
        self._pending.clear()
        process, self._process, self._pipe = self._process, None, None
        if process is not None:
            process.kill()
            self._background.run(process.join, _ignore, _ignore)

    def close(self) -> None:
        """End the process, and wait for its threads, as before the window closes."""
        self.cancel()
        self._background.close(CLOSE_TIMEOUT_S)

    def _begin(self) -> None:
        assert self._process is not None and self._pipe is not None
        show = partial(self._progress_received.emit, self._process)
        work = partial(_answer, self._pipe, self._pending[0], show)
        done = partial(self._end, self._process)
        self._background.run(work, done, lambda sentence: done(("failed", sentence)))

    def _end(self, process: BaseProcess, answer: tuple[str, Any] | None) -> None:
        """Tell of the end of a task; None is the end of the process."""
        if process is not self._process:  # cancelled meanwhile
            return
        task, _ = self._pending[0]
        if answer is None:
            self.cancel()
            self.failed.emit(task, ENDED)
            return
        self._pending.pop(0)
        if self._pending:
            self._begin()
        kind, result = answer
        (self.finished if kind == "done" else self.failed).emit(task, result)

    def _show_progress(self, process: BaseProcess, stage: str, share: float) -> None:
        if process is self._process:
            self.progressed.emit(stage, share)

    def _start_soon(self) -> None:
        QTimer.singleShot(START_MS, self, self._start)

    def _start(self) -> None:
        if self._process is not None or not self._pending:
            return
        context = multiprocessing.get_context("spawn")
        self._pipe, far_end = context.Pipe()
        self._process = context.Process(target=worker_tasks.serve, args=(far_end,), daemon=True)
        self._process.start()
        far_end.close()
        self._begin()


def _answer(
    pipe: Connection, task: tuple[str, dict[str, Any]], show: Callable[[str, float], object]
) -> tuple[str, Any] | None:
    """Let the process do a task; return ("done", result), ("failed", sentence) or None."""
    try:
        pipe.send(task)
        while (message := pipe.recv())[0] == "progress":
            show(*message[1:])
    except (EOFError, OSError):  # the process has ended
        return None
    kind, result = message
    return kind, result


def _ignore(_: object) -> None:
    pass
