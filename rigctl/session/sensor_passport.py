"""What a calibration found of a sensor: the file ``sensor.json``, which sessions carry.

``rigctl calibrate sensor`` writes it, ``[taxels] passport`` of ``rig.toml`` names it, and the
header of each later session has its values, so that a session can be read without the file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from rigctl.encoder.force_gain import ForceGain, ForceScaling, at_force, calibrated, divided
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.reading import HIGHEST, Reading
from rigctl.errors import ConfigError, SessionError, WrongUse

if TYPE_CHECKING:
    from rigctl.encoder.encoder import GainOf

MOST_BYTES = 60_000
"""Longest passport: an attribute of an HDF5 file holds no more than 64 KiB."""
ForceG = Annotated[float, Meta(gt=0, le=1_000_000)]
MeanReading = Annotated[float, Meta(gt=0, le=HIGHEST)]
Share = Annotated[float, Meta(ge=0, le=1_000)]


class TaxelResponse(msgspec.Struct, frozen=True):
    """A taxel's curve and what departs from it, as shares of its span; None if not measured."""

    curve: tuple[MeanReading, ...]
    span: float
    hysteresis: float | None = None
    repeatability: float | None = None
    speed_effect: float | None = None
    drift_per_hour: float | None = None
    end_slope: float | None = None


class SensorPassport(msgspec.Struct, frozen=True):
    """The response of a sensor to the force on a smooth plate.

    ``force_g``: ascending; ``force_error``: of the force that all taxels show there, a share.
    """

    sensor: str
    begun_utc: str
    session_digest: str
    simulated: bool
    reading: Reading
    force_g: tuple[ForceG, ...]
    force_error: tuple[Share, ...]
    taxels: tuple[TaxelResponse, ...]

    def __post_init__(self) -> None:
        """Raise ValueError for values that do not fit each other."""
        n = len(self.force_g)
        if n < 2 or len(self.force_error) != n or not self.taxels:
            raise ValueError("it needs two forces or more, an error for each, and taxels")
        if any(len(taxel.curve) != n for taxel in self.taxels):
            raise ValueError("a taxel's curve has not one reading for each force")
        if not (np.diff(self.force_g) > 0).all():
            raise ValueError("its forces do not rise")

    @property
    def curves(self) -> NDArray[np.float64]:
        """Mean reading of each taxel at each force, float64 (n_forces, n_taxels)."""
        return np.array([taxel.curve for taxel in self.taxels]).T

    def gain(self, ranges: Normalisation, reference_g: float = REFERENCE_FORCE_G) -> ForceGain:
        """Return the gain of the SA current that brings readings to the reference force.

        Raises WrongUse for ranges of another number of taxels.
        """
        if ranges.n_taxels != len(self.taxels):
            raise WrongUse(
                f"the sensor's passport is of {len(self.taxels)} taxels, these are "
                f"{ranges.n_taxels}: calibrate this sensor"
            )
        return calibrated(np.array(self.force_g), self.curves, ranges, reference_g)

    def gain_at(
        self, force_g: float, ranges: Normalisation, reference_g: float = REFERENCE_FORCE_G
    ) -> ForceGain:
        """Return the gain from a known force to the reference force."""
        return at_force(force_g, np.array(self.force_g), self.curves, ranges, reference_g)

    def to_values(self) -> dict[str, Any]:
        """Return plain values, for the header of a session."""
        values: dict[str, Any] = msgspec.to_builtins(self)
        return values


def read_passport(values: Any) -> SensorPassport:
    """Return a passport from plain values. Raises ValueError for one that cannot be used."""
    return msgspec.convert(values, SensorPassport)


def gain_source(
    scaling: ForceScaling, passport: SensorPassport | None, reading: Reading
) -> GainOf | None:
    """Return what gives the gain for taxel ranges, None for no scaling.

    Raises WrongUse for a calibrated one without a passport of that reading.
    """
    if scaling is ForceScaling.NONE:
        return None
    if scaling is ForceScaling.DIVIDED:
        return divided
    if passport is None:
        raise WrongUse(
            "a calibrated gain needs the sensor's passport: run rigctl calibrate sensor, or name "
            "its sensor.json as passport in rig.toml ([taxels]) or finger.toml ([finger])"
        )
    if passport.reading is not reading:
        raise WrongUse(
            f"the sensor's passport is of {passport.reading}, the encoder takes {reading}: set "
            f'[encoder] reading = "{passport.reading}" in rig.toml, or make one with rigctl '
            f"calibrate sensor --reading {reading}"
        )
    return passport.gain


