"""The responses to every texture at every speed and force: mean reading, raster and PSTH.

All panels have common scales, so that they can be compared.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.report.vega import SCHEMA, THEMED, Spec, config
from rigctl.analysis.trial_set import TrialReader, TrialRef, TrialSet, open_trials
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters
from rigctl.values import SAMPLE_RATE_HZ, Spikes

Floats = NDArray[np.float64]

SHOWN_S = 1.0
"""The paper's Figure 2C shows so much of a trial."""
AVERAGED_TRIALS = 4
"""Trials of a condition that readings and rates are averaged over, spread over the session."""
MAX_CONDITIONS = 600
READING_BIN, RASTER_BIN, RATE_BIN = 10, 5, 20
"""Samples in a point of the reading, a pixel of the raster, a point of the PSTH."""
MAX_RASTER_ROWS = 48
"""Rows of each channel's raster; more neurons share rows."""
WIDTH, HEIGHT = 200.0, 91.0
"""Of a panel."""
READING, RASTER, RATE = (1.0, 23.0), (27.0, 61.0), (65.0, 89.0)
"""Upper and lower edge of each part of a panel."""
PARTS = {12.0: "reading", 35.0: "SA", 53.0: "RA", 78.0: "spikes/s"}
"""Where the name of each part is."""
PSTH_PERCENTILE = 97.5
SA_COLOUR, RA_COLOUR = (59, 120, 216, 255), (217, 108, 32, 255)
"""Dark enough for paper, light enough for a dark screen."""


@dataclass(frozen=True, slots=True)
class ConditionResponse:
    """The first second of a texture at one speed and force.

    ``reading``: float64 (n,), mean over taxels and trials, 0 to 1 of the taxel ranges.
    ``raster``: bool (2, rows, n) of one trial, SA and RA. ``rate_hz``: float64 (2, n), spikes a
    second and neuron, mean over trials. ``averaged``: trials of ``n_trials`` that the means are of.
    """

    texture: str
    speed_mm_s: float
    force_g: float
    n_trials: int
    averaged: int
    reading: Floats
    raster: NDArray[np.bool_]
    rate_hz: Floats


@dataclass(frozen=True)
class Responses:
    """The responses of a set on common scales. ``left_out``: conditions beyond these."""

    conditions: Sequence[ConditionResponse]
    left_out: int = 0

    @cached_property
    def reading_reach(self) -> float:
        """How far a mean reading gets from its own mean, in shares of the taxel ranges."""
        reaches = (np.abs(one.reading - one.reading.mean()).max() for one in self.conditions)
        return max(0.001, *map(float, reaches))

    @cached_property
    def top_hz(self) -> float:
        """Upper end of the PSTH: an onset may lie above it."""
        rates = np.concatenate([one.rate_hz.ravel() for one in self.conditions])
        return max(1.0, float(np.percentile(rates, PSTH_PERCENTILE)))

    @property
    def note(self) -> str:
        """What a panel shows, with its scales."""
        averaged = max(one.averaged for one in self.conditions)
        over = f"at most {averaged} trials" if averaged > 1 else "one trial"
        note = (
            f"The first {SHOWN_S:g} s of each condition, without C. From the top: reading, mean "
            f"over taxels and {over}, ± {self.reading_reach:.2g} of the taxel ranges around its "
            "own mean; raster of one trial, SA above RA, a row for each taxel; PSTH, mean of the "
            f"same trials, 0 to {self.top_hz:.0f} spikes/s a neuron (an onset may be cut off). All "
            "panels have these scales."
        )
        if self.left_out:
            note += f" Only {len(self.conditions)} conditions are shown, {self.left_out} are not."
        return note

    def grids(self) -> dict[float, Spec]:
        """Return a drawing for each force in g: a row for each texture, a column for each speed."""
        grids: dict[float, list[Spec]] = {}
        for one in sorted(self.conditions, key=lambda one: one.force_g):
            grids.setdefault(one.force_g, []).extend(self._rows(one))
        return {force_g: _grid(rows) for force_g, rows in grids.items()}

    def _rows(self, one: ConditionResponse) -> Iterator[Spec]:
        """Yield the lines of a condition, then its raster and its words."""
        place = {"texture": one.texture, "speed": one.speed_mm_s}
        mean, reach = float(one.reading.mean()), self.reading_reach
        parts = (
            ("ink", one.reading, (mean - reach, mean + reach), READING),
            ("sa", one.rate_hz[0], (0.0, self.top_hz), RATE),
            ("ra", one.rate_hz[1], (0.0, self.top_hz), RATE),
        )
        for colour, values, scale, edges in parts:
            x = ((np.arange(len(values)) + 0.5) * SHOWN_S / len(values)).round(4)
            y = np.interp(values, scale, edges[::-1]).round(1)
            yield {**place, "colour": THEMED[colour], "x": x.tolist(), "y": y.tolist()}
        yield {**place, "raster": raster_uri(one.raster), "words": describe_response(one)}


def measure_responses(
    trials: TrialSet, ranges: Normalisation, parameters: EncoderParameters
) -> Responses:
    """Return the response of each condition, by texture, force and speed; at most 600 of them.

    Encoded as in Original, without C. ``trials``: without gaps.
    Raises SessionError for a trial that cannot be read.
    """
    members: dict[tuple[str, float, float], list[TrialRef]] = {}
    for trial in trials.trials:
        members.setdefault((trial.texture, trial.force_g, trial.speed_mm_s), []).append(trial)
    with open_trials(trials.files) as reader:
        shown = sorted(members)[:MAX_CONDITIONS]
        conditions = [_measure(reader, members[key], ranges, parameters) for key in shown]
    return Responses(conditions, len(members) - len(shown))


