"""The compiled neuron kernel: integer readings in, spike counts out, one time step after another.

One kernel serves live and offline. It walks through time once; in each sample all lanes (taxels,
of one trial or of several side by side) are advanced together, so that the inner loops run over
contiguous lanes without branches and the compiler can vectorise them.

The arithmetic is float64 in strict IEEE order: no fast-math, and without it LLVM neither
reorders nor fuses multiply and add (a test compares bits with plain Python). So spikes are equal
on every machine and for any slicing.

An Euler step h of dv/dt = αv² + βv + γ − u + I is carried out in its normal form, which needs one
multiplication where the textbook's order needs three. With p = (1 + hβ) / 2::

    m = hαv + p                     the membrane: threshold and reset value are mapped alike
    s = h²αu + hbp                  the recovery: the shift takes the constant out of its step
    w = drive·x + w0                drive = h²α·gain, w0 = p − p² + h²αγ + hbp
    m' = m·m + (w − s)
    s' = (1 − ah)·s + h²ab·m'

It is the same map as the textbook's; only the last bits of the rounding differ, and the schemes
that reset within the substep forget them. Those that reset at the next sample amplify them (v runs
far beyond the threshold, and u with it), so these keep v and u as they are and the order in which
they were published::

    v' = v + h·((((α·(v·v) + β·v) + γ) − u) + w)        w = gain·x
    u' = u + step·(a·(b·v' − u))
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.presets import EncoderParameters, Recovery, Rectify, Reset

Kernel = Callable[..., None]


# Rows of the state array, float64 (STATE_ROWS, 2, lanes): SA in [.., 0, :], RA in [.., 1, :].
# The filter's rows use the RA half only.
MEMBRANE, RECOVERY, Z1, Z2, LAST = range(5)
STATE_ROWS = 5

# Positions in the vector of folded constants.
W0, KEEP, PULL, THRESHOLD, RESET_TO, JUMP = range(6)
B0, B1, B2, A1, A2 = range(6, 11)
H, QUADRATIC, LINEAR, CONSTANT, A_U, B_U, U_STEP, CEILING = range(11, 19)
SUBSTEPS, FALL = 19, 20

# What a falling signal counts: max(slope, FALL · slope) is the slope, its size, or 0.
FALLS = {Rectify.SIGNED: 1.0, Rectify.ABSOLUTE: -1.0, Rectify.RISING_ONLY: 0.0}


def _normal_form(p: EncoderParameters) -> tuple[float, float, float, float]:
    """(scale, shift) of the membrane, m = scale·v + shift, and of the recovery likewise."""
    if p.reset is Reset.NEXT_SAMPLE:
        return 1.0, 0.0, 1.0, 0.0
    h = p.substep_ms
    scale, shift = h * p.quadratic, (1.0 + h * p.linear) / 2.0
    return scale, shift, scale * h, h * p.b * shift


def folded(parameters: EncoderParameters) -> NDArray[np.float64]:
    """The kernel's constants, float64 (21,), in the order of the position names above."""
    p, h = parameters, parameters.substep_ms
    late = p.reset is Reset.NEXT_SAMPLE
    scale, shift, recovery_scale, recovery_shift = _normal_form(p)
    b, a = butterworth(p.ra_lowpass_hz, p.sample_rate_hz)
    w0 = shift - shift * shift + recovery_scale * p.constant + recovery_shift
    normal = (
        0.0 if late else w0,
        1.0 - p.a * h,
        h * h * p.a * p.b,
        scale * p.threshold_mv + shift,
        scale * p.c_mv + shift,
        recovery_scale * p.d,
    )
    ceiling = p.threshold_mv if p.clamp_v else math.inf
    textbook = (h, p.quadratic, p.linear, p.constant, p.a, p.b, h * p.substeps, ceiling)
    return np.array((*normal, *b, *a[1:], *textbook, p.substeps, FALLS[p.ra_rectify]))


