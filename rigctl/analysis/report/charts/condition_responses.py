"""The responses to every texture at every speed and force: mean reading, raster and PSTH."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.trial_set import TrialReader, TrialRef, TrialSet, open_trials
from rigctl.encoding.encoder import encode_trials
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
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


def measure_responses(
    trials: TrialSet, ranges: Normalisation, parameters: EncoderParameters
) -> list[ConditionResponse]:
    """Return the response of each condition, by texture, force and speed; at most 600 of them.

    Encoded as in Original, without C. ``trials``: without gaps.
    Raises SessionError for a trial that cannot be read.
    """
    members: dict[tuple[str, float, float], list[TrialRef]] = {}
    for trial in trials.trials:
        members.setdefault((trial.texture, trial.force_g, trial.speed_mm_s), []).append(trial)
    with open_trials(trials.files) as reader:
        return [
            _measure(reader, members[key], ranges, parameters)
            for key in sorted(members)[:MAX_CONDITIONS]
        ]


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
