"""The gains of a set of trials that scale the SA current without the label of the texture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from rigctl.analysis.trial_set import TrialSet
from rigctl.encoder.force_gain import ForceGain, ForceScaling, divided
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.encoder.normalisation import Normalisation
from rigctl.session.sensor_passport import SensorPassport, passport_of, sensor_difference

NO_PASSPORT = (
    "{path} carries no passport of its sensor (rigctl calibrate sensor makes one, --passport names "
    "one)"
)


class ForceGains(NamedTuple):
    """The gain of each session of a set, by kind, and why a kind is left out."""

    by_kind: dict[ForceScaling, tuple[ForceGain, ...]]
    remarks: tuple[str, ...]


def force_gains(
    trials: TrialSet,
    ranges: Normalisation,
    reference_g: float,
    passport: SensorPassport | None = None,
) -> ForceGains:
    """Return the gains that the sessions allow; ``passport`` replaces those that they carry.

    Depths have no force to scale to: their calibrated gain aims at the usual one.
    """
    reference_g = REFERENCE_FORCE_G if trials.by_depth else reference_g
    n = len(trials.paths)
    gains = {ForceScaling.DIVIDED: (divided(ranges),) * n}
    passports = [passport or passport_of(source) for source in trials.provenance]
    if not any(passports):
        return ForceGains(gains, ())
    if remark := _obstacle(trials, passports):
        return ForceGains(gains, (remark,))
    gains[ForceScaling.CALIBRATED] = tuple(
        one.gain(ranges, reference_g) for one in passports if one is not None
    )
    return ForceGains(gains, ())


def sensor_warnings(model_inputs: Sequence[Mapping[str, Any]], trials: TrialSet) -> list[str]:
    """Return a warning for each session whose sensor is not that of a model, or has changed."""
    if not model_inputs:
        return []
    changes = [sensor_difference(model_inputs[-1], source) for source in trials.provenance]
    pairs = zip(trials.paths, changes, strict=True)
    return [f"WARNING: {path}: the model was trained on {how}" for path, how in pairs if how]


def _obstacle(trials: TrialSet, passports: Sequence[SensorPassport | None]) -> str:
    """Return a sentence where a session cannot be calibrated, "" where all can."""
    for path, one in zip(trials.paths, passports, strict=True):
        if one is None:
            missing = NO_PASSPORT.format(path=path)
            return f"Calibrated representations are left out: {missing}"
        if one.reading is not trials.reading or len(one.taxels) != trials.n_taxels:
            return (
                f"Calibrated representations are left out: the passport of {path} is of the "
                f"{one.reading} of {len(one.taxels)} taxels, the session gives the "
                f"{trials.reading} of {trials.n_taxels}"
            )
    return ""
