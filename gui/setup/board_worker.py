"""Finds and flashes boards in a thread, with the code of ``rigctl ports`` and ``rigctl flash``."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from contextlib import suppress
from functools import partial
from typing import Any

from PySide6.QtCore import QObject, Qt, Signal

from rigctl.acquisition.setup.boards import installed_build
from rigctl.errors import RigctlError
from rigctl.values import DRUM, TAXELS

JOIN_LIMIT_S = 10.0
UNEXPECTED = "the boards could not be asked: Help → Crash reports says why"
_Work = Callable[[], Coroutine[Any, Any, Callable[[], None]]]
"""Does something in the thread's event loop, and returns what then tells it in the window's."""


class BoardWorker(QObject):
    """One thing at a time; a call while it is busy does nothing.

    Each of :meth:`find` and :meth:`flash` ends in one of :attr:`found`, :attr:`flashed`,
    :attr:`failed` and :attr:`cancelled`.
    """

    progressed = Signal(str, float)
    """What happens, and how much of it is done, 0 to 1."""
    found = Signal(list, dict)
    """The :class:`PortReport` of each port, and the build of this installation for each board."""
    flashed = Signal(object)
    """The :class:`Flashed` board."""
    failed = Signal(str)
    """One sentence."""
    cancelled = Signal()
    _ended = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._thread: threading.Thread | None = None
        self._running: tuple[asyncio.AbstractEventLoop, asyncio.Task[Any]] | None = None
        self._is_cancelled = False
        # The thread emits, the window's thread acts.
        self._ended.connect(self._end, Qt.ConnectionType.QueuedConnection)

    @property
    def is_busy(self) -> bool:
        """Whether ports are asked or a board is flashed."""
        return self._thread is not None

    def find(self) -> None:
        """Ask the board on every serial port for its name and firmware."""
        # As rigctl ports: the loop of Windows that runs programs has no use here.
        self._start(self._find, asyncio.SelectorEventLoop)

    def flash(self, board: str, port: str) -> None:
        """Write this installation's firmware; an empty ``port`` is found."""
        self._start(partial(self._flash, board, port), None)

    def cancel(self) -> None:
        """End what goes on as Ctrl-C ends the commands: the program that writes is ended, too."""
        self._is_cancelled = True
        running = self._running
        if running is not None:
            with suppress(RuntimeError):  # it has ended meanwhile, and its loop is closed
                running[0].call_soon_threadsafe(running[1].cancel)

    def close(self) -> None:
        """End what goes on, and wait until the ports are free."""
        if self._thread is not None:
            self.cancel()
            self._thread.join(JOIN_LIMIT_S)

    async def _find(self) -> Callable[[], None]:
        # Drivers are loaded when a board is asked for, not at the start of the window.
        from rigctl.devices.port_discovery import probe_ports

        builds = {board: installed_build(board) for board in (DRUM, TAXELS)}
        self.progressed.emit("asking the ports: silent for 2 s first", 0.0)
        reports = await probe_ports(asyncio.get_running_loop())
        return lambda: self.found.emit(reports, builds)

    async def _flash(self, board: str, port: str) -> Callable[[], None]:
        from rigctl.devices.flash import flash_board

        flashed = await flash_board(board, self.progressed.emit, port)
        return lambda: self.flashed.emit(flashed)

    def _start(
        self, work: _Work, loop_factory: Callable[[], asyncio.AbstractEventLoop] | None
    ) -> None:
        if self._thread is None:
            self._is_cancelled = False
            run = partial(self._run, work, loop_factory)
            self._thread = threading.Thread(target=run, name="rigctl-boards")
            self._thread.start()

    def _run(
        self, work: _Work, loop_factory: Callable[[], asyncio.AbstractEventLoop] | None
    ) -> None:
        tell: Callable[[], None] = partial(self.failed.emit, UNEXPECTED)
        try:
            with asyncio.Runner(loop_factory=loop_factory) as runner:
                tell = runner.run(self._cancellable(work))
        except RigctlError as error:
            tell = partial(self.failed.emit, str(error))
        except asyncio.CancelledError:
            tell = self.cancelled.emit
        finally:
            self._ended.emit(tell)

    async def _cancellable(self, work: _Work) -> Callable[[], None]:
        task = asyncio.current_task()
        assert task is not None
        self._running = asyncio.get_running_loop(), task
        try:
            if self._is_cancelled:
                raise asyncio.CancelledError
            return await work()
        finally:
            self._running = None

    def _end(self, tell: Callable[[], None]) -> None:
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()
        tell()
