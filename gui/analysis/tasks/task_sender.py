"""Sends tasks to a worker process: a long one waits in a thread until the process reads it."""

from __future__ import annotations

import threading
from collections import deque
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any

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
