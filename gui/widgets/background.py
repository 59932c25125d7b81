"""Work beside the window's thread: what comes of it arrives in the window's thread."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from threading import Thread, current_thread
from typing import Any, ClassVar, NamedTuple, TypeVar

from PySide6.QtCore import QObject, Qt, Signal

from rigctl.errors import RigctlError

UNEXPECTED = "an error that nobody expected: Help → Crash reports says more"
_CLOSE_TIMEOUT_S = 30.0
_Result = TypeVar("_Result")


class _Task(NamedTuple):
    background: Background
    work: Callable[[], object]
    done: Callable[[Any], object]
    failed: Callable[[str], object]


class Background(QObject):
    """Runs functions in threads of their own, as many as are asked for.

    A thread keeps nothing of the window alive: a function with what it holds, such as a picture
    that is half painted, ends in the window's thread, where Qt wants it.
    """

    _ended = Signal(object, bool, object)
    """The thread, whether its function returned, and its result or a sentence."""
    _tasks: ClassVar[dict[Thread, _Task]] = {}

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name
        self._ended.connect(self._tell, Qt.ConnectionType.QueuedConnection)

    def run(
        self,
        work: Callable[[], _Result],
        done: Callable[[_Result], object],
        failed: Callable[[str], object],
    ) -> None:
        """Start ``work``; then call ``done`` with its result, or ``failed`` with a sentence."""
        thread = Thread(target=self._run, args=(work,), name=self._name, daemon=True)
        self._tasks[thread] = _Task(self, work, done, failed)
        thread.start()

    def close(self, timeout_s: float = _CLOSE_TIMEOUT_S) -> None:
        """Wait for what goes on, as before the window closes, and tell nothing of it."""
        for thread, task in [each for each in self._tasks.items() if each[1].background is self]:
            self._tasks[thread] = task._replace(done=_ignore, failed=_ignore)
            thread.join(timeout_s)

    def _run(self, work: Callable[[], object]) -> None:
        has_returned = False
        outcome: object = UNEXPECTED
        try:
            has_returned, outcome = True, work()
        except RigctlError as error:
            outcome = str(error)
        finally:
            with suppress(RuntimeError):  # it took longer than the window waited, and Qt has ended
                self._ended.emit(current_thread(), has_returned, outcome)

    def _tell(self, thread: Thread, has_returned: bool, outcome: Any) -> None:
        thread.join()  # it has told, and lets go of its function
        task = self._tasks.pop(thread)
        (task.done if has_returned else task.failed)(outcome)


def _ignore(_: object) -> None:
    pass
