"""A C that was searched on other recordings, and its SA rate error on the present ones.

A change of the sensor voids C, so a C from other recordings is never used without a warning. C
brings each taxel's SA rate at a force to its rate at the reference force; the rate error is the
remaining difference on the present trials, with C and without.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.data.condition_tasks import ConditionTask
from rigctl.analysis.data.trial_set import TrialRef, TrialSet
from rigctl.analysis.data.wiring_check import check_source_wiring
from rigctl.analysis.features.c_outcome import count_search_statuses
from rigctl.analysis.features.spike_counts import (
    count_conditions,
    count_with_given_c,
    group_by_condition,
    prepare_trials,
)
from rigctl.encoding.batch import sa_rates_hz
from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.force_search import TOLERANCE_HZ
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.errors import WrongUse
from rigctl.session.analysis_file import content_digest, load_force

Floats = NDArray[np.float64]
LEAST_COVERED = 0.5
"""Share of the trials that a given C must have; the others are left out."""
COMPARING = "comparing sessions with those that C was searched on"


class RateError(NamedTuple):
    """Errors of the SA rates at one speed and force, over textures and taxels.

    An error is the absolute difference from the rate at the reference force, in Hz. The fields
    hold the mean errors with C and without, the largest with C, the mean rate at the reference
    force, and the number of pairs of texture and taxel.
    """

    speed_mm_s: float
    force_g: float
    with_c_hz: float
    without_c_hz: float
    largest_hz: float
    aimed_hz: float
    pairs: int

    def as_dict(self) -> dict[str, float]:
        """Return the values by name, for JSON."""
        return {k: round(float(v), 4) for k, v in self._asdict().items()}


class ForceMatrixSource(NamedTuple):
    """The file of a C; ``unseen``: the present sessions that it was not searched on."""

    file: Path
    force: ForceMatrix
    unseen: tuple[Path, ...]


class TransferredC(NamedTuple):
    """A C from other recordings, with its rate errors here and a sentence on them."""

    source: ForceMatrixSource
    rate_errors: tuple[RateError, ...]
    sentence: str


def load_c(
    file: Path, trials: TrialSet, resources: Resources = SERIAL_RESOURCES
) -> ForceMatrixSource:
    """Return the C of a model or a spikes.h5.

    Raises SessionError or WrongUse where it does not fit the trials.
    """
    force, inputs = load_force(file, trials.reading)
    check_source_wiring(file, inputs, trials.provenance)
    covered_trials(trials, force, by_texture=True, least_share=LEAST_COVERED)
    return ForceMatrixSource(file, force, unseen_sessions(trials, inputs, resources))


def unseen_sessions(
    trials: TrialSet, sources: Sequence[Mapping[str, Any]], resources: Resources
) -> tuple[Path, ...]:
    """Return the sessions of a set that are not in ``sources``, compared by content digest.

    Sources without a digest are compared by what identifies their recording.
    """
    contents = {source["content"] for source in sources if "content" in source}
    identities = {_identity(source) for source in sources if "content" not in source}
    unseen = []
    n = len(trials.paths)
    for number, (path, source) in enumerate(zip(trials.paths, trials.provenance, strict=True)):
        resources.progress(COMPARING, number, n)
        if _identity(source) not in identities and content_digest(path) not in contents:
            unseen.append(path)
    resources.progress(COMPARING, n, n)
    return tuple(unseen)


def _identity(source: Mapping[str, Any]) -> tuple[Any, ...]:
    keys = ("plan_hash", "begun_utc", "seed", "simulation_seed", "trials_committed")
    return tuple(source.get(key) for key in keys)


def describe_transfer(source: ForceMatrixSource, errors: Sequence[RateError]) -> TransferredC:
    """Return a C from other recordings with its rate errors on the trials that it scales."""
    sentence = f"C is taken from {source.file} and was not searched{_unconverged(source.force)}"
    if source.unseen:
        sentence = f"{transfer_warning(errors, source.force, source.unseen)}. {sentence}"
    return TransferredC(source, tuple(errors), sentence)


def _unconverged(force: ForceMatrix) -> str:
    """Return a clause on the entries of a C whose search did not converge, "" without any."""
    if not force.unconverged:
        return ""
    searched = sum(count_search_statuses(force).values())
    return f"; {force.unconverged:,} of {searched:,} searches did not converge where it was"


def covered_trials(
    trials: TrialSet, force: ForceMatrix, *, by_texture: bool, least_share: float = 0.0
) -> TrialSet:
    """Return the trials whose conditions C has, with a remark on the others.

    Raises WrongUse, naming session and trial, for another number of taxels, where C has none of the
    trials, or less than ``least_share`` of them.
    """
    if force.c.shape[1] != trials.n_taxels:
        raise WrongUse(
            f"{trials.paths[0]} has {trials.n_taxels} taxels, C was made for {force.c.shape[1]}"
        )
    mismatches = (_mismatch(trial, force, by_texture=by_texture) for trial in trials.trials)
    lacking = {row: mismatch for row, mismatch in enumerate(mismatches) if mismatch}
    if not lacking:
        return trials
    row, mismatch = next(iter(lacking.items()))
    trial = trials.trials[row]
    first = f"{trials.paths[trial.session]}: trial {trial.trial_id} {mismatch}"
    n = len(trials.trials)
    if len(lacking) == n or n - len(lacking) < least_share * n:
        raise WrongUse(f"{first}: C cannot scale it")
    remark = f"{len(lacking)} of {n} trials left out, which C cannot scale, such as {first}"
    return trials.without(list(lacking), remark)


def _mismatch(trial: TrialRef, force: ForceMatrix, *, by_texture: bool) -> str:
    """Return what of a trial's conditions C lacks, "" where it has them."""
    if trial.speed_mm_s not in force.speeds_mm_s:
        levels = ", ".join(f"{v:g}" for v in force.speeds_mm_s)
        return f"was made at {trial.speed_mm_s:g} mm/s, C at {levels} mm/s"
    if trial.force_g not in force.forces_g:
        levels = ", ".join(f"{f:g}" for f in force.forces_g)
        return f"was made at {trial.force_g:g} g, C at {levels} g"
    if by_texture and trial.texture not in force.textures:
        return f"has texture {trial.texture!r}, C is for {', '.join(force.textures)}"
    if by_texture and not force.covers(trial.texture, trial.speed_mm_s, trial.force_g):
        condition = f"{trial.texture!r} at {trial.speed_mm_s:g} mm/s and {trial.force_g:g} g"
        return f"has texture {condition}, which C lacks"
    return ""


