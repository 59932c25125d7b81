"""Rasters and rates of a neuron over the trials of conditions. This module does not import Qt."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from gui.analysis.trials.open_sessions import OpenSessions

MOST_CONDITIONS, MOST_TRIALS = 6, 20
BIN_S = 0.05
Floats = NDArray[np.float64]


class NeuronResponse(NamedTuple):
    """Spikes of one neuron in the trials of a condition.

    ``spikes_s``: of each trial, seconds since its first sample. ``at_s`` float64 (bins,): middle of
    each bin of ``BIN_S`` that every trial fills; ``mean_hz``, ``sd_hz`` float64 (bins,): rate over
    trials, divisor n − 1 (0 for one trial).
    """

    name: str
    spikes_s: tuple[Floats, ...]
    at_s: Floats
    mean_hz: Floats
    sd_hz: Floats


class ResponseGrid(NamedTuple):
    """Conditions in their order, and what was left out, as a sentence or empty.

    ``simulated``: whether any of the trials is.
    """

    neuron: str
    conditions: tuple[NeuronResponse, ...]
    left_out: str
    simulated: bool = False


def compare_responses(
    sessions: OpenSessions, trials: Iterable[tuple[str, int]], train: int, neuron: str
) -> ResponseGrid:
    """Return the responses of a train (SA 1 … n, RA 1 … n) by plate, speed and force.

    ``trials``: paths of open sessions of the drum, and rows in them; only the first trials and
    conditions are read. Raises SessionError.
    """
    groups: dict[tuple[str, float, float], list[tuple[str, int]]] = {}
    simulated = False
    for path, row in trials:
        session = sessions.drum_session(path)
        trial = session.trials[row]
        simulated |= session.header.simulated
        if trial["first_sample"] >= 0:
            key = str(trial["texture"]), float(trial["speed_mm_s"]), float(trial["force_g"])
            groups.setdefault(key, []).append((path, row))
    keys = sorted(groups)
    found = [
        _response(sessions, key, groups[key][:MOST_TRIALS], train) for key in keys[:MOST_CONDITIONS]
    ]
    left_out = _left_out(len(keys), map(len, groups.values()))
    return ResponseGrid(neuron, tuple(found), left_out, simulated)


def _left_out(n_conditions: int, lengths: Iterable[int]) -> str:
    parts = []
    if n_conditions > MOST_CONDITIONS:
        parts.append(f"the first {MOST_CONDITIONS} of {n_conditions} conditions")
    if max(lengths, default=0) > MOST_TRIALS:
        parts.append(f"the first {MOST_TRIALS} trials of each condition")
    return f"Shown are {' and '.join(parts)}: filter or select trials for others" if parts else ""


def _response(
    sessions: OpenSessions,
    key: tuple[str, float, float],
    trials: list[tuple[str, int]],
    train: int,
) -> NeuronResponse:
    from rigctl.encoding.encoder import encode_trials

    spikes, lengths = [], []
    for path, row in trials:
        samples = np.ascontiguousarray(sessions.drum_session(path).samples(row))
        (found,) = encode_trials([samples], sessions.taxel_range(path))
        spikes.append(np.asarray(found.train(train), np.float64) / SAMPLE_RATE_HZ)
        lengths.append(len(samples) / SAMPLE_RATE_HZ)
    edges = BIN_S * np.arange(int(min(lengths) / BIN_S + 1e-9) + 1, dtype=np.float64)
    at_s: Floats = np.asarray(edges[:-1] + BIN_S / 2, np.float64)
    rates = np.array([np.histogram(one, edges)[0] for one in spikes]) / BIN_S
    sd = rates.std(axis=0, ddof=1) if len(rates) > 1 else np.zeros(len(edges) - 1)
    name = f"{key[0]}, {key[1]:g} mm/s, {key[2]:g} g"
    return NeuronResponse(name, tuple(spikes), at_s, rates.mean(axis=0), sd)
