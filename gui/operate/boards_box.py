"""The first step of a set-up: which board is on which port, and its firmware, before connecting."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QLineEdit, QProgressBar, QPushButton, QWidget

from gui.operate.part_picture import PartDrawing
from gui.widgets.background import Background
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import Strip, label, set_property, show_progress, show_text
from gui.widgets.layouts import ComboBox, FlowLayout, container, hbox, push_button, vbox
from gui.widgets.typed_paths import typed_path
from rigctl.engine.setup.boards import (
    BOARD_NAMES,
    installed_build,
    judge_firmware,
    judge_reports,
    write_rig_file,
)
from rigctl.errors import RigctlError
from rigctl.values import DRUM, TAXELS

if TYPE_CHECKING:
    from rigctl.boards.flash import Flashed
    from rigctl.boards.port_discovery import PortReport


CLOSE_TIMEOUT_S = 10.0
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

    def __init__(self) -> None:
        super().__init__()
        self._background = Background("rigctl-boards")
        self.is_busy = False
        """Whether ports are asked or a board is flashed."""
        self._running: tuple[asyncio.AbstractEventLoop, asyncio.Task[Any]] | None = None
        self._is_cancelled = False

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
        self.cancel()
        self._background.close(CLOSE_TIMEOUT_S)

    async def _find(self) -> Callable[[], None]:
        # Drivers are loaded when a board is asked for, not at the start of the window.
        from rigctl.boards.port_discovery import probe_ports

        builds = {board: installed_build(board) for board in (DRUM, TAXELS)}
        self.progressed.emit("asking the ports: silent for 2 s first", 0.0)
        reports = await probe_ports(asyncio.get_running_loop())
        return lambda: self.found.emit(reports, builds)

    async def _flash(self, board: str, port: str) -> Callable[[], None]:
        from rigctl.boards.flash import flash_board

        flashed = await flash_board(board, self.progressed.emit, port)
        return lambda: self.flashed.emit(flashed)

    def _start(
        self, work: _Work, loop_factory: Callable[[], asyncio.AbstractEventLoop] | None
    ) -> None:
        if not self.is_busy:
            self.is_busy, self._is_cancelled = True, False
            run = partial(self._run, work, loop_factory)
            self._background.run(
                run, self._end, lambda text: self._end(lambda: self.failed.emit(text))
            )

    def _run(
        self, work: _Work, loop_factory: Callable[[], asyncio.AbstractEventLoop] | None
    ) -> Callable[[], None]:
        try:
            with asyncio.Runner(loop_factory=loop_factory) as runner:
                return runner.run(self._cancellable(work))
        except asyncio.CancelledError:
            return self.cancelled.emit

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
        self.is_busy = False
        tell()


class FlashStrip(Strip):
    """Says which board does not match, and offers to write this installation's firmware to it."""

    flash_requested = Signal(str, str)
    """The board, and its port."""

    def __init__(self) -> None:
        super().__init__()
        self._board, self._port = "", ""
        self.flash = push_button("Flash", self._accept, "Write this installation's firmware to it")
        self.dismiss = push_button("Not now", self.hide)
        self.lay_out(self.flash, self.dismiss)

    def offer(self, board: str, port: str, sentence: str) -> None:
        """Offer to flash the board at a port; the sentence says why."""
        self._board, self._port = board, port
        self.text.setText(sentence)
        self.flash.setText(f"Flash the {BOARD_NAMES[board]}")
        self.show()

    def _accept(self) -> None:
        self.hide()
        self.flash_requested.emit(self._board, self._port)


INTRODUCTION = (
    "Plug both boards into USB. Opening a port resets its board, whose bootloader is left in peace "
    "for 2 s; nothing moves."
)
NOT_ASKED = "Not asked yet."
FIND_IT = "the port where it answers"
CANCELLED = "Cancelled; nothing was changed."
FLASH_CANCELLED = (
    "Cancelled. The board keeps its bootloader and switches nothing on until it is flashed: press "
    "Flash again."
)
RELEASED = "The boards are free in a moment: press Find the boards, then Flash."
NEW_FILE = "~/rig.toml"
NO_WHOLE_PATH = "give the whole path of the rig.toml, or one that begins with ~"
PICTURE = "mega#arduino-uno"
STEPS = 1000


