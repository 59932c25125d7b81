"""Constants, drives and state of the compiled kernel for one scheme.

One kernel serves live and offline (:mod:`rigctl.encoder.kernel.machine_code`). It takes integer
readings of a block of lanes (taxels, of one trial or of several side by side) at a time, goes
through time once and counts spikes.

The arithmetic is float64 in strict IEEE order: no fast-math, no reordering, and multiply and add
are fused exactly where the source says so. A fused multiply-add is rounded once, and IEEE 754
defines its every bit, so spikes are equal on every machine and for any slicing (a test compares
bits with exact rational arithmetic).

An Euler step h of dv/dt = αv² + βv + γ − u + I is computed in a normal form that needs three fused
operations where the textbook's order needs eleven. With p = (1 + hβ) / 2 and σ = h²ab::

    m = hαv + p                     membrane; threshold and reset value are mapped alike
    q = (h²αu + hbp) / σ            recovery, in the unit in which the membrane drives it
    w = drive·x + w0                drive = h²α·gain, w0 = p − p² + h²αγ + hbp
    m' = m·m + (w − σq)
    q' = (1 − ah)·q + m'

Where ab = 0 the membrane does not drive the recovery, and σ = 1. The low-pass filters the change of
the reading from sample to sample, which gives the change of the filtered reading::

    y = Δ + z1,  z1' = 2Δ + z2 − a1·y,  z2' = Δ − a2·y,  w = drive·b0·y + w0

Both are the same maps as the textbook's; only the last bits of the rounding differ. Schemes that
reset within the substep forget them, unless the last bit decides whether a neuron that hardly fires
does so. Schemes that reset at the next sample amplify them (v runs far beyond the threshold, and u
with it), so these keep v and u as they are and the published order, the low-pass included, with
every operation rounded::

    v' = v + h·((((α·(v·v) + β·v) + γ) − u) + w)        w = gain·x
    u' = u + step·(a·(b·v' − u))
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.kernel import neuron_step
from rigctl.encoder.kernel.machine_code import Kernel, compile_kernel
from rigctl.encoder.parameters import EncoderParameters, Recovery, Rectify, Reset
from rigctl.errors import WrongUse

Floats = NDArray[np.float64]

# Factor on a falling signal: max(slope, factor · slope) is the slope, its absolute value, or 0.
FALL_FACTORS = {Rectify.SIGNED: 1.0, Rectify.ABSOLUTE: -1.0, Rectify.RISING_ONLY: 0.0}

# A spike counter is a byte.
MAX_COUNT = 255


def has_late_reset(parameters: EncoderParameters) -> bool:
    """Return whether the scheme resets at the next sample, and so keeps the published order."""
    return parameters.reset is Reset.NEXT_SAMPLE


def max_samples_per_row(parameters: EncoderParameters) -> int:
    """Return the number of samples whose spikes one counter can hold."""
    return MAX_COUNT // parameters.substeps


def max_spikes_per_sample(parameters: EncoderParameters) -> int:
    """Return the largest possible number of spikes of a neuron in one sample."""
    return 1 if has_late_reset(parameters) else parameters.substeps


def _normal_form(p: EncoderParameters) -> tuple[float, float, float, float]:
    """Return (scale, shift) of the membrane, m = scale·v + shift, and of the recovery σq."""
    if has_late_reset(p):
        return 1.0, 0.0, 1.0, 0.0
    h = p.substep_ms
    scale, shift = h * p.quadratic, (1.0 + h * p.linear) / 2.0
    return scale, shift, scale * h, h * p.b * shift


def _sigma(p: EncoderParameters) -> float:
    """Return σ, the unit of the recovery."""
    product = p.substep_ms * p.substep_ms * p.a * p.b
    return 1.0 if has_late_reset(p) or product == 0.0 else product


def kernel_constants(parameters: EncoderParameters) -> Floats:
    """Return the kernel's constants, float64 (20,), indexed by names in ``neuron_step``."""
    return np.array(_kernel_constants(parameters))


@cache
def _kernel_constants(parameters: EncoderParameters) -> tuple[float, ...]:
    p, h, late = parameters, parameters.substep_ms, has_late_reset(parameters)
    scale, shift, recovery_scale, recovery_shift = _normal_form(p)
    b, a = butterworth(p.ra_lowpass_hz, p.sample_rate_hz)
    w0 = shift - shift * shift + recovery_scale * p.constant + recovery_shift
    normal = (
        0.0 if late else w0,
        1.0 - p.a * h,
        -_sigma(p),
        scale * p.threshold_mv + shift,
        scale * p.c_mv + shift,
        recovery_scale * p.d / _sigma(p),
    )
    feedback = a[1:] if late else [-x for x in a[1:]]
    ceiling = p.threshold_mv if p.clamp_v else math.inf
    textbook = (h, p.quadratic, p.linear, p.constant, p.a, p.b, h * p.substeps, ceiling)
    return (*normal, *b, *feedback, *textbook, FALL_FACTORS[p.ra_rectify])


def drives(parameters: EncoderParameters, scale: Floats, sa_scale: Floats) -> tuple[Floats, Floats]:
    """Return what a unit of the SA and of the RA signal adds to w, float64 (lanes,) each.

    ``scale``: 1 / (high − low) of each lane; ``sa_scale``: its factor on the SA current. The
    published schemes normalise the reading first, so their drives are the bare gains.
    """
    p, unit = parameters, np.ones_like(scale) if has_late_reset(parameters) else scale
    _, _, per_unit, _ = _normal_form(p)
    b, _ = butterworth(p.ra_lowpass_hz, p.sample_rate_hz)
    per_slope = per_unit * p.ra_change_gain * (1.0 if has_late_reset(p) else b[0])
    return per_unit * p.sa_gain * sa_scale * unit, per_slope * unit


