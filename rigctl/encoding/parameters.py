"""The encoder's parameters as one frozen value, and the named presets of it.

The neuron is Izhikevich's (IEEE Trans. Neural Networks 14, 2003, eq. 1–3) in the tonic-spiking
setting. The equations leave the integration scheme open and the scheme changes the rates, so
each published scheme has a preset of its own; ``docs/reference/encoding.md`` shows their rates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from math import isfinite

from rigctl.errors import WrongUse

MAX_SUBSTEPS = 64


class Recovery(StrEnum):
    """Which membrane voltage a substep's recovery variable u is computed from."""

    NEW_V = "new-v"
    OLD_V = "old-v"


class Reset(StrEnum):
    """When a neuron that crossed threshold is reset."""

    SAME_SUBSTEP = "same-substep"
    NEXT_SAMPLE = "next-sample"


class Rectify(StrEnum):
    """What the RA channel makes of a falling signal."""

    SIGNED = "signed"
    ABSOLUTE = "absolute"
    RISING_ONLY = "rising-only"


@dataclass(frozen=True, slots=True)
class EncoderParameters:
    """Every number that decides where a spike falls.

    ``a`` (1/ms), ``b``, ``c_mv``, ``d``: the neuron's four parameters. ``quadratic``, ``linear``,
    ``constant``: dv/dt = quadratic·v² + linear·v + constant − u + k·input, v in mV, t in ms.
    ``substeps`` Euler steps of ``substep_ms`` are made for each sample with the input held.
    With ``reset`` at the next sample, u moves once a sample and a sample holds one spike at most;
    ``clamp_v`` then cuts v off at the threshold before u sees it.
    ``sa_gain`` multiplies the normalised reading (0–1); ``ra_gain`` its low-passed derivative
    per second (``ra_lowpass_hz``, causal Butterworth of second order).
    Raises :class:`WrongUse` for values that no neuron can have.
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
    sample_rate_hz: float = 1000.0

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            if isinstance(value, float) and not isfinite(value):
                raise WrongUse(f"encoder parameter {key} is {value}: give a finite number")
        if not 1 <= self.substeps <= MAX_SUBSTEPS:
            raise WrongUse(f"encoder parameter substeps must be 1–{MAX_SUBSTEPS}")
        if self.substep_ms <= 0 or self.sample_rate_hz <= 0:
            raise WrongUse("encoder parameters substep_ms and sample_rate_hz must be above 0")
        if not 0 < self.ra_lowpass_hz < self.sample_rate_hz / 2:
            raise WrongUse("encoder parameter ra_lowpass_hz must lie below half the sample rate")
        if self.c_mv >= self.threshold_mv:
            raise WrongUse("encoder parameter c_mv must lie below threshold_mv")
        if self.reset is Reset.NEXT_SAMPLE and self.recovery is Recovery.OLD_V:
            raise WrongUse("encoder: reset at the next sample goes with recovery from the new v")

    def as_dict(self) -> dict[str, str | float | int | bool]:
        """All parameters by name as plain values, to be stored beside a result."""
        plain = asdict(self)
        return {k: str(v) if isinstance(v, StrEnum) else v for k, v in plain.items()}

    @classmethod
    def from_dict(cls, values: dict[str, str | float | int | bool]) -> EncoderParameters:
        """The inverse of :meth:`as_dict`. Raises WrongUse for an unknown name or word."""
        unknown = sorted(set(values) - set(cls.__dataclass_fields__))
        if unknown:
            raise WrongUse(f"unknown encoder parameter {unknown[0]!r}")
        words = {"recovery": Recovery, "reset": Reset, "ra_rectify": Rectify}
        typed: dict[str, object] = dict(values)
        for key, kind in words.items():
            if key in typed:
                typed[key] = _word(key, kind, str(typed[key]))
        return replace(DEFAULT, **typed)  # type: ignore[arg-type]  # __post_init__ checks them


def _word(key: str, kind: type[StrEnum], value: str) -> StrEnum:
    try:
        return kind(value)
    except ValueError:
        allowed = ", ".join(kind)
        raise WrongUse(f"encoder parameter {key} is {value!r}: give one of {allowed}") from None


DEFAULT = EncoderParameters()
PRESETS: dict[str, EncoderParameters] = {
    "default": DEFAULT,
    # v and u both from the old state: plain forward Euler, as Brian2's "euler" integrates it.
    "explicit": replace(DEFAULT, name="explicit", recovery=Recovery.OLD_V),
    # The listing in Izhikevich 2003: two half-steps of v, one step of u, reset a step later.
    "izhikevich2003": replace(
        DEFAULT, name="izhikevich2003", substeps=2, substep_ms=0.5, reset=Reset.NEXT_SAMPLE
    ),
    # One step of 1 ms, v cut off at 30 mV, reset a step later.
    "iskarous2022": replace(
        DEFAULT,
        name="iskarous2022",
        substeps=1,
        substep_ms=1.0,
        reset=Reset.NEXT_SAMPLE,
        clamp_v=True,
    ),
    # The neuron lives a quarter of the time that passes.
    "quarter-rate": replace(DEFAULT, name="quarter-rate", substeps=1),
}


def preset(name: str) -> EncoderParameters:
    """The preset of that name. Raises WrongUse with the names there are."""
    if name not in PRESETS:
        raise WrongUse(f"unknown encoder preset {name!r}: choose one of {', '.join(PRESETS)}")
    return PRESETS[name]


def changed(base: EncoderParameters, settings: Sequence[str]) -> EncoderParameters:
    """A preset with some numbers of its own, each as ``name=value``; its name tells them.

    Raises WrongUse for an unknown name, or a value of another kind.
    """
    plain, said = base.as_dict(), [base.name]
    for setting in settings:
        key, found, text = setting.partition("=")
        if not found or key not in plain or key == "name":
            known = ", ".join(name for name in plain if name != "name")
            raise WrongUse(f"encoder parameter {setting!r}: give name=value with one of {known}")
        plain[key] = _typed(key, text, plain[key])
        said.append(f"{key}={plain[key]}")
    return EncoderParameters.from_dict({**plain, "name": ", ".join(said)})


def _typed(key: str, text: str, like: str | float | int | bool) -> str | float | int | bool:
    if isinstance(like, str):
        return text
    if isinstance(like, bool):
        if text not in ("true", "false"):
            raise WrongUse(f"encoder parameter {key} is {text!r}: give true or false")
        return text == "true"
    kind, word = (int, "a whole number") if isinstance(like, int) else (float, "a number")
    try:
        return kind(text)
    except ValueError:
        raise WrongUse(f"encoder parameter {key} is {text!r}: give {word}") from None
