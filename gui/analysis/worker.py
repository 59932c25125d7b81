"""A process for what takes long, so that the window never waits: reading, encoding, classifying."""

from __future__ import annotations

import multiprocessing
from multiprocessing.connection import Connection as Pipe
from multiprocessing.process import BaseProcess
from typing import Any

from PySide6.QtCore import QObject, Signal

from gui.analysis import worker_tasks

_END_LIMIT_S = 5.0


class Worker(QObject):
    """One spawned process, started at the first request; answers come through :meth:`poll`."""

    progressed = Signal(str, float)
    done = Signal(str, object)
    failed = Signal(str, str)

    def __init__(self) -> None:
        super().__init__()
        self._process: BaseProcess | None = None
        self._pipe: Pipe | None = None
        self._waiting: list[str] = []

    @property
    def is_busy(self) -> bool:
        """Whether an answer is still to come."""
        return bool(self._waiting)

    def ask(self, task: str, **args: Any) -> None:
        """Have a function of :mod:`gui.analysis.worker_tasks` called in the process."""
        if self._pipe is None:
            self._start()
        assert self._pipe is not None
        self._waiting.append(task)
        self._pipe.send((task, args))

    def poll(self) -> None:
        """Hand on what the process said since the last call."""
        while self._pipe is not None and self._waiting:
            try:
                if not self._pipe.poll():
                    return
                kind, *rest = self._pipe.recv()
            except (EOFError, OSError):
                self._lose()
                return
            self._take(kind, rest)

    def cancel(self) -> None:
        """End the process and whatever it does; the next request starts another."""
        self._waiting.clear()
        process, self._process = self._process, None
        pipe, self._pipe = self._pipe, None
        if pipe is not None:
            pipe.close()
        if process is not None:
            process.terminate()
            process.join(_END_LIMIT_S)
            process.close()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, far_end = context.Pipe()
        self._process = context.Process(target=worker_tasks.serve, args=(far_end,), daemon=True)
        self._process.start()
        far_end.close()

    def _take(self, kind: str, rest: list[Any]) -> None:
        if kind == "progress":
            self.progressed.emit(*rest)
            return
        task = self._waiting.pop(0)
        if kind == "done":
            self.done.emit(task, rest[0])
        else:
            self.failed.emit(task, rest[0])

    def _lose(self) -> None:
        task = self._waiting[0]
        self.cancel()
        self.failed.emit(task, "the analysis process ended unexpectedly: try again")
