"""The rows of the rasters: the trains of a sensor in the paper's order, grouped by its layers."""

from __future__ import annotations

import numpy as np

from gui.live.scrolling_image import blend
from gui.widgets.theme import Theme
from rigctl.session.format.sensor_layout import LAYER_NAMES, SensorLayout


class TrainRows:
    """Rows of a raster from the top: SA and RA of the top layer, then of those below.

    ``order``: the encoder's row in each raster row, int64 (n_rows,); the encoder has SA 1 … n,
    then RA 1 … n. ``group_of``: the group of each raster row, int64 (n_rows,).
    """

    def __init__(self, layout: SensorLayout) -> None:
        self.sensor_layout = layout
        groups = layout.train_groups()
        self.group_names = tuple(name for name, _ in groups)
        self.order = np.concatenate([np.array(rows, np.int64) for _, rows in groups])
        self.group_of = np.repeat(np.arange(len(groups)), layout.per_layer)

    def __len__(self) -> int:
        return len(self.order)

    def label(self, row: int) -> str:
        """Return the name of a raster row: SA-1 … RA-18."""
        channel, taxel = divmod(int(self.order[row]), self.sensor_layout.n_taxels)
        return f"{('SA', 'RA')[channel]}-{taxel + 1}"

    def group_ticks(self) -> list[tuple[float, str]]:
        """Return an axis tick for each group: its middle from the top in rows, and its name."""
        height = self.sensor_layout.per_layer
        return [((i + 0.5) * height, name) for i, name in enumerate(self.group_names)]

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


def layer_titles(layout: SensorLayout) -> tuple[str, ...]:
    """Return a title for the map of each layer."""
    if len(layout.layers) == 1:
        return ("Readings now, counts",)
    if len(layout.layers) == 2:
        places = ("Top layer", "Bottom layer")
        return tuple(
            f"{place} ({f'type {name}' if name in LAYER_NAMES else name}), counts"
            for place, name in zip(places, layout.layers, strict=True)
        )
    return tuple(f"Layer {name}, counts" for name in layout.layers)
