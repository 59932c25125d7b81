"""Geometry of a sensor: rows and columns of its taxels, and the names of its layers.

A session stores it as the attribute ``sensor_layout``. The columns of the samples are the places
of the sensor: layer by layer, in each layer row by row.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

from rigctl.config.rig_config import (
    LAYER_NAME_BYTES,
    LAYER_NAMES,
    MAX_TAXELS,
    PAPER_ARRAY,
    TaxelArray,
    usual_shape,
)
from rigctl.config.text_file import name_problem, shorten

ATTRIBUTE = "sensor_layout"
LAYERS_SHOWN = 8
_ROMAN = re.compile("[IVX]+")


@dataclass(frozen=True, slots=True)
class SensorLayout:
    """Rows and columns of each layer of a sensor, and its layers from the top, by name.

    Raises ValueError for sizes below 1, more than 1024 taxels, and for layers without a name or of
    the same name.
    """

    rows: int
    columns: int
    layers: tuple[str, ...]

    def __post_init__(self) -> None:
        if min(self.rows, self.columns, len(self.layers)) < 1:
            raise ValueError("a sensor has at least one row, one column and one layer")
        if self.n_taxels > MAX_TAXELS:
            raise ValueError(f"{shorten(self.describe())} are more than {MAX_TAXELS} taxels")
        for name in self.layers:
            if problem := name_problem(name, LAYER_NAME_BYTES):
                raise ValueError(f"a layer's name {problem}")
        if len(set(self.layers)) < len(self.layers):
            name = Counter(self.layers).most_common(1)[0][0]
            raise ValueError(f"two layers have the same name: {name}")

    @classmethod
    def default(cls, n_taxels: int) -> SensorLayout:
        """Return the layout of a session that does not say it, of the usual shape."""
        rows, columns, n_layers = usual_shape(n_taxels)
        return cls(rows, columns, LAYER_NAMES[:n_layers])

    @classmethod
    def of_rig(cls, taxels: TaxelArray) -> SensorLayout:
        """Return the layout that ``[taxels]`` of a rig describes.

        Without names, the layers are as many as the rows and columns leave for ``count``; where
        these do not divide it, the layout is the default of that number.
        """
        rows, columns, n_layers = taxels.shape
        return cls(rows, columns, taxels.layers or LAYER_NAMES[:n_layers])

    def to_values(self) -> dict[str, Any]:
        """Return plain values for JSON: ``rows``, ``columns``, ``layers``."""
        return {**asdict(self), "layers": list(self.layers)}

    @property
    def n_taxels(self) -> int:
        """Number of taxels of all layers."""
        return self.rows * self.columns * len(self.layers)

    @property
    def per_layer(self) -> int:
        """Number of taxels of one layer."""
        return self.rows * self.columns

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each taxel: layer and number from 1, as I-1 … II-18; with one layer 1 … n."""
        names = self.layers if len(self.layers) > 1 else ("",)
        return tuple(
            f"{names[self.layer_of(taxel)]}-{taxel + 1}".removeprefix("-")
            for taxel in range(self.n_taxels)
        )

    def layer_of(self, taxel: int) -> int:
        """Return the number of a taxel's layer in ``layers``; both count from 0."""
        return taxel // self.per_layer

    def row_of(self, taxel: int) -> int:
        """Return the row of a taxel in its layer; both count from 0."""
        return taxel % self.per_layer // self.columns

    def taxels_of(self, layer: int) -> range:
        """Return the taxels of a layer; both count from 0."""
        return range(layer * self.per_layer, (layer + 1) * self.per_layer)

    def channel_name(self, channel: str, layer: int) -> str:
        """Return the name of the trains of a channel and layer.

        SAI of Roman numerals, ``SA upper`` of other names, SA where there is one layer.
        """
        if len(self.layers) == 1:
            return channel
        name = self.layers[layer]
        return f"{channel}{name}" if _ROMAN.fullmatch(name) else f"{channel} {name}"

    def train_groups(self) -> tuple[tuple[str, range], ...]:
        """Return name and rows in :class:`rigctl.values.Spikes` of the trains of each kind.

        In the paper's order: SAI, RAI, SAII, RAII; with one layer SA, RA.
        """
        return tuple(
            (self.channel_name(channel, layer), range(first + taxels.start, first + taxels.stop))
            for layer, taxels in enumerate(map(self.taxels_of, range(len(self.layers))))
            for channel, first in (("SA", 0), ("RA", self.n_taxels))
        )

    def train_names(self) -> tuple[tuple[str, int], ...]:
        """Return name and row in :class:`rigctl.values.Spikes` of each train, as SAI-1 … RAII-18.

        Trains are in the order of :meth:`train_groups`; taxels count from 1 over all layers.
        """
        return tuple(
            (f"{name}-{row % self.n_taxels + 1}", row)
            for name, rows in self.train_groups()
            for row in rows
        )

    def describe(self) -> str:
        """Return the layout in words, as 3 × 3 taxels in 2 layers (I, II); of many the first."""
        words = f"{self.rows} × {self.columns} taxels in "
        if len(self.layers) == 1:
            return f"{words}one layer"
        names = ", ".join(self.layers[:LAYERS_SHOWN])
        more = ", …" if len(self.layers) > LAYERS_SHOWN else ""
        return f"{words}{len(self.layers)} layers ({names}{more})"


PAPER_SENSOR = SensorLayout.of_rig(PAPER_ARRAY)


def layouts_match(one: SensorLayout | None, other: SensorLayout | None) -> bool:
    """Return whether both have each taxel at the same place; None, an older part, matches any.

    Names do not matter.
    """
    if one is None or other is None:
        return True
    sizes = [(each.rows, each.columns, len(each.layers)) for each in (one, other)]
    return sizes[0] == sizes[1]


def describe_difference(one: SensorLayout | None, other: SensorLayout | None) -> str:
    """Return both layouts for an error message."""
    names = [layout.describe() if layout else "unknown" for layout in (one, other)]
    return f"{names[0]}, not {names[1]}"
