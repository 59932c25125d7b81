"""The encoder's parameters as one frozen value, and its named presets.

The neuron is Izhikevich's (IEEE Trans. Neural Networks 14, 2003, eq. 1–3) in the tonic-spiking
setting. The equations leave the integration scheme open, and the scheme changes the rates, so each
published scheme has its own preset; ``docs/reference/encoding.md`` shows their rates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from math import isfinite

from rigctl.encoder.reading import Reading
from rigctl.errors import WrongUse

MAX_SUBSTEPS = 64
MAX_RA_ORDER = 8
KERNEL_RA_ORDER = 2
"""Order of the low-pass that the compiled kernel computes sample by sample."""


class Recovery(StrEnum):
    """The membrane voltage from which a substep computes the recovery variable u."""

    NEW_V = "new-v"
    OLD_V = "old-v"


class Reset(StrEnum):
    """When a neuron that crossed the threshold is reset."""

    SAME_SUBSTEP = "same-substep"
    NEXT_SAMPLE = "next-sample"


class Rectify(StrEnum):
    """How the RA channel treats a falling signal."""

    SIGNED = "signed"
    ABSOLUTE = "absolute"
    RISING_ONLY = "rising-only"


class RaFilter(StrEnum):
    """The RA channel's low-pass. The paper gives its 20 Hz and nothing else."""

    CAUSAL = "causal"  # Butterworth, forward
    ZERO_PHASE = "zero-phase"  # Butterworth, forward and backward
    LINEAR_PHASE = "linear-phase"  # Kaiser window, pass band to the cut-off, delay compensated


class RaDerivative(StrEnum):
    """The unit of time of the RA channel's derivative."""

    PER_SECOND = "per-second"
    PER_SAMPLE = "per-sample"


@dataclass(frozen=True, slots=True)
class EncoderParameters:
    """Every number that decides the time of a spike.

    ``a`` (1/ms), ``b``, ``c_mv``, ``d``: the neuron's four parameters. ``quadratic``, ``linear``,
    ``constant``: dv/dt = quadratic·v² + linear·v + constant − u + k·input, v in mV, t in ms.
    Each sample takes ``substeps`` Euler steps of ``substep_ms`` with constant input.
    With ``reset`` at the next sample, u changes once a sample and a sample has at most one spike;
    ``clamp_v`` then limits v to the threshold before u uses it.
    ``reading``: the quantity of the samples and of the taxel ranges.
    ``sa_gain`` multiplies the normalised reading (0–1); ``ra_gain`` its low-passed derivative
    (``ra_lowpass_hz``, ``ra_filter``, ``ra_order``) by ``ra_derivative``. The linear-phase filter
    has no order.
    Raises :class:`WrongUse` for impossible values.
    """

    name: str = "default"
    a: float = 0.02
    b: float = 0.2
    c_mv: float = -65.0
    d: float = 6.0
    quadratic: float = 0.04
    linear: float = 5.0
    constant: float = 140.0
    threshold_mv: float = 30.0
    start_v_mv: float = -70.0
    start_u: float = -14.0
    substeps: int = 4
    substep_ms: float = 0.25
    recovery: Recovery = Recovery.NEW_V
    reset: Reset = Reset.SAME_SUBSTEP
    clamp_v: bool = False
    sa_gain: float = 100.0
    ra_gain: float = 3.0
    ra_lowpass_hz: float = 20.0
    ra_rectify: Rectify = Rectify.SIGNED
    ra_filter: RaFilter = RaFilter.CAUSAL
    ra_order: int = KERNEL_RA_ORDER
    ra_derivative: RaDerivative = RaDerivative.PER_SECOND
    sample_rate_hz: float = 1000.0
    reading: Reading = Reading.COUNTS

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            if isinstance(value, float) and not isfinite(value):
                raise WrongUse(f"encoder parameter {key} is {value}: give a finite number")
        if not 1 <= self.substeps <= MAX_SUBSTEPS:
            raise WrongUse(f"encoder parameter substeps must be 1–{MAX_SUBSTEPS}")
        if self.substep_ms <= 0 or self.sample_rate_hz <= 0:
            raise WrongUse("encoder parameters substep_ms and sample_rate_hz must be above 0")
        if not 0 < self.ra_lowpass_hz < self.sample_rate_hz / 2:
            raise WrongUse("encoder parameter ra_lowpass_hz must be below half the sample rate")
        if not 1 <= self.ra_order <= MAX_RA_ORDER:
            raise WrongUse(f"encoder parameter ra_order must be 1–{MAX_RA_ORDER}")
        if self.c_mv >= self.threshold_mv:
            raise WrongUse("encoder parameter c_mv must be below threshold_mv")
        if self.reset is Reset.NEXT_SAMPLE and self.recovery is Recovery.OLD_V:
            raise WrongUse("encoder: reset at the next sample needs recovery from the new v")

    @property
    def filters_whole_trials(self) -> bool:
        """Whether the RA filter is another than the kernel's, and so needs whole trials."""
        return self.ra_filter is not RaFilter.CAUSAL or self.ra_order != KERNEL_RA_ORDER

    @property
    def ra_change_gain(self) -> float:
        """Factor on the change of the low-passed reading from one sample to the next, mV/ms."""
        per_sample = self.ra_derivative is RaDerivative.PER_SAMPLE
        return self.ra_gain if per_sample else self.ra_gain * self.sample_rate_hz

    def as_dict(self) -> dict[str, str | float | int | bool]:
        """Return all parameters by name as plain values, to store beside a result."""
        plain = asdict(self)
        return {k: str(v) if isinstance(v, StrEnum) else v for k, v in plain.items()}

    @classmethod
    def from_dict(cls, values: dict[str, str | float | int | bool]) -> EncoderParameters:
        """Return parameters from :meth:`as_dict`. Raises WrongUse for an unknown name or word."""
        unknown = sorted(set(values) - set(cls.__dataclass_fields__))
        if unknown:
            raise WrongUse(f"unknown encoder parameter {unknown[0]!r}")
        enums = {
            "recovery": Recovery,
            "reset": Reset,
            "ra_rectify": Rectify,
            "ra_filter": RaFilter,
            "ra_derivative": RaDerivative,
            "reading": Reading,
        }
        typed: dict[str, object] = dict(values)
        for key, enum in enums.items():
            if key in typed:
                typed[key] = _parse_enum(key, enum, str(typed[key]))
        return replace(DEFAULT, **typed)  # type: ignore[arg-type]  # __post_init__ checks them


