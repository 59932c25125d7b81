"""Small multiples of the responses: a row for each texture, a column for each speed, by force."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.report.charts.condition_responses import (
    SHOWN_S,
    ConditionResponse,
    measure_responses,
)
from rigctl.analysis.report.charts.line_chart import line_path
from rigctl.analysis.trial_set import TrialSet
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters

WIDTH = 200.0
READING, RASTER, RATE = (1.0, 23.0), (27.0, 61.0), (65.0, 89.0)
"""Upper and lower edge of each part of a panel."""
PSTH_PERCENTILE = 97.5
SA_COLOUR, RA_COLOUR = (59, 120, 216, 255), (217, 108, 32, 255)
"""Dark enough for paper, light enough for a dark screen."""


class ResponsePanel(NamedTuple):
    """One condition: paths and image of its SVG, and ``title`` when hovered."""

    title: str
    reading: str
    raster: str
    rates: tuple[str, str]


class ForceBlock(NamedTuple):
    """The panels of one force: for each texture a panel for each speed, None without trials."""

    force_g: float
    speeds_mm_s: tuple[float, ...]
    rows: tuple[tuple[str, tuple[ResponsePanel | None, ...]], ...]


@dataclass(frozen=True)
class SmallMultiples:
    """All panels on common scales, so that they can be compared.

    ``left_out``: conditions of the set beyond those in ``responses``.
    """

    responses: Sequence[ConditionResponse]
    left_out: int = 0
    shown_s: float = SHOWN_S

    @cached_property
    def reading_reach(self) -> float:
        """How far a mean reading gets from its own mean, in shares of the taxel ranges."""
        reaches = (np.abs(one.reading - one.reading.mean()).max() for one in self.responses)
        return max(0.001, *map(float, reaches))

    @cached_property
    def top_hz(self) -> float:
        """Upper end of the PSTH: an onset may lie above it."""
        rates = np.concatenate([one.rate_hz.ravel() for one in self.responses])
        return max(1.0, float(np.percentile(rates, PSTH_PERCENTILE)))

    @property
    def note(self) -> str:
        """What a panel shows, with its scales."""
        averaged = max(one.averaged for one in self.responses)
        over = f"at most {averaged} trials" if averaged > 1 else "one trial"
        note = (
            f"The first {SHOWN_S:g} s of each condition, without C. From the top: reading, mean "
            f"over taxels and {over}, ± {self.reading_reach:.2g} of the taxel ranges around its "
            "own mean; raster of one trial, SA above RA, a row for each taxel; PSTH, mean of the "
            f"same trials, 0 to {self.top_hz:.0f} spikes/s a neuron (an onset may be cut off). All "
            "panels have these scales."
        )
        if self.left_out:
            note += f" Only {len(self.responses)} conditions are shown, {self.left_out} are not."
        return note

    @cached_property
    def blocks(self) -> list[ForceBlock]:
        """The panels by force, ascending."""
        return [self._block(force) for force in sorted({one.force_g for one in self.responses})]

    def _block(self, force_g: float) -> ForceBlock:
        ours = [one for one in self.responses if one.force_g == force_g]
        speeds = tuple(sorted({one.speed_mm_s for one in ours}))
        found = {(one.texture, one.speed_mm_s): self._panel(one) for one in ours}
        textures = sorted({one.texture for one in ours})
        rows = tuple(
            (name, tuple(found.get((name, speed)) for speed in speeds)) for name in textures
        )
        return ForceBlock(force_g, speeds, rows)

    def _panel(self, one: ConditionResponse) -> ResponsePanel:
        mean = float(one.reading.mean())
        sa_hz, ra_hz = one.rate_hz.mean(axis=1)
        title = (
            f"Texture {one.texture}, {one.speed_mm_s:g} mm/s, {one.force_g:g} g: mean reading "
            f"{mean:.3f}; SA {sa_hz:.1f}, RA {ra_hz:.1f} spikes/s a neuron; {one.averaged} of "
            f"{one.n_trials} trials averaged"
        )
        sa, ra = (_path(values, (0.0, self.top_hz), RATE) for values in one.rate_hz)
        scale = (mean - self.reading_reach, mean + self.reading_reach)
        reading = _path(one.reading, scale, READING)
        return ResponsePanel(title, reading, raster_uri(one.raster), (sa, ra))


def small_multiples(
    trials: TrialSet, ranges: Normalisation, parameters: EncoderParameters
) -> SmallMultiples:
    """Return the responses of a set as small multiples. Raises SessionError for an unread trial."""
    conditions = {(one.texture, one.speed_mm_s, one.force_g) for one in trials.trials}
    responses = measure_responses(trials, ranges, parameters)
    return SmallMultiples(responses, len(conditions) - len(responses))


def raster_uri(raster: NDArray[np.bool_]) -> str:
    """Return a raster, bool (2, rows, n), as the data URI of a transparent PNG."""
    from matplotlib.image import imsave

    rows = raster.shape[1]
    pixels = np.zeros((2 * rows + 1, raster.shape[2], 4), np.uint8)
    pixels[:rows][raster[0]] = SA_COLOUR
    pixels[rows + 1 :][raster[1]] = RA_COLOUR
    file = io.BytesIO()
    imsave(file, pixels, format="png", metadata={"Software": ""})
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"


def _path(
    values: NDArray[np.float64], scale: tuple[float, float], edges: tuple[float, float]
) -> str:
    (low, high), (top, bottom) = scale, edges
    x = (np.arange(len(values)) + 0.5) * WIDTH / len(values)
    y = bottom - (np.clip(values, low, high) - low) / (high - low) * (bottom - top)
    return line_path(list(zip(x.round(1).tolist(), y.round(1).tolist(), strict=True)))