def load_passport(path: Path, n_taxels: int) -> SensorPassport:
    """Return the passport of a file. Raises ConfigError, which names file and mistake."""
    cure = "name the sensor.json that rigctl calibrate sensor wrote"
    try:
        passport = read_passport(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise ConfigError(f"{path} cannot be read ({error.strerror}): {cure}") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path} is no passport of a sensor ({error}): {cure}") from error
    if len(passport.taxels) != n_taxels:
        raise ConfigError(
            f"{path} is of a sensor of {len(passport.taxels)} taxels, this one has {n_taxels}: "
            "calibrate this one"
        )
    if len(json.dumps(passport.to_values())) > MOST_BYTES:
        raise ConfigError(f"{path} is longer than a session can carry: calibrate with fewer forces")
    return passport


CERTAIN = 2.0
"""A sensor has changed where its force reads off by more than so many errors."""


class SensorChange(NamedTuple):
    """How a sensor reads compared with an earlier calibration.

    ``force``: the force that it shows now over that which it showed then, less 1, mean over the
    forces of both; ``error``: of that, by the errors of both; ``taxel``: the one, from 0, whose
    readings changed most beside the others', by the factor ``factor``.
    """

    force: float
    error: float
    taxel: int
    factor: float

    @property
    def is_certain(self) -> bool:
        """Whether the sensor shows another force, beyond the error."""
        return abs(self.force) > CERTAIN * self.error


def sensor_change(before: SensorPassport, now: SensorPassport) -> SensorChange:
    """Return how a sensor changed between two calibrations of equal readings and taxels."""
    low_g, high_g = (ends(before.force_g[i], now.force_g[i]) for ends, i in ((max, 0), (min, -1)))
    forces_g = np.geomspace(low_g, max(low_g, high_g), 20)
    then, today = (_at(one, forces_g) for one in (before, now))
    sums = np.maximum.accumulate(before.curves.sum(axis=1))
    shown_g = np.interp(today.sum(axis=1), sums, before.force_g)
    factors = (today / then).mean(axis=0)
    factors /= np.median(factors)
    taxel = int(np.abs(np.log(factors)).argmax())
    errors = [np.sqrt(np.mean(np.square(one.force_error))) for one in (before, now)]
    return SensorChange(
        float((shown_g / forces_g).mean()) - 1.0,
        float(np.hypot(*errors)),
        taxel,
        float(factors[taxel]),
    )


def _at(passport: SensorPassport, forces_g: NDArray[np.float64]) -> NDArray[np.float64]:
    curves = passport.curves.T
    return np.array([np.interp(forces_g, passport.force_g, curve) for curve in curves]).T


def describe_change(before: SensorPassport, now: SensorPassport) -> str:
    """Return a sentence where the sensor is another one or changed beyond its error, else ""."""
    if before.reading is not now.reading or len(before.taxels) != len(now.taxels):
        return f"of a sensor with {len(before.taxels)} taxels, not {len(now.taxels)}"
    change = sensor_change(before, now)
    is_other = before.sensor != now.sensor
    if not (is_other or change.is_certain):
        return ""
    which = f"sensor {before.sensor or '(unnamed)'}, not {now.sensor or '(unnamed)'}"
    start = which if is_other else f"this sensor as it was on {before.begun_utc[:10]}"
    return (
        f"{start}: the same force now reads as {abs(change.force):.1%} "
        f"{'more' if change.force > 0 else 'less'} (error {change.error:.1%}), and taxel "
        f"{change.taxel + 1} gives {change.factor:.2f} times as much beside the others"
    )


def passport_of(source: Mapping[str, Any]) -> SensorPassport | None:
    """Return the passport of a session that a model or a set lists, None without one.

    Raises SessionError for one that cannot be used.
    """
    values = source.get("passport")
    try:
        return read_passport(values) if values else None
    except ValueError as error:
        path = source.get("path", "a session")
        raise SessionError(
            f"{path} carries a passport of its sensor that cannot be used: {error}"
        ) from error


def sensor_difference(trained: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Return how the sensor of a session differs from that of a model's, "" where nothing says so.

    Both are mappings with the ``passport`` and the name of the ``sensor``.
    """
    before, after = passport_of(trained), passport_of(now)
    if before is not None and after is not None:
        return describe_change(before, after)
    names = [one.get("sensor") for one in (trained, now)]
    if not all(names) or names[0] == names[1]:
        return ""
    return f"sensor {names[0]}, not {names[1]}: without passports of both nobody knows by how much"
