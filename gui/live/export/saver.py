"""Writes pictures and tables beside the window, which never waits for the disk."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from multiprocessing.connection import Connection
from pathlib import Path

from PySide6.QtCore import QBuffer, QByteArray, QIODevice, QObject, Signal
from PySide6.QtGui import QImage, QImageWriter

from gui.live.export.table_file import ShownSamples, write_table
from gui.widgets.typed_paths import new_files_folder
from rigctl.analysis.files import atomic_file
from rigctl.errors import RigctlError, WrongUse

_CLOSE_TIMEOUT_S = 30.0


class Saver(QObject):
    """Each file is written in a thread; a table, which takes longer, in a process behind it."""

    saved = Signal(str)
    """The path of a file that is complete."""
    failed = Signal(str)
    """Why a file was not written, and the cure."""

    def __init__(self) -> None:
        super().__init__()
        self._threads: list[threading.Thread] = []

    def save_picture(self, image: QImage, folder: str) -> None:
        """Write a PNG into a folder; :attr:`saved` or :attr:`failed` follows."""
        self._start(lambda path: _write_picture(image, path), folder, ".png")

    def save_table(self, shown: ShownSamples, folder: str) -> None:
        """Write a CSV into a folder; :attr:`saved` or :attr:`failed` follows."""
        self._start(lambda path: _write_in_process(shown, path), folder, ".csv")

    def wait(self) -> None:
        """Wait until all files are written, as before the window closes."""
        for thread in self._threads:
            thread.join(_CLOSE_TIMEOUT_S)

    def _start(self, write: Callable[[Path], str], folder: str, suffix: str) -> None:
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        arguments = (write, folder, suffix)
        thread = threading.Thread(target=self._write, args=arguments, name="rigctl-live-saver")
        self._threads.append(thread)
        thread.start()

    def _write(self, write: Callable[[Path], str], folder: str, suffix: str) -> None:
        try:
            path = new_path(new_files_folder(folder), suffix)
            problem = write(path)
        except WrongUse as error:
            self.failed.emit(f"nothing was saved: {error}")
            return
        except OSError as error:
            problem = f"{folder}: {error.strerror or error}"
        if problem:
            self.failed.emit(f"nothing was saved ({problem}): choose another folder")
        else:
            self.saved.emit(str(path))


def new_path(folder: Path, suffix: str) -> Path:
    """Return the path of a new file in a folder, which is made: named by the time of day."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"live-{datetime.now():%Y-%m-%d-%H%M%S}"
    names = (stem if number == 1 else f"{stem}-{number}" for number in range(1, 10_000))
    return next(path for name in names if not (path := folder / f"{name}{suffix}").exists())


def _write_picture(image: QImage, path: Path) -> str:
    """Write a PNG, whole or not at all; return what went wrong, empty if nothing did."""
    buffer = QBuffer()
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    writer = QImageWriter(buffer, QByteArray(b"png"))
    if not writer.write(image):
        return writer.errorString()
    try:
        with atomic_file(path) as partial:
            partial.write_bytes(buffer.data().data())
    except RigctlError as error:
        return str(error)
    return ""


def _write_in_process(shown: ShownSamples, path: Path) -> str:
    """Write the table in a process, so that the window keeps its time; return what went wrong."""
    context = multiprocessing.get_context("spawn")
    near, far = context.Pipe(duplex=False)
    process = context.Process(target=_serve_table, args=(far, shown, path), daemon=True)
    process.start()
    far.close()
    try:
        return str(near.recv())
    except EOFError:
        return "the process that writes the table ended unexpectedly"
    finally:
        near.close()
        process.join()
        process.close()


def _serve_table(pipe: Connection, shown: ShownSamples, path: Path) -> None:
    problem = ""
    try:
        write_table(shown, path)
    except RigctlError as error:
        problem = str(error)
    with suppress(BrokenPipeError):  # the window has ended meanwhile
        pipe.send(problem)
