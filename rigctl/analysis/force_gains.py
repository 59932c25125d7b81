"""The gains of a set of trials that scale the SA current without the label of the texture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.trial_set import TrialSet
from rigctl.encoder.force_gain import LOADCELL, ForceGain, ForceScaling, divided
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.encoder.normalisation import Normalisation
from rigctl.session.header import IMPORTED
from rigctl.session.sensor_passport import SensorPassport, passport_of, sensor_difference
from rigctl.session.session import Session

NO_PASSPORT = (
    "{path} carries no passport of its sensor (rigctl calibrate sensor makes one, --passport names "
    "one)"
)


class ForceGains(NamedTuple):
    """The gain of each trial of a set, by kind, and why a kind is left out."""

    by_kind: dict[str, tuple[ForceGain, ...]]
    remarks: tuple[str, ...]


def force_gains(
    trials: TrialSet,
    ranges: Normalisation,
    reference_g: float,
    passport: SensorPassport | None = None,
) -> ForceGains:
    """Return the gains that the trials allow; ``passport`` replaces those that sessions carry.

    Depths have no force to scale to: their calibrated gain aims at the usual one.
    """
    reference_g = REFERENCE_FORCE_G if trials.by_depth else reference_g
    gains: dict[str, tuple[ForceGain, ...]] = {
        ForceScaling.DIVIDED: (divided(ranges),) * len(trials.trials)
    }
    passports = [passport or passport_of(source) for source in trials.provenance]
    if not any(passports):
        return ForceGains(gains, ())
    if remark := _obstacle(trials, passports):
        return ForceGains(gains, (remark,))
    known = [one for one in passports if one is not None]
    of_sessions = [one.gain(ranges, reference_g) for one in known]
    gains[ForceScaling.CALIBRATED] = tuple(of_sessions[trial.session] for trial in trials.trials)
    measured_g = _measured_g(trials)
    without = np.flatnonzero(~(measured_g > 0))  # also of NaN
    if len(without):
        trial = trials.trials[without[0]]
        remark = (
            f"Load Cell is left out: trial {trial.trial_id} of "
            f"{trials.paths[trial.session]} has no force of the load cell"
        )
        return ForceGains(gains, (remark,))
    gains[LOADCELL] = tuple(
        known[trial.session].gain_at(force_g, ranges, reference_g)
        for trial, force_g in zip(trials.trials, measured_g.tolist(), strict=True)
    )
    return ForceGains(gains, ())


def _measured_g(trials: TrialSet) -> NDArray[np.float64]:
    """Return the mean force of each trial by the load cell, float64 (n,); NaN where there is none.

    An import repeats the force of its labels there, which nobody measured.
    """
    columns = []
    for path in trials.paths:
        with Session.open(path) as session:
            measured = session.trials["mean_force_g"].astype(np.float64)
            is_label = session.header.rig == IMPORTED
        columns.append(np.full_like(measured, np.nan) if is_label else measured)
    return np.array([columns[trial.session][trial.row] for trial in trials.trials])


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