class BoardsBox(QWidget):
    """Finds the boards by what they say of themselves, flashes them, and connects to them.

    ``refusal`` returns why a board may not be reset now, empty where it may.
    """

    connect_requested = Signal(str)
    """The ``rig.toml`` that names the boards' ports."""
    path_requested = Signal(object, object)

    def __init__(self, refusal: Callable[[], str]) -> None:
        super().__init__()
        self._refusal = refusal
        self._ports: dict[str, str] = {}
        """Where the boards are, once both have answered."""
        self._builds: dict[str, str] = {}
        self._reports: list[PortReport] = []
        self._is_flashing = False
        self.worker = BoardWorker()
        self.drawing = PartDrawing()
        self.drawing.show_part(PICTURE)
        self.expected, self.found = label("", wraps=True), label("", wraps=True)
        self.problem, self.state = label("", "bad", wraps=True), label("", "muted", wraps=True)
        self.progress = QProgressBar()
        self.progress.setAccessibleName("Flash: how much is written and read back")
        self.port = ComboBox()
        self.port.setAccessibleName("Port of the board that is flashed")
        self.rig_file = QLineEdit(NEW_FILE)
        self.rig_file.setToolTip("Describes your rig; it is written where there is none")
        self.rig_file.setAccessibleName("Rig description")
        self._add_buttons()
        self._lay_out()
        self._connect_worker()
        self._show_ports()
        self._show_result()
        self._show_free()

    def find_boards(self) -> None:
        """Ask the board on every port, or say why that is not possible now."""
        if self._may_begin():
            self._reports, self._ports = [], {}
            self._show_result()
            self.worker.find()
            self._show_free()

    def flash(self, board: str, port: str = "") -> None:
        """Write this installation's firmware to a board; an empty ``port`` is found."""
        if self._may_begin():
            self._is_flashing = True
            self.worker.flash(board, port)
            self._show_free()

    def suggest(self, rig: str) -> None:
        """Propose the ``rig.toml`` that is chosen elsewhere; nothing for another kind of rig."""
        if rig.endswith(".toml"):
            self.rig_file.setText(rig)

    def show_released(self) -> None:
        """Say what to do once a rig that was connected has let its boards go."""
        self._show_state(RELEASED, "heading")

    def _add_buttons(self) -> None:
        tip = "Ask the board on every serial port for its name and firmware"
        self.find_button = push_button("Find the boards", self.find_boards, tip)
        self.flash_buttons = {
            board: push_button(
                f"Flash the {name}",
                partial(self._flash, board),
                f"Write this installation's firmware to the {name}, verify it and read its name",
            )
            for board, name in BOARD_NAMES.items()
        }
        self.cancel_button = push_button("Cancel", self._cancel, "End what goes on")
        tip = "Write the ports into rig.toml, and connect"
        self.connect_button = push_button("Connect", self._connect, tip)

    def _lay_out(self) -> None:
        flash: list[QPushButton] = list(self.flash_buttons.values())
        at = hbox(label("on"), self.port, wide=1)
        buttons = FlowLayout(self.find_button, *flash, container(at), self.cancel_button)
        browse = browse_button(self.path_requested, PathKind.RIG_FILE, self.rig_file.setText)
        connect = hbox(label("Then use"), self.rig_file, browse, self.connect_button, wide=1)
        self.setLayout(
            vbox(
                label("Boards and ports", "heading"),
                label(INTRODUCTION, "muted", wraps=True),
                *(self.drawing, buttons, self.progress, self.state),
                *(self.expected, self.found, self.problem, connect),
                spacing=6,
                tall=2,
            )
        )

    def _connect_worker(self) -> None:
        worker = self.worker
        worker.progressed.connect(self._show_progress)
        worker.found.connect(self._show_found)
        worker.flashed.connect(self._show_flashed)
        worker.failed.connect(lambda sentence: self._show_end(sentence, "bad"))
        worker.cancelled.connect(self._show_cancelled)

    def _may_begin(self) -> bool:
        """Return whether a board may be reset now; show why not."""
        refusal = self._refusal()
        if refusal:
            self._show_state(refusal, "bad")
        return not refusal and not self.worker.is_busy

    def _flash(self, board: str) -> None:
        """Flash a board at the chosen port, else where it has answered, else where it is found."""
        self.flash(board, self.port.currentData() or self._boards().get(board, ""))

    def _boards(self) -> dict[str, str]:
        """Return the port of each board that has answered."""
        return {r.identity.board: r.port for r in self._reports if r.identity is not None}

    def _cancel(self) -> None:
        self._show_state("Ending …", "muted")
        self.worker.cancel()

    def _connect(self) -> None:
        path = typed_path(self.rig_file.text())
        if not path.is_absolute():
            self._show_state(NO_WHOLE_PATH, "bad")
            return
        try:
            write_rig_file(path, self._ports)
        except RigctlError as error:
            self._show_state(str(error), "bad")
            return
        self.connect_requested.emit(str(path))

    def _show_progress(self, what: str, share: float) -> None:
        self._show_state(f"{what[:1].upper()}{what[1:]} …", "muted")
        show_progress(self.progress, round(share * STEPS), STEPS)

    def _show_found(self, reports: list[PortReport], builds: dict[str, str]) -> None:
        self._reports, self._builds = reports, builds
        self._show_ports()
        self._show_result()
        self._show_end("", "muted")

    def _show_flashed(self, flashed: Flashed) -> None:
        from rigctl.boards.port_discovery import PortReport

        text = f"{flashed.text} is written and verified."
        self._show_end(f"{text} {flashed.remark}".strip(), "heading")
        new = PortReport(flashed.port, "", flashed.identity)
        others = [report for report in self._reports if report.port != flashed.port]
        self._reports = sorted((*others, new), key=lambda report: report.port)
        self._show_result()

    def _show_cancelled(self) -> None:
        self._show_end(FLASH_CANCELLED if self._is_flashing else CANCELLED, "bad")

    def _show_end(self, sentence: str, role: str) -> None:
        self._is_flashing = False
        self._show_state(sentence, role)
        self._show_free()

    def _show_state(self, text: str, role: str) -> None:
        show_text(self.state, text)
        set_property(self.state, "role", role)

    def _show_ports(self) -> None:
        """Offer the ports that are there, with the boards on them."""
        self.port.clear()
        self.port.addItem(FIND_IT, "")
        for report in self._reports:
            self.port.addItem(report.port, report.port)

    def _show_result(self) -> None:
        """Show what is on the ports beside what is expected, and what to do about it."""
        reports, ours = self._reports, self._builds
        result = judge_reports(reports)
        has = {r.identity.board: r.identity.build_hash for r in reports if r.identity is not None}
        firmware = judge_firmware({b: has[b] for b in ours if b in has}, ours)
        builds = f", with {firmware.expected}" if ours else ""
        found = "\n".join(map(_port_words, reports)) or result.found
        show_text(self.expected, f"Expected: {result.expected}{builds}")
        show_text(self.found, f"Found: {found if ours else NOT_ASKED}")
        show_text(self.problem, (result.problem or firmware.problem) if ours else "")
        ports = {board: port for board, port in self._boards().items() if board in BOARD_NAMES}
        self._ports = ports if result.passed else {}

    def _show_free(self) -> None:
        is_busy = self.worker.is_busy
        for button in (self.find_button, *self.flash_buttons.values(), self.connect_button):
            button.setEnabled(not is_busy)
        self.port.setEnabled(not is_busy)
        self.cancel_button.setEnabled(is_busy)
        self.progress.setVisible(self._is_flashing)


def _port_words(report: PortReport) -> str:
    """Return what is at a port, with what the computer calls it."""
    called = f" ({report.description})" if report.description not in ("", "n/a") else ""
    if report.identity is None:
        return f"{report.port}{called}: {report.error}"
    board = report.identity
    name = BOARD_NAMES.get(board.board, f"{board.board} board")
    firmware = f"firmware {board.firmware_version}, build {board.build_hash}"
    return f"{report.port}{called}: {name}, {firmware}"