def sa_constants(parameters: EncoderParameters) -> dict[str, float]:
    """Return the numbers of one SA neuron by name, for another implementation of the normal form.

    ``drive`` is that of a taxel whose range is one count wide. Raises WrongUse for a scheme with
    another order of operations.
    """
    if has_late_reset(parameters) or parameters.recovery is not Recovery.NEW_V:
        raise WrongUse(f"encoder preset {parameters.name!r}: give one with the default's order")
    k, rest = kernel_constants(parameters), rest_state(parameters, 1)
    one = np.ones(1)
    return {
        "input_at_rest": float(k[neuron_step.W0]),
        "drive": float(drives(parameters, one, one)[0][0]),
        "coupling": float(k[neuron_step.COUPLING]),
        "decay": float(k[neuron_step.DECAY]),
        "threshold": float(k[neuron_step.THRESHOLD]),
        "reset_to": float(k[neuron_step.RESET_TO]),
        "jump": float(k[neuron_step.JUMP]),
        "rest_membrane": float(rest[neuron_step.M, 0]),
        "rest_recovery": float(rest[neuron_step.Q, 0]),
    }


@cache
def butterworth(cutoff_hz: float, rate_hz: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return numerator and denominator of the second-order low-pass, three coefficients each.

    The bilinear transform with the cut-off prewarped, as SciPy designs it (a test compares; its
    signal package takes seconds to import). Rounded to 15 decimals, so that another machine's
    tangent gives the same filter.
    """
    c = 1.0 / math.tan(math.pi * cutoff_hz / rate_hz)
    norm = 1.0 + math.sqrt(2.0) * c + c * c
    numerator = (1.0 / norm, 2.0 / norm, 1.0 / norm)
    denominator = (1.0, 2.0 * (1.0 - c * c) / norm, (1.0 - math.sqrt(2.0) * c + c * c) / norm)
    return tuple(round(x, 15) for x in numerator), tuple(round(x, 15) for x in denominator)


def rest_state(parameters: EncoderParameters, lanes: int) -> Floats:
    """Return the state of neurons at rest, float64 (7, lanes), before :func:`start_filter`."""
    scale, shift, recovery_scale, recovery_shift = _normal_form(parameters)
    state = np.zeros((neuron_step.STATE_ROWS, lanes))
    q = (recovery_scale * parameters.start_u + recovery_shift) / _sigma(parameters)
    state[neuron_step.M] = state[neuron_step.M_RA] = scale * parameters.start_v_mv + shift
    state[neuron_step.Q] = state[neuron_step.Q_RA] = q
    return state


def start_filter(parameters: EncoderParameters, x: Floats, scale: Floats, state: Floats) -> None:
    """Put the low-pass into the steady state of the first sample, so that it does not ring.

    ``x``: first reading of each lane minus its low end, float64 (lanes,). ``LAST`` is what the
    kernel computes for this sample, so the first difference is exactly 0.
    """
    if not has_late_reset(parameters):
        state[neuron_step.Z1], state[neuron_step.Z2], state[neuron_step.LAST] = 0.0, 0.0, x
        return
    b, a = butterworth(parameters.ra_lowpass_hz, parameters.sample_rate_hz)
    level = x * scale
    state[neuron_step.Z2] = (b[2] - a[2]) * level
    state[neuron_step.Z1] = (b[1] - a[1]) * level + state[neuron_step.Z2]
    state[neuron_step.LAST] = b[0] * level + state[neuron_step.Z1]


def membrane_mv(parameters: EncoderParameters, membrane: Floats) -> Floats:
    """Return the membrane voltage in mV from the kernel's normal form, same shape."""
    scale, shift, _, _ = _normal_form(parameters)
    voltage: Floats = (membrane - shift) / scale
    return voltage


def kernel_for(
    parameters: EncoderParameters,
    *,
    sa_only: bool = False,
    trains: bool = False,
) -> Kernel:
    """Return the compiled kernel of a scheme; its numbers come from :func:`kernel_constants`.

    Call it as ``kernel(addresses, lengths, row_bytes, low, width, scale, sa_drive, ra_drive,
    constants, state, ends, out)``, all contiguous, lanes in blocks of 32 (64 of SA alone).
    addresses: int64 (lanes,), address of each lane's first reading, the next row_bytes further;
    lengths: int64 (lanes,), number of readings.
    low, width: uint16 (lanes,); scale, sa_drive, ra_drive: float64 (lanes,). state: from
    :func:`rest_state`, changed in place. ends: int64 (rows,), ascending; spikes before sample
    ends[0] go to row 0, those from there to ends[1] to row 1 and so on. The longest length in each
    block must be among them, the longest of all the last, and no row may hold more samples than
    :func:`max_samples_per_row`. out: uint8 (blocks, rows, channels, 32 or 64), written up to the
    end of each block; two channels, SA and RA, or SA alone. If ``trains``, the kernel ignores ends,
    writes words of 64 samples to out as
    :func:`rigctl.encoder.kernel.transpose_bits.transpose_words` does, and returns the most spikes
    in one sample of any lane, ended or not. Releases the GIL.
    """
    return compile_kernel(
        substeps=parameters.substeps,
        old_v=parameters.recovery is Recovery.OLD_V,
        coupled=parameters.a * parameters.b != 0.0,
        late_reset=has_late_reset(parameters),
        signed=parameters.ra_rectify is Rectify.SIGNED,
        sa_only=sa_only,
        trains=trains,
    )
