"""A process for slow tasks, so that the window never waits."""

from __future__ import annotations

import multiprocessing
import threading
from collections import deque
from multiprocessing.connection import Connection
from multiprocessing.connection import Connection as Pipe
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from queue import SimpleQueue
from typing import Any, NamedTuple

from PySide6.QtCore import QObject, Signal

from gui.analysis import worker_tasks

JOIN_TIMEOUT_S = 1.0


class TaskSender:
    """Sends through a pipe in the order of :meth:`put`, in a thread that ends with the last one.

    A pipe takes some 100 kB that nobody has read, and a picture has more: whoever sends it to a
    process that works waits for the end of that work.
    """

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._waiting: deque[memoryview] = deque()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def put(self, task: Any) -> None:
        """Send a task as soon as the process reads it."""
        content = ForkingPickler.dumps(task)
        with self._lock:
            self._waiting.append(content)
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._send, name="rigctl-worker-tasks", daemon=True
                )
                self._thread.start()

    def join(self) -> None:
        """Wait for the thread; the process has ended, so that nothing keeps it."""
        with self._lock:
            self._waiting.clear()
            thread = self._thread
        if thread is not None:
            thread.join(JOIN_TIMEOUT_S)

    def _send(self) -> None:
        while (content := self._next()) is not None:
            try:
                self._pipe.send_bytes(content)
            except (OSError, ValueError):  # the process has ended: its side of the pipe tells so
                with self._lock:
                    self._waiting.clear()

    def _next(self) -> memoryview | None:
        """Return what is to be sent, None for nothing: then the thread ends."""
        with self._lock:
            if self._waiting:
                return self._waiting.popleft()
            self._thread = None
            return None


QUICK_S = 0.002
"""Most that the window waits for a result: for the short ones, which are all but few."""


class _KilledProcess(NamedTuple):
    """A process that is about to end, with what leads to it."""

    process: BaseProcess
    pipe: Pipe
    sender: TaskSender
    receiver: threading.Thread | None

    def close(self) -> bool:
        """Close all of it once the process has ended; return whether it has."""
        if self.process.exitcode is None:
            return False
        self.sender.join()
        if self.receiver is not None:
            self.receiver.join(JOIN_TIMEOUT_S)
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
        self._receiver: threading.Thread | None = None
        self._received: SimpleQueue[Any] = SimpleQueue()
        self._pending: list[str] = []
        self._killed: list[_KilledProcess] = []

    @property
    def is_busy(self) -> bool:
        """Whether a task is pending."""
        return bool(self._pending)

    def submit(self, task: str, **args: Any) -> None:
        """Run a method of :class:`gui.analysis.worker_tasks.WorkerTasks` in the process."""
        if self._pipe is None:
            self._start()
        assert self._sender is not None
        self._pending.append(task)
        self._sender.put((task, args))

    def poll(self) -> None:
        """Emit the signals for everything that the process sent since the last call."""
        self._close_killed()
        if self._pipe is not None and self._pending:
            self._receive(self._pipe)
        while self._pending and not self._received.empty():
            message = self._received.get()
            if message is None:
                task = self._pending[0]
                self.cancel()
                self.failed.emit(task, "the analysis process ended unexpectedly: try again")
            elif message[0] == "progress":
                self.progressed.emit(*message[1:])
            else:
                task = self._pending.pop(0)
                (self.finished if message[0] == "done" else self.failed).emit(task, *message[1:])

    def cancel(self) -> None:
        """End the process and its task; the next task starts another process.

        Nothing waits for the end: it takes a while on a busy computer, and without end for a
        process that the system keeps, as on a share that hangs.
        """
        self._pending.clear()
        process, self._process = self._process, None
        pipe, self._pipe = self._pipe, None
        sender, self._sender = self._sender, None
        receiver, self._receiver = self._receiver, None
        self._received = SimpleQueue()
        if process is not None and pipe is not None and sender is not None:
            process.kill()
            self._killed.append(_KilledProcess(process, pipe, sender, receiver))
        self._close_killed()

    def _receive(self, pipe: Pipe) -> None:
        """Read what has arrived in a thread, as a result may be the rows of a long session."""
        if self._receiver is None and _has_arrived(pipe):
            self._receiver = threading.Thread(
                target=_read_all,
                args=(pipe, self._received),
                name="rigctl-worker-results",
                daemon=True,
            )
            self._receiver.start()
        if self._receiver is not None:
            self._receiver.join(QUICK_S)
            if not self._receiver.is_alive():
                self._receiver = None

    def _close_killed(self) -> None:
        self._killed = [killed for killed in self._killed if not killed.close()]

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, far_end = context.Pipe()
        self._process = context.Process(target=worker_tasks.serve, args=(far_end,), daemon=True)
        self._process.start()
        far_end.close()
        self._sender = TaskSender(self._pipe)


def _has_arrived(pipe: Pipe) -> bool:
    try:
        return pipe.poll()
    except OSError:  # its process has ended, which reading tells
        return True


def _read_all(pipe: Pipe, received: SimpleQueue[Any]) -> None:
    """Read the messages that have arrived; None for the end of the process."""
    try:
        while pipe.poll():
            received.put(pipe.recv())
    except (EOFError, OSError):
        received.put(None)
