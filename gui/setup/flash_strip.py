"""The offer to flash a board whose firmware does not match this program, in a strip."""

from __future__ import annotations

from PySide6.QtCore import Signal

from gui.widgets.layouts import push_button
from gui.widgets.strip import Strip
from rigctl.acquisition.setup.boards import BOARD_NAMES


class FlashStrip(Strip):
    """Says which board does not match, and offers to write this installation's firmware to it."""

    flash_requested = Signal(str, str)
    """The board, and its port."""

    def __init__(self) -> None:
        super().__init__()
        self._board, self._port = "", ""
        self.flash = push_button("Flash", self._accept, "Write this installation's firmware to it")
        self.dismiss = push_button("Not now", self.hide)
        self.setLayout(self.row(self.flash, self.dismiss))

    def offer(self, board: str, port: str, sentence: str) -> None:
        """Offer to flash the board at a port; the sentence says why."""
        self._board, self._port = board, port
        self.text.setText(sentence)
        self.flash.setText(f"Flash the {BOARD_NAMES[board]}")
        self.show()

    def _accept(self) -> None:
        self.hide()
        self.flash_requested.emit(self._board, self._port)
