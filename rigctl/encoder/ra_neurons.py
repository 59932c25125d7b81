"""RA neurons of whole trials, for filters that the kernel cannot compute sample by sample.

The neurons are those of the kernel in the textbook's order of operations. This path is for offline
comparisons: it is an order of magnitude slower than the kernel.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.kernel import TrialViews, trial_readings
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters, Recovery, Reset
from rigctl.encoder.ra_filter import ra_signals
from rigctl.values import Spikes

Floats = NDArray[np.float64]


class RaResponse(NamedTuple):
    """Spikes of each sample, uint8, and the membrane after it in mV, float64, (n, n_taxels)."""

    spikes: NDArray[np.uint8]
    membrane_mv: Floats


def ra_response(
    samples: NDArray[np.uint16], normalisation: Normalisation, parameters: EncoderParameters
) -> RaResponse:
    """Return spikes and membranes of the RA neurons of one trial, encoded from rest.

    ``samples``: uint16 (n, n_taxels).
    """
    current = ra_signals(normalisation.apply(samples), parameters).current
    spikes = np.empty(current.shape, np.uint8)
    membrane = np.empty(current.shape)
    _respond_compiled(current, _numbers(parameters), *_scheme(parameters), spikes, membrane)
    return RaResponse(spikes, membrane)


def count_ra_spikes(
    views: TrialViews,
    bin_edges: NDArray[np.int64],
    normalisation: Normalisation,
    parameters: EncoderParameters,
    taxels: NDArray[np.int64],
) -> NDArray[np.uint32]:
    """Return the RA spikes in each bin, uint32 (n_trials, taxels, n_bins)."""
    counts = np.empty((len(views), len(taxels), len(bin_edges) - 1), np.uint32)
    selected = Normalisation(normalisation.low[taxels], normalisation.high[taxels])
    for i, (address, length) in enumerate(zip(views.addresses, views.lengths, strict=True)):
        samples = np.empty((int(length), normalisation.n_taxels), np.uint16)
        _copy_compiled(address, samples)
        spikes = ra_response(samples[:, taxels], selected, parameters).spikes
        total = np.zeros((length + 1, len(taxels)), np.uint32)
        np.cumsum(spikes, axis=0, out=total[1:])
        counts[i] = np.diff(total[np.minimum(bin_edges, length)], axis=0).T
    return counts


def with_ra_trains(
    spikes: Spikes,
    samples: NDArray[np.uint16],
    normalisation: Normalisation,
    parameters: EncoderParameters,
) -> Spikes:
    """Return the SA trains of a trial's spikes with the RA trains of these parameters."""
    n_taxels = normalisation.n_taxels
    counts = ra_response(samples, normalisation, parameters).spikes.T
    trains = [np.repeat(np.arange(len(row), dtype=np.int32), row) for row in counts]
    trains = [spikes.train(row) for row in range(n_taxels)] + trains
    return Spikes.from_trains(trains, spikes.n_samples)


def _numbers(p: EncoderParameters) -> tuple[float, ...]:
    neuron = (p.a, p.b, p.c_mv, p.d, p.quadratic, p.linear, p.constant, p.threshold_mv)
    return (*neuron, p.start_v_mv, p.start_u, p.substep_ms)


def _scheme(p: EncoderParameters) -> tuple[int, bool, bool, bool]:
    late, old_v = p.reset is Reset.NEXT_SAMPLE, p.recovery is Recovery.OLD_V
    return p.substeps, late, old_v, p.clamp_v


def _copy(address: Any, out: Any) -> None:
    out[:] = trial_readings(address, out.shape[0], out.shape[1])


def _respond(
    current: Any, numbers: Any, substeps: Any, late: Any, old_v: Any, clamp: Any,
    spikes: Any, membrane: Any,
) -> None:  # fmt: skip
    """Compute spikes and membranes, neuron after neuron in each sample."""
    a, b, c, d, quadratic, linear, constant, threshold, start_v, start_u, h = numbers
    v, u = np.full(current.shape[1], start_v), np.full(current.shape[1], start_u)
    for t in range(current.shape[0]):
        for j in range(current.shape[1]):
            fired = 0
            if late and v[j] >= threshold:
                v[j], u[j] = c, u[j] + d
            for _ in range(substeps):
                old = v[j]
                rise = quadratic * (old * old) + linear * old + constant - u[j]
                v[j] = old + h * (rise + current[t, j])
                if not late:
                    u[j] += h * a * (b * (old if old_v else v[j]) - u[j])
                    if v[j] >= threshold:
                        v[j], u[j], fired = c, u[j] + d, fired + 1
            if late:
                fired = 1 if v[j] >= threshold else 0
                v[j] = min(v[j], threshold) if clamp else v[j]
                u[j] += h * substeps * (a * (b * v[j] - u[j]))
            spikes[t, j], membrane[t, j] = fired, v[j]


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_copy_compiled, _respond_compiled = _compile(_copy), _compile(_respond)
