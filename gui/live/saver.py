"""Writes pictures and tables beside the window, which never waits for the disk."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import datetime
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QBuffer, QByteArray, QIODevice, QObject, QStandardPaths, Signal
from PySide6.QtGui import QImage, QImageWriter
from PySide6.QtWidgets import QLineEdit, QWidget

from gui.live.live_data import LiveData
from gui.live.timeline import TimeWindow
from gui.widgets.file_browser import PathKind, browse_button, new_files_folder
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button
from rigctl.analysis.files import atomic_file
from rigctl.encoder.reading import Reading
from rigctl.errors import RigctlError, WrongUse

Floats = NDArray[np.float64]
_ROWS_AT_ONCE = 20_000
COUNTS = "counts (0–1023)"


class ShownSamples(NamedTuple):
    """Samples in a time window with force and speed at each of them.

    ``time_s``: engine's time, float64 (n,). ``position``: board's counter, int64 (n,).
    ``samples``: readings in ``unit``, uint16 (n, k); ``taxels``: their numbers from 0.
    ``spikes``: uint8 (n, 2·k), SA then RA. ``drum``: (n,) each, NaN before the first reading of
    the load cell.
    """

    title: str
    time_s: Floats
    position: NDArray[np.int64]
    samples: NDArray[np.uint16]
    spikes: NDArray[np.uint8]
    taxels: tuple[int, ...]
    drum: dict[str, Floats]
    unit: str = COUNTS


def write_table(shown: ShownSamples, path: Path) -> None:
    """Write one line a sample, behind a comment on the units. Raises DiskFault, never replaces."""
    names = [f"T{taxel + 1}" for taxel in shown.taxels]
    trains = [f"T_{channel}-{taxel + 1}" for channel in ("SA", "RA") for taxel in shown.taxels]
    header = ["sample", "time_s", *shown.drum, *names, *trains]
    formats = ["%d", "%.6f"] + ["%.2f"] * len(shown.drum) + ["%d"] * (len(names) + len(trains))
    with atomic_file(path) as partial, partial.open("w", encoding="utf-8") as file:
        file.write(f"# {shown.title}; T… readings in {shown.unit}, T_… spikes in the sample\n")
        file.write(",".join(header) + "\n")
        for first in range(0, len(shown.time_s), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            drum = [column[rows] for column in shown.drum.values()]
            columns = [shown.position[rows], shown.time_s[rows], *drum]
            table = np.column_stack((*columns, shown.samples[rows], shown.spikes[rows]))
            np.savetxt(file, table, fmt=",".join(formats))


def shown_samples(
    data: LiveData, window: TimeWindow, taxels: Sequence[int], *, simulated: bool = False
) -> ShownSamples:
    """Return copies of the samples in a window, of these taxels from 0."""
    timeline = data.timeline
    bounds = timeline.counters.count_below(np.array([window.left, window.right + 1]))
    rows = int(bounds[0]), int(bounds[1])
    position = timeline.counters.between(*rows).copy()
    spikes = timeline.spikes.between(*rows)
    n_taxels = spikes.shape[1] // 2
    trains = [*taxels, *(n_taxels + taxel for taxel in taxels)]
    origin = "SIMULATED, " if simulated else ""
    title = f"rigctl, live views, {origin}{len(position)} samples at 1000 Hz"
    return ShownSamples(
        title,
        timeline.time_s.between(*rows).copy(),
        position,
        timeline.samples.between(*rows)[:, list(taxels)],
        spikes[:, trains],
        tuple(taxels),
        data.drum.held_at(position),
        COUNTS if data.reading is Reading.COUNTS else data.reading.unit,
    )


class SaveStrip(QWidget):
    """``folder``: where pictures and tables go."""

    picture_requested = Signal(str)
    """The folder."""
    table_requested = Signal(str)
    """The folder."""
    path_requested = Signal(object, object)
    """A :class:`PathKind`, and the function that takes the chosen path."""

    def __init__(self) -> None:
        super().__init__()
        pictures = QStandardPaths.StandardLocation.PicturesLocation
        default = QStandardPaths.writableLocation(pictures) or str(Path.home())
        self.folder = QLineEdit(default)
        self.folder.setMinimumWidth(80)
        self.folder.setAccessibleName("Folder of pictures and tables")
        self.picture = push_button(
            "Picture",
            lambda: self.picture_requested.emit(self.folder.text()),
            "Save the plots as they are now as a PNG",
        )
        self.table = push_button(
            "Table",
            lambda: self.table_requested.emit(self.folder.text()),
            "Save the samples in view as a CSV",
        )
        browse = browse_button(self.path_requested, PathKind.OUTPUT, self.folder.setText)
        row = (self.picture, self.table, label("in", "muted"), self.folder, browse)
        self.setLayout(hbox(*row, wide=3, margins=(6, 0, 6, 0)))


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
