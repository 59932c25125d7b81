"""A process for slow tasks, so that the window never waits."""

from __future__ import annotations

import multiprocessing
from multiprocessing.connection import Connection as Pipe
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple

from PySide6.QtCore import QObject, Signal

from gui.analysis.tasks import worker_tasks
from gui.analysis.tasks.task_sender import TaskSender


class _KilledProcess(NamedTuple):
    """A process that is about to end, with what leads to it."""

    process: BaseProcess
    pipe: Pipe
    sender: TaskSender

    def close(self) -> bool:
        """Close all of it once the process has ended; return whether it has."""
        if self.process.exitcode is None:
            return False
        self.sender.join()
        self.pipe.close()
        self.process.close()
        return True


class Worker(QObject):
    """One spawned process, started by the first task; :meth:`poll` emits all signals."""

    progressed = Signal(str, float)
    """The stage of the task, and its progress from 0 to 1."""
    finished = Signal(str, object)
    """The name of the task, and its result."""
    failed = Signal(str, str)
    """The name of the task, and the error message."""

    def __init__(self) -> None:
        super().__init__()
        self._process: BaseProcess | None = None
        self._pipe: Pipe | None = None
        self._sender: TaskSender | None = None
        self._pending: list[str] = []
        self._killed: list[_KilledProcess] = []

    @property
    def is_busy(self) -> bool:
        """Whether a task is pending."""
        return bool(self._pending)

    def submit(self, task: str, **args: Any) -> None:
        """Run a method of :class:`gui.analysis.tasks.worker_tasks.WorkerTasks` in the process."""
        if self._pipe is None:
            self._start()
        assert self._sender is not None
        self._pending.append(task)
        self._sender.put((task, args))

    def poll(self) -> None:
        """Emit the signals for everything that the process sent since the last call."""
        self._close_killed()
        while self._pipe is not None and self._pending:
            try:
                if not self._pipe.poll():
                    return
                kind, *values = self._pipe.recv()
            except (EOFError, OSError):
                task = self._pending[0]
                self.cancel()
                self.failed.emit(task, "the analysis process ended unexpectedly: try again")
                return
            if kind == "progress":
                self.progressed.emit(*values)
            else:
                task = self._pending.pop(0)
                (self.finished if kind == "done" else self.failed).emit(task, *values)

    def cancel(self) -> None:
        """End the process and its task; the next task starts another process.

        Nothing waits for the end: it takes a while on a busy computer, and without end for a
        process that the system keeps, as on a share that hangs.
        """
        self._pending.clear()
        process, self._process = self._process, None
        pipe, self._pipe = self._pipe, None
        sender, self._sender = self._sender, None
        if process is not None and pipe is not None and sender is not None:
            process.kill()
            self._killed.append(_KilledProcess(process, pipe, sender))
        self._close_killed()

    def _close_killed(self) -> None:
        self._killed = [killed for killed in self._killed if not killed.close()]

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, far_end = context.Pipe()
        self._process = context.Process(target=worker_tasks.serve, args=(far_end,), daemon=True)
        self._process.start()
        far_end.close()
        self._sender = TaskSender(self._pipe)