def drives(parameters: EncoderParameters) -> tuple[float, float]:
    """What one unit of the SA signal and of the RA difference per sample adds to w."""
    p = parameters
    _, _, per_unit, _ = _normal_form(p)
    return per_unit * p.sa_gain, per_unit * (p.ra_gain * p.sample_rate_hz)


def butterworth(cutoff_hz: float, rate_hz: float) -> tuple[list[float], list[float]]:
    """Numerator and denominator of the second-order low-pass, three coefficients each.

    The bilinear transform with the cut-off prewarped, as SciPy designs it (a test compares; its
    signal package takes seconds to import). Rounded to 15 decimals, so that another machine's
    tangent gives the same filter.
    """
    c = 1.0 / math.tan(math.pi * cutoff_hz / rate_hz)
    norm = 1.0 + math.sqrt(2.0) * c + c * c
    numerator = (1.0 / norm, 2.0 / norm, 1.0 / norm)
    denominator = (1.0, 2.0 * (1.0 - c * c) / norm, (1.0 - math.sqrt(2.0) * c + c * c) / norm)
    return [round(x, 15) for x in numerator], [round(x, 15) for x in denominator]


def rest(parameters: EncoderParameters, lanes: int) -> NDArray[np.float64]:
    """State of neurons at rest, float64 (STATE_ROWS, 2, lanes); the filter is still to start."""
    scale, shift, recovery_scale, recovery_shift = _normal_form(parameters)
    state = np.zeros((STATE_ROWS, 2, lanes))
    state[MEMBRANE] = scale * parameters.start_v_mv + shift
    state[RECOVERY] = recovery_scale * parameters.start_u + recovery_shift
    return state


