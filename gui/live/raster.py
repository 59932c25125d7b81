"""The spike raster: SA and RA of each layer of the sensor, newest on the right."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from gui.live.scrolling_image import ScrollingImage
from gui.live.timeline import PixelColumns, Timeline
from gui.widgets.colours import blend, rgb
from gui.widgets.theme import Theme
from rigctl.config.rig_config import LAYER_NAMES
from rigctl.session.sensor_layout import SensorLayout


class TrainRows:
    """Rows of a raster from the top: SA and RA of the top layer, then of those below.

    ``order``: the encoder's row in each raster row, int64 (n_rows,); the encoder has SA 1 … n,
    then RA 1 … n. ``group_of``: the group of each raster row, int64 (n_rows,).
    ``taxels``: those whose trains have a row, from 0; None for all.
    """

    def __init__(self, layout: SensorLayout, taxels: Collection[int] | None = None) -> None:
        self.sensor_layout = layout
        groups = layout.train_groups()
        self.group_names = tuple(name for name, _ in groups)
        order = np.concatenate([np.array(rows, np.int64) for _, rows in groups])
        group_of = np.repeat(np.arange(len(groups)), layout.per_layer)
        shown = [*range(layout.n_taxels)] if taxels is None else [*taxels]
        kept = np.isin(order % layout.n_taxels, shown)
        self.order, self.group_of = order[kept], group_of[kept]

    def __len__(self) -> int:
        return len(self.order)

    def label(self, row: int) -> str:
        """Return the name of a raster row, as in the paper: T_SA-1 … T_RA-18."""
        channel, taxel = divmod(int(self.order[row]), self.sensor_layout.n_taxels)
        return f"T_{('SA', 'RA')[channel]}-{taxel + 1}"

    def group_ticks(self) -> list[tuple[float, str]]:
        """Return an axis tick for each group: its middle from the top in rows, and its name."""
        ticks = []
        for group, name in enumerate(self.group_names):
            if len(rows := np.flatnonzero(self.group_of == group)):
                ticks.append((float(rows.mean()) + 0.5, name))
        return ticks

    def row_ticks(self) -> list[tuple[float, str]]:
        """Return an axis tick for each row: its middle from the top, and its name."""
        return [(row + 0.5, self.label(row)) for row in range(len(self))]

    def group_colours(self, theme: Theme) -> list[str]:
        """Return the colour of each group."""
        top, bottom = theme.groups[:2], theme.groups[2:]
        return [
            self._shade(top[group % 2], bottom[group % 2], group // 2)
            for group in range(len(self.group_names))
        ]

    def layer_colours(self, theme: Theme) -> list[str]:
        """Return the colour of each layer."""
        layers = range(len(self.sensor_layout.layers))
        return [self._shade(*theme.layers, layer) for layer in layers]

    def _shade(self, top: str, bottom: str, layer: int) -> str:
        """Return the colour of a layer, evenly between those of the top and of the bottom one."""
        return blend(bottom, top, layer / max(len(self.sensor_layout.layers) - 1, 1))


def layer_titles(layout: SensorLayout, unit: str = "counts") -> tuple[str, ...]:
    """Return a title for the map of each layer."""
    if len(layout.layers) == 1:
        return (f"Readings now, {unit}",)
    if len(layout.layers) == 2:
        places = ("Top layer", "Bottom layer")
        return tuple(
            f"{place} ({f'type {name}' if name in LAYER_NAMES else name}), {unit}"
            for place, name in zip(places, layout.layers, strict=True)
        )
    return tuple(f"Layer {name}, {unit}" for name in layout.layers)


class Raster(ScrollingImage):
    """One tick per pixel column with at least one spike."""

    def __init__(self, theme: Theme, layout: SensorLayout) -> None:
        super().__init__(2 * layout.n_taxels, theme)
        self.rows = TrainRows(layout)

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Group the rows by the layers of another sensor with as many taxels."""
        self.show_rows(TrainRows(layout))

    def show_rows(self, rows: TrainRows) -> None:
        """Show other rows of the trains."""
        self.prepareGeometryChange()
        self.rows, self.n_rows = rows, len(rows)
        self._is_stale = True

    def prepare(self, height: int) -> None:
        """Assign every pixel row its raster row, ink and background."""
        n_rows, group_of = len(self.rows), self.rows.group_of
        edges = np.arange(n_rows + 1) * height // n_rows
        at = np.searchsorted(edges, np.arange(height), "right") - 1
        self._row = np.clip(at, 0, n_rows - 1)
        inks = np.array([rgb(colour) for colour in self.rows.group_colours(self.theme)], np.uint32)
        self._ink = inks[group_of][self._row][:, None]
        shades = [self.theme.plot, blend(self.theme.muted, self.theme.plot, 0.07)]
        backgrounds = np.array([rgb(shade) for shade in shades], np.uint32)
        self._background = backgrounds[group_of % 2][self._row][:, None]
        self._is_tick = np.ones((height, 1), bool)
        if height >= 4 * n_rows:
            self._is_tick[edges[:-1]] = False

    def render_columns(self, timeline: Timeline, columns: PixelColumns) -> NDArray[np.uint32]:
        """Return ink where the column has a spike."""
        spikes = timeline.spike_columns(columns)
        is_ink = spikes[:, self.rows.order].T[self._row] & self._is_tick
        return np.where(is_ink, self._ink, self._background)