def _parse_enum(key: str, enum: type[StrEnum], value: str) -> StrEnum:
    try:
        return enum(value)
    except ValueError:
        allowed = ", ".join(enum)
        raise WrongUse(f"encoder parameter {key} is {value!r}: give one of {allowed}") from None


DEFAULT = EncoderParameters()
LIF = replace(
    DEFAULT,
    name="lif",
    b=0.0,
    c_mv=-70.0,
    d=0.0,
    quadratic=0.0,
    linear=-1 / 50,
    constant=-70 / 50,
    threshold_mv=-50.0,
    start_u=0.0,
    reset=Reset.NEXT_SAMPLE,
    sa_gain=8.0,
    ra_gain=0.24,
)
"""A leaky integrator of 50 ms, 20 mV below its threshold at rest."""
PRESETS: dict[str, EncoderParameters] = {
    "default": DEFAULT,
    # v and u both from the old state: plain forward Euler, as Brian2's "euler" integrates it.
    "explicit": replace(DEFAULT, name="explicit", recovery=Recovery.OLD_V),
    # The listing in Izhikevich 2003: two half-steps of v, one step of u, reset a step later.
    "izhikevich2003": replace(
        DEFAULT, name="izhikevich2003", substeps=2, substep_ms=0.5, reset=Reset.NEXT_SAMPLE
    ),
    # One step of 1 ms, v limited to 30 mV, reset a step later.
    "iskarous2022": replace(
        DEFAULT,
        name="iskarous2022",
        substeps=1,
        substep_ms=1.0,
        reset=Reset.NEXT_SAMPLE,
        clamp_v=True,
    ),
    # Model time runs at a quarter of real time.
    "quarter-rate": replace(DEFAULT, name="quarter-rate", substeps=1),
    # Other neurons in the same equations: without the quadratic term, the membrane is a leaky
    # integrator, and u is an adaptation current that each spike raises by d.
    "lif": LIF,
    "adaptive-lif": replace(LIF, name="adaptive-lif", a=0.01, d=0.1),
    # Other readings of "smoothed with a 20 Hz lowpass filter and then differentiated": MATLAB's
    # filtfilt, other orders, MATLAB's lowpass, diff without a sample time, changes of either sign.
    "ra-zero-phase": replace(DEFAULT, name="ra-zero-phase", ra_filter=RaFilter.ZERO_PHASE),
    "ra-first-order": replace(DEFAULT, name="ra-first-order", ra_order=1),
    "ra-fourth-order": replace(DEFAULT, name="ra-fourth-order", ra_order=4),
    "ra-linear-phase": replace(DEFAULT, name="ra-linear-phase", ra_filter=RaFilter.LINEAR_PHASE),
    "ra-per-sample": replace(DEFAULT, name="ra-per-sample", ra_derivative=RaDerivative.PER_SAMPLE),
    "ra-absolute": replace(DEFAULT, name="ra-absolute", ra_rectify=Rectify.ABSOLUTE),
}
SA_PRESETS = ("default", "explicit", "izhikevich2003", "iskarous2022", "quarter-rate")
"""The presets that differ in how Izhikevich's neuron is integrated."""
MODEL_PRESETS = ("lif", "adaptive-lif")
"""The presets of another neuron; all others are readings of the RA channel."""


def preset(name: str) -> EncoderParameters:
    """Return the preset of that name. Raises WrongUse with the existing names."""
    if name not in PRESETS:
        raise WrongUse(f"unknown encoder preset {name!r}: choose one of {', '.join(PRESETS)}")
    return PRESETS[name]


def override(base: EncoderParameters, settings: Sequence[str]) -> EncoderParameters:
    """Return a preset with other values, each as ``name=value``; its name lists them.

    Raises WrongUse for an unknown name, or a value of another type.
    """
    values, name_parts = base.as_dict(), [base.name]
    for setting in settings:
        key, separator, text = setting.partition("=")
        if not separator or key not in values or key == "name":
            names = ", ".join(name for name in values if name != "name")
            raise WrongUse(f"encoder parameter {setting!r}: give name=value with one of {names}")
        values[key] = _parse_value(key, text, values[key])
        name_parts.append(f"{key}={values[key]}")
    return EncoderParameters.from_dict({**values, "name": ", ".join(name_parts)})


def _parse_value(key: str, text: str, like: str | float | int | bool) -> str | float | int | bool:
    if isinstance(like, str):
        return text
    if isinstance(like, bool):
        if text not in ("true", "false"):
            raise WrongUse(f"encoder parameter {key} is {text!r}: give true or false")
        return text == "true"
    kind, noun = (int, "a whole number") if isinstance(like, int) else (float, "a number")
    try:
        return kind(text)
    except ValueError:
        raise WrongUse(f"encoder parameter {key} is {text!r}: give {noun}") from None