def _measure(
    reader: TrialReader,
    trials: Sequence[TrialRef],
    ranges: Normalisation,
    parameters: EncoderParameters,
) -> ConditionResponse:
    chosen = [trials[i] for i in _spread(len(trials))]
    n_shown = round(SHOWN_S * SAMPLE_RATE_HZ)
    samples = [reader.read(trial)[:n_shown] for trial in chosen]
    spikes = encode_trials(samples, ranges, parameters)
    n = min(map(len, samples))
    mean = np.mean([ranges.apply(one[:n]) for one in samples], axis=(0, 2))
    one = trials[0]
    return ConditionResponse(
        one.texture,
        one.speed_mm_s,
        one.force_g,
        len(trials),
        len(chosen),
        _binned_mean(mean),
        _raster(spikes[0]),
        np.mean([_rates(trains, n) for trains in spikes], axis=0),
    )


def _spread(n: int) -> list[int]:
    """Return rows spread evenly over n trials, so that early and late ones are averaged."""
    rows: list[int] = np.linspace(0, n - 1, min(n, AVERAGED_TRIALS)).round().astype(int).tolist()
    return rows


def _binned_mean(values: Floats) -> Floats:
    whole = max(len(values) // READING_BIN, 1)
    means: Floats = np.array([part.mean() for part in np.array_split(values, whole)])
    return means


def _raster(spikes: Spikes) -> NDArray[np.bool_]:
    """Return which pixels have a spike, bool (2, rows, n): SA trains, then RA trains."""
    n_neurons = spikes.n_trains // 2
    rows = min(n_neurons, MAX_RASTER_ROWS)
    raster = np.zeros((2, rows, spikes.n_samples // RASTER_BIN + 1), np.bool_)
    for channel in range(2):
        for neuron in range(n_neurons):
            train = spikes.train(channel * n_neurons + neuron)
            raster[channel, neuron * rows // n_neurons, train // RASTER_BIN] = True
    return raster


def _rates(spikes: Spikes, n: int) -> Floats:
    """Return the mean rate of a neuron of each channel in Hz, float64 (2, n_bins)."""
    n_neurons, n_bins = spikes.n_trains // 2, max(n // RATE_BIN, 1)
    rates = np.zeros((2, n_bins))
    for channel in range(2):
        ends = spikes.row_start[[channel * n_neurons, (channel + 1) * n_neurons]]
        bins = spikes.sample_index[ends[0] : ends[1]] // RATE_BIN
        counts = np.bincount(bins[bins < n_bins], minlength=n_bins)
        rates[channel] = counts * SAMPLE_RATE_HZ / RATE_BIN / n_neurons
    return rates


def _grid(rows: list[Spec]) -> Spec:
    """Return the Vega-Lite specification of panels whose heights are in pixels."""
    header = {"title": None, "labelFontWeight": "bold", "labelColor": THEMED["text"]}
    speed = {**header, "labelExpr": "datum.label + ' mm/s'"}
    return {
        "$schema": SCHEMA,
        "background": None,
        "padding": 4,
        "config": config(THEMED),
        "data": {"values": rows},
        "facet": {
            "row": {"field": "texture", "header": {**header, "labelAngle": 0}},
            "column": {"field": "speed", "header": speed},
        },
        "spacing": 10,
        "spec": {"width": WIDTH, "height": HEIGHT, "layer": [_lines(), _raster_image(), _words()]},
    }


def _lines() -> Spec:
    bare = {"title": None, "grid": False, "ticks": False, "domain": False}
    seconds = {**bare, "values": [0, SHOWN_S], "format": "g", "labelExpr": "datum.label + ' s'"}
    x = {"field": "x", "type": "quantitative", "axis": seconds}
    names = f"{list(PARTS.values())}[indexof({list(PARTS)}, datum.value)]"
    parts = {**bare, "values": list(PARTS), "labelExpr": names}
    y = {"field": "y", "type": "quantitative", "axis": parts}
    return {
        "transform": [{"filter": "isValid(datum.colour)"}, {"flatten": ["x", "y"]}],
        "mark": {"type": "line", "strokeWidth": 1, "aria": False},
        "encoding": {
            "x": {**x, "scale": {"domain": [0, SHOWN_S], "nice": False}},
            "y": {**y, "scale": {"domain": [HEIGHT, 0], "nice": False}},
            "color": {"field": "colour", "type": "nominal", "scale": None},
        },
    }


def _raster_image() -> Spec:
    top, bottom = RASTER
    image = {"type": "image", "aspect": False, "width": WIDTH, "height": bottom - top}
    return {
        "transform": [{"filter": "isValid(datum.raster)"}],
        "mark": {**image, "align": "left", "baseline": "top", "aria": False},
        "encoding": {"x": {"value": 0}, "y": {"value": top}, "url": {"field": "raster"}},
    }


def _words() -> Spec:
    """Return the invisible area over each panel that says its words."""
    corners = {"x": 0, "x2": WIDTH, "y": 0, "y2": HEIGHT}
    return {
        "transform": [{"filter": "isValid(datum.words)"}],
        "mark": {"type": "rect", "opacity": 0},
        "encoding": {
            **{name: {"value": value} for name, value in corners.items()},
            "description": {"field": "words"},
        },
    }


def describe_response(one: ConditionResponse) -> str:
    """Return a condition's means in a sentence."""
    sa_hz, ra_hz = one.rate_hz.mean(axis=1)
    return (
        f"Texture {one.texture}, {one.speed_mm_s:g} mm/s, {one.force_g:g} g: mean reading "
        f"{one.reading.mean():.3f}; SA {sa_hz:.1f}, RA {ra_hz:.1f} spikes/s a neuron; "
        f"{one.averaged} of {one.n_trials} trials averaged"
    )


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
