"""Encodes pictures beside the Qt thread, which only paints them."""

from __future__ import annotations

import threading
from itertools import count
from typing import NamedTuple

from PySide6.QtCore import QObject, Signal

from gui.analysis.export.picture_file import PaintedPicture, Picture, paint_picture
from rigctl.errors import RigctlError

_CLOSE_TIMEOUT_S = 30.0


class NewFile(NamedTuple):
    """Where a file goes: its folder, the beginning of its name, and its suffix."""

    folder: str
    stem: str
    suffix: str


class PictureEncoder(QObject):
    """Each picture has a thread: compressing a large one takes a tenth of a second and more."""

    encoded = Signal(object, object)
    """The :class:`NewFile`, and its content in bytes."""
    failed = Signal(str)
    """Why a picture was not encoded, and the cure."""
    _ended = Signal(int, object, str)

    def __init__(self) -> None:
        super().__init__()
        self._numbers = count()
        self._jobs: dict[int, tuple[NewFile, PaintedPicture]] = {}
        self._threads: list[threading.Thread] = []
        self._ended.connect(self._finish)

    def encode(self, picture: Picture, file: NewFile) -> None:
        """Paint a picture now; :attr:`encoded` or :attr:`failed` follows."""
        number, painted = next(self._numbers), paint_picture(picture, file.suffix, file.stem)
        self._jobs[number] = file, painted  # Qt's objects end in the thread that made them
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(
            target=self._encode, args=(number, painted), name="rigctl-picture-encoder"
        )
        self._threads.append(thread)
        thread.start()

    def wait(self) -> None:
        """Wait until every picture is encoded, as before the window closes."""
        for thread in self._threads:
            thread.join(_CLOSE_TIMEOUT_S)

    def _encode(self, number: int, painted: PaintedPicture) -> None:
        content, problem = b"", ""
        try:
            content = painted.encode()
        except RigctlError as error:
            problem = str(error)
        self._ended.emit(number, content, problem)

    def _finish(self, number: int, content: bytes, problem: str) -> None:
        file, _ = self._jobs.pop(number)
        if problem:
            self.failed.emit(problem)
        else:
            self.encoded.emit(file, content)