def measure_rate_errors(
    trials: TrialSet,
    force: ForceMatrix,
    normalisation: Normalisation,
    parameters: EncoderParameters,
    resources: Resources,
    *,
    blind: bool = False,
) -> list[RateError]:
    """Encode trials without C and with it, and return the rate errors.

    ``blind``: with the mean of C over its textures instead of the trial's own.
    """
    prepared = prepare_trials(trials, resources, normalisation)
    conditions = group_by_condition(prepared, parameters, force.reference_g, search_c=False)
    plain = list(count_conditions(prepared, conditions, resources))
    scaled = count_with_given_c(prepared, conditions, plain, force, resources, blind=blind)
    rates = []
    for condition, found, counts in zip(conditions, plain, scaled, strict=True):
        by_force = sa_rates_by_force(condition, found["plain"], counts, force.reference_g)
        rates.append((condition, by_force))
    return pool_rate_errors(rates)


def sa_rates_by_force(
    condition: ConditionTask, plain: NDArray[Any], scaled: NDArray[Any], reference_g: float
) -> dict[float, Floats]:
    """Return target rates, rates with C and without at each force, float64 (3, n_taxels).

    ``plain``, ``scaled``: the condition's counts without C and with it; ``reference_g``: of C.
    Empty for a condition without trials at the reference force.
    """

    def rates(counts: NDArray[Any], force_g: float) -> Floats:
        rows, n_taxels = condition.rows_at(force_g), counts.shape[1] // 2
        sa_counts = counts[rows, :n_taxels].astype(np.uint32)
        return sa_rates_hz(sa_counts, [condition.lengths[i] for i in rows], condition.parameters)

    forces = {trial.force_g for trial in condition.trials}
    if reference_g not in forces:
        return {}
    target = rates(plain, reference_g)
    others = sorted(forces - {reference_g})
    return {f: np.stack([target, rates(scaled, f), rates(plain, f)]) for f in others}


def pool_rate_errors(
    measured: Iterable[tuple[ConditionTask, dict[float, Floats]]],
) -> list[RateError]:
    """Return the rate errors over textures, from :func:`sa_rates_by_force` of each condition."""
    pooled: dict[tuple[float, float], list[Floats]] = {}
    for condition, by_force in measured:
        for force_g, rates in by_force.items():
            pooled.setdefault((condition.speed_mm_s, force_g), []).append(rates)
    return [_error(*key, np.concatenate(parts, axis=1)) for key, parts in sorted(pooled.items())]


def transfer_warning(
    errors: Sequence[RateError], force: ForceMatrix, unseen: Sequence[Path]
) -> str:
    """Return the warning for a C that was not searched on the ``unseen`` sessions."""
    start = (
        f"WARNING: C was searched on other recordings than {', '.join(map(str, unseen))}, and any "
        "change of the sensor voids it. "
    )
    if not errors:
        return start + (
            f"Its rate error cannot be measured here: no speed has trials both at "
            f"{force.reference_g:g} g and at another force"
        )
    parts = "; ".join(
        f"{m.speed_mm_s:g} mm/s, {m.force_g:g} g: {m.with_c_hz:.2f} Hz with C (at most "
        f"{m.largest_hz:.1f}), {m.without_c_hz:.2f} without, of {m.aimed_hz:.1f} Hz"
        for m in errors
    )
    worst = max(errors, key=lambda m: m.with_c_hz)
    helps = sum(m.with_c_hz < m.without_c_hz for m in errors)
    return start + (
        f"Mean error of the SA rates at {force.reference_g:g} g: {parts}. A search on these "
        f"recordings would come within {TOLERANCE_HZ:g} Hz; the worst here is "
        f"{worst.with_c_hz:.2f} Hz, and C reduces the error at {helps} of {len(errors)} levels"
    )


def _error(speed_mm_s: float, force_g: float, rates: Floats) -> RateError:
    target, with_c, without = rates
    error = np.abs(with_c - target)
    return RateError(
        speed_mm_s,
        force_g,
        float(error.mean()),
        float(np.abs(without - target).mean()),
        float(error.max()),
        float(target.mean()),
        rates.shape[1],
    )