def membrane_mv(
    parameters: EncoderParameters, membrane: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Membrane voltage in mV from the kernel's normal form, same shape."""
    scale, shift, _, _ = _normal_form(parameters)
    voltage: NDArray[np.float64] = (membrane - shift) / scale
    return voltage


def _start_filter(
    first: NDArray[np.uint16],
    low: NDArray[np.uint16],
    high: NDArray[np.uint16],
    scale: NDArray[np.float64],
    k: NDArray[np.float64],
    state: NDArray[np.float64],
) -> None:
    """Put the low-pass into the steady state of the first sample, so that nothing rings.

    ``LAST`` is what the kernel will compute for this sample, so the first difference is 0 exactly.
    """
    for j in range(first.shape[0]):
        reading = min(max(first[j], low[j]), high[j])
        x = np.float64(np.int32(reading) - np.int32(low[j])) * scale[j]
        state[Z2, 1, j] = (k[B2] - k[A2]) * x
        state[Z1, 1, j] = (k[B1] - k[A1]) * x + state[Z2, 1, j]
        state[LAST, 1, j] = k[B0] * x + state[Z1, 1, j]


start_filter: Kernel = numba.njit(cache=True, nogil=True, error_model="numpy")(_start_filter)


def kernel_for(parameters: EncoderParameters, *, traced: bool = False) -> Kernel:
    """The compiled kernel of a scheme; the numbers of the scheme go in through :func:`folded`.

    Called as ``kernel(samples, low, high, scale, sa_drive, ra_drive, constants, state, counts,
    trace)``, all contiguous: samples uint16 (n, lanes); low, high uint16 (lanes,); scale float64
    (lanes,), 1 / (high − low); sa_drive, ra_drive float64 (lanes,); state as from :func:`rest`,
    changed in place; counts uint8 (n, 2·lanes), written; trace float64 (n, 2·lanes), written if
    ``traced`` with the membrane after each sample, the threshold where it spiked.
    Releases the GIL.
    """
    old_v = parameters.recovery is Recovery.OLD_V
    return _compiled(old_v, parameters.reset is Reset.NEXT_SAMPLE, traced)


@cache
def _compiled(old_v: bool, late: bool, traced: bool) -> Kernel:
    """Compile one scheme. The arguments are constants of the compiled code, not run-time tests."""

    # One long function on purpose: numba keeps closures over plain numbers in its disk cache,
    # and the state must live in arrays of this frame for LLVM to know that they do not overlap.
    def advance(
        samples: Any,
        low: Any,
        high: Any,
        scale: Any,
        sa_drive: Any,
        ra_drive: Any,
        k: Any,
        state: Any,
        counts: Any,
        trace: Any,
    ) -> None:
        n, lanes = samples.shape
        both = 2 * lanes
        w0, keep, pull = k[W0], k[KEEP], k[PULL]
        threshold, reset_to, jump = k[THRESHOLD], k[RESET_TO], k[JUMP]
        b0, b1, b2, a1, a2 = k[B0], k[B1], k[B2], k[A1], k[A2]
        h, quadratic, linear, constant = k[H], k[QUADRATIC], k[LINEAR], k[CONSTANT]
        a_u, b_u, u_step, ceiling = k[A_U], k[B_U], k[U_STEP], k[CEILING]
        substeps, fall = int(k[SUBSTEPS]), k[FALL]
        m, s, w, fired = np.empty(both), np.empty(both), np.empty(both), np.empty(both)
        z1, z2, last = np.empty(lanes), np.empty(lanes), np.empty(lanes)
        w_ra = np.empty(lanes)
        for j in range(lanes):
            m[j], m[lanes + j] = state[MEMBRANE, 0, j], state[MEMBRANE, 1, j]
            s[j], s[lanes + j] = state[RECOVERY, 0, j], state[RECOVERY, 1, j]
            z1[j], z2[j], last[j] = state[Z1, 1, j], state[Z2, 1, j], state[LAST, 1, j]
        for t in range(n):
            row = samples[t]
            for j in range(lanes):
                reading = min(max(row[j], low[j]), high[j])
                x = np.float64(np.int32(reading) - np.int32(low[j])) * scale[j]
                w[j] = sa_drive[j] * x + w0
                y = b0 * x + z1[j]
                z1[j] = (z2[j] + b1 * x) - a1 * y
                z2[j] = b2 * x - a2 * y
                slope = y - last[j]
                last[j] = y
                w_ra[j] = ra_drive[j] * max(slope, fall * slope) + w0
            for j in range(lanes):
                w[lanes + j] = w_ra[j]
            for i in range(both):
                fired[i] = 0.0
                if late:
                    spent = m[i] >= threshold
                    m[i] = reset_to if spent else m[i]
                    s[i] = s[i] + (jump if spent else 0.0)
            for _ in range(substeps):
                for i in range(both):
                    before = m[i]
                    if late:
                        rise = (quadratic * (before * before) + linear * before) + constant
                        m[i] = before + h * ((rise - s[i]) + w[i])
                    else:
                        after = before * before + (w[i] - s[i])
                        recovery = keep * s[i] + pull * (before if old_v else after)
                        crossed = after >= threshold
                        m[i] = reset_to if crossed else after
                        s[i] = recovery + (jump if crossed else 0.0)
                        fired[i] += 1.0 if crossed else 0.0
            for i in range(both):
                if late:
                    fired[i] = 1.0 if m[i] >= threshold else 0.0
                    m[i] = min(m[i], ceiling)
                    s[i] = s[i] + u_step * (a_u * (b_u * m[i] - s[i]))
            row_counts = counts[t]
            for i in range(both):
                row_counts[i] = np.uint8(fired[i])
            if traced:
                row_trace = trace[t]
                for i in range(both):
                    row_trace[i] = threshold if fired[i] > 0.0 else m[i]
        for j in range(lanes):
            state[MEMBRANE, 0, j], state[MEMBRANE, 1, j] = m[j], m[lanes + j]
            state[RECOVERY, 0, j], state[RECOVERY, 1, j] = s[j], s[lanes + j]
            state[Z1, 1, j], state[Z2, 1, j], state[LAST, 1, j] = z1[j], z2[j], last[j]

    compile_advance = numba.njit(
        cache=True, nogil=True, fastmath=False, error_model="numpy", boundscheck=False
    )
    kernel: Kernel = compile_advance(advance)
    return kernel
