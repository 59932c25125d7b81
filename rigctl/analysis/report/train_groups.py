"""The groups of spike trains in a figure: one for each channel of each layer, with its colour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.session.sensor_layout import SensorLayout

_CHANNELS = (("slow", ("#00629e", "#3c9bd1"), 0.82), ("fast", ("#c24e00", "#c08400"), 0.5))
"""Of SA and RA: words, colours of the top and of the bottom layer, height of a tick."""


@dataclass(frozen=True, slots=True)
class TrainGroup:
    """The spike trains of one channel (SA or RA) of one layer.

    ``rows``: theirs in :class:`rigctl.values.Spikes`. Position and tick height mark a group too,
    for readers and printers without colours.
    """

    name: str
    description: str
    colour: str
    tick_height: float
    rows: range


def train_groups(layout: SensorLayout) -> tuple[TrainGroup, ...]:
    """Return the groups of a sensor from the top, SA before RA in each layer."""
    groups = []
    for number, (name, rows) in enumerate(layout.train_groups()):
        layer, channel = divmod(number, len(_CHANNELS))
        words, colours, tick_height = _CHANNELS[channel]
        description = ", ".join(filter(None, (words, _layer_words(layout, layer))))
        colour = _shade(colours, layer, len(layout.layers))
        groups.append(TrainGroup(name, description, colour, tick_height, rows))
    return tuple(groups)


def _layer_words(layout: SensorLayout, layer: int) -> str:
    if len(layout.layers) == 1:
        return ""
    if len(layout.layers) == 2:
        return ("top layer", "bottom layer")[layer]
    return f"layer {layer + 1} from the top"


def _shade(colours: tuple[str, str], layer: int, n_layers: int) -> str:
    """Return the colour of a layer, evenly between those of the top and of the bottom layer."""
    share = layer / max(n_layers - 1, 1)
    top, bottom = (np.array([int(c[i : i + 2], 16) for i in (1, 3, 5)]) for c in colours)
    mixed = np.rint(top + share * (bottom - top)).astype(int)
    return "#" + "".join(f"{value:02x}" for value in mixed)
