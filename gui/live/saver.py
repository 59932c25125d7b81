"""The samples in view as a table, and the strip that saves them or a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QStandardPaths, Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from gui.live.live_data import LiveData, ValueScale
from gui.live.sample_history import TimeWindow
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button

Floats = NDArray[np.float64]
_ROWS_AT_ONCE = 20_000


class ShownSamples(NamedTuple):
    """Samples in a time window with force and speed at each of them.

    ``time_s``: engine's time, float64 (n,). ``position``: board's counter, int64 (n,).
    ``samples``: readings, uint16 (n, k), which ``scale`` shows; ``taxels``: their numbers from 0.
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
    scale: ValueScale = ValueScale()


def write_table(shown: ShownSamples, path: Path) -> None:
    """Write one line a sample, behind a comment on the units."""
    names = [f"T{taxel + 1}" for taxel in shown.taxels]
    trains = [f"T_{channel}-{taxel + 1}" for channel in ("SA", "RA") for taxel in shown.taxels]
    header = ["sample", "time_s", *shown.drum, *names, *trains]
    scale = shown.scale
    reading = "%d" if scale.factor == 1 else "%.5f"
    unit = f"counts (0–{scale.full_scale})" if scale.factor == 1 else scale.unit
    formats = ["%d", "%.6f"] + ["%.2f"] * len(shown.drum)
    formats += [reading] * len(names) + ["%d"] * len(trains)
    with path.open("w", encoding="utf-8") as file:
        file.write(f"# {shown.title}; T… readings in {unit}, T_… spikes in the sample\n")
        file.write(",".join(header) + "\n")
        for first in range(0, len(shown.time_s), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            drum = [column[rows] for column in shown.drum.values()]
            columns = [shown.position[rows], shown.time_s[rows], *drum]
            table = np.column_stack(
                (*columns, shown.samples[rows] * scale.factor, shown.spikes[rows])
            )
            np.savetxt(file, table, fmt=",".join(formats))


def shown_samples(
    data: LiveData,
    window: TimeWindow,
    taxels: Sequence[int],
    scale: ValueScale,
    *,
    simulated: bool = False,
) -> ShownSamples:
    """Return copies of the samples in a window, of these taxels from 0."""
    history = data.history
    bounds = history.counters.count_below(np.array([window.left, window.right + 1]))
    rows = int(bounds[0]), int(bounds[1])
    position = history.counters.between(*rows).copy()
    spikes = history.spikes.between(*rows)
    n_taxels = spikes.shape[1] // 2
    trains = [*taxels, *(n_taxels + taxel for taxel in taxels)]
    origin = "SIMULATED, " if simulated else ""
    title = f"rigctl, live views, {origin}{len(position)} samples at 1000 Hz"
    return ShownSamples(
        title,
        history.time_s.between(*rows).copy(),
        position,
        history.samples.between(*rows)[:, list(taxels)],
        spikes[:, trains],
        tuple(taxels),
        data.drum.held_at(position),
        scale,
    )


class SaveStrip(QWidget):
    """``folder``: where pictures and tables go."""

    picture_requested = Signal()
    table_requested = Signal()
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
            self.picture_requested.emit,
            "Save the plots as they are now as a PNG",
        )
        self.table = push_button(
            "Table",
            self.table_requested.emit,
            "Save the samples in view as a CSV",
        )
        browse = browse_button(self.path_requested, PathKind.OUTPUT, self.folder.setText)
        row = (self.picture, self.table, label("in", "muted"), self.folder, browse)
        self.setLayout(hbox(*row, wide=3, margins=(6, 0, 6, 0)))
