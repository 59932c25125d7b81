"""The C that scales force: which trials have one, how its search ended, and one from elsewhere.

A change of the sensor voids C, so a C from other recordings is never used without a warning. C
brings each taxel's SA rate at a force to its rate at the reference force; the rate error is the
remaining difference on the present trials, with C and without.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.spike_counts import (
    ConditionTask,
    PreparedTrials,
    c_per_trial,
    count_conditions,
    count_with_given_c,
    group_by_condition,
    prepare_trials,
)
from rigctl.analysis.trial_set import TrialRef, TrialSet, check_source_wiring
from rigctl.encoder.batch import sa_rates_hz
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G, ForceMatrix
from rigctl.encoder.force_search import TOLERANCE_HZ
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters
from rigctl.encoder.root_bracket import LIMIT_C, SearchStatus
from rigctl.errors import WrongUse
from rigctl.session.analysis_file import content_digest, load_force

MOST_LEFT_OUT = 0.5
"""Force is not scaled where more than this share of the trials has no C."""
MAX_LISTED = 5
NOT_CONVERGED = (SearchStatus.CAPPED, SearchStatus.DISCONTINUITY)
SEARCHED = (SearchStatus.CONVERGED, *NOT_CONVERGED)
DECIMALS = 4
Floats = NDArray[np.float64]
LEAST_COVERED = 0.5
"""Share of the trials that a given C must have; the others are left out."""
COMPARING = "comparing sessions with those that C was searched on"


def choose_reference(trials: TrialSet, reference_g: float) -> tuple[float, str]:
    """Return the force whose rates C aims at, and a remark where it is not ``reference_g``.

    No depth is the paper's 500 g, so a set by depth takes its middle depth instead.
    """
    if not trials.by_depth or reference_g != REFERENCE_FORCE_G:
        return reference_g, ""
    depths_mm = trials.forces_g
    middle_mm = depths_mm[(len(depths_mm) - 1) // 2]
    return middle_mm, (
        "the drum pressed to depths, so mm stand in the place of grams, and C aims at the middle "
        f"depth, {middle_mm:g} mm (--reference-force names another)"
    )


def force_scaling_obstacle(trials: TrialSet, reference_g: float) -> str:
    """Return a sentence where force cannot be scaled, "" where it can."""
    start = "Force Scaled representations are left out: "
    if len(trials.forces_g) < 2:
        return f"{start}there is only one level of force"
    if reference_g not in trials.forces_g:
        return (
            f"{start}no trial was made at the reference force of {reference_g:g} g "
            "(--reference-force names another)"
        )
    n, lacking = len(trials.trials), trials_without_c(trials, reference_g)
    if len(lacking) > MOST_LEFT_OUT * n:
        return (
            f"{start}{len(lacking)} of {n} trials have no C, because their texture and speed have "
            f"no trial at the reference force of {reference_g:g} g: {_listed(trials, lacking)}"
        )
    return ""


def trials_without_c(trials: TrialSet, reference_g: float) -> list[int]:
    """Return the rows of the trials whose texture and speed have none at the reference force."""
    return [
        row
        for rows in trials.by_condition().values()
        if all(trials.trials[row].force_g != reference_g for row in rows)
        for row in rows
    ]


def with_c(trials: TrialSet, reference_g: float) -> TrialSet:
    """Return the set without the trials that have no C, and a remark that lists those."""
    lacking = trials_without_c(trials, reference_g)
    if not lacking:
        return trials
    return trials.without(
        lacking,
        f"trials left out of every representation, because they have no C: {len(lacking)}; their "
        f"texture and speed have no trial at the reference force of {reference_g:g} g: "
        f"{_listed(trials, lacking)}",
    )


def absence_sentence(force: ForceMatrix) -> str:
    """Return a sentence on the combinations without a C, "" where every one has its C."""
    absent = force.absent_conditions
    if not absent:
        return ""
    listed = [f"{texture} at {v:g} mm/s and {f:g} g" for texture, v, f in absent]
    return (
        f"C has no entry for combinations of texture, speed and force without a trial, or without "
        f"one at the reference force: {len(absent)} ({_shortened(listed)})"
    )


def _listed(trials: TrialSet, rows: Sequence[int]) -> str:
    some = (trials.trials[row] for row in rows)
    return _shortened([f"texture {one.texture} at {one.speed_mm_s:g} mm/s" for one in some])


def _shortened(names: Sequence[str]) -> str:
    different = list(dict.fromkeys(names))
    return ", ".join(different[:MAX_LISTED]) + (" …" if len(different) > MAX_LISTED else "")


class UnconvergedEntry(NamedTuple):
    """An entry of C whose search did not converge; taxels count from 1.

    ``rate_hz``: mean SA rate with that C; ``target_hz``: that at the reference force; both are None
    for a C from a file of an older version. ``difference_hz``: rate less target.
    """

    texture: str
    taxel: int
    speed_mm_s: float
    force_g: float
    status: str
    c: float
    rate_hz: float | None
    target_hz: float | None
    difference_hz: float

    def as_dict(self) -> dict[str, Any]:
        """Return the values by name, for JSON and CSV."""
        plain = self._asdict()
        return {k: round(v, DECIMALS) if isinstance(v, float) else v for k, v in plain.items()}


def count_search_statuses(force: ForceMatrix) -> dict[str, int]:
    """Return the number of searches by outcome, at forces other than the reference."""
    return {status.name.lower(): int((force.status == status).sum()) for status in SEARCHED}


def unconverged_entries(force: ForceMatrix) -> list[UnconvergedEntry]:
    """Return the entries that did not converge, those that miss the target most first."""
    places = np.argwhere(np.isin(force.status, NOT_CONVERGED))
    found = [_entry(force, *place) for place in places.tolist()]
    return sorted(found, key=lambda entry: -abs(entry.difference_hz))


def _entry(
    force: ForceMatrix, texture: int, taxel: int, speed: int, level: int
) -> UnconvergedEntry:
    at = (texture, taxel, speed, level)
    miss_hz = float(force.residual_hz[at])
    rate_hz = None if force.rate_hz is None else float(force.rate_hz[at])
    return UnconvergedEntry(
        force.textures[texture],
        taxel + 1,
        force.speeds_mm_s[speed],
        force.forces_g[level],
        SearchStatus(int(force.status[at])).name.lower(),
        float(force.c[at]),
        rate_hz,
        None if rate_hz is None else rate_hz - miss_hz,
        miss_hz,
    )


def unconverged_shares(force: ForceMatrix) -> dict[str, Any]:
    """Return entries not converged, searched and in all, for ``results.json``, and the paper's."""
    searched = sum(count_search_statuses(force).values())
    reference = int((force.status == SearchStatus.REFERENCE).sum())
    paper_unconverged, paper_entries = published.UNCONVERGED_C
    return {
        "unconverged": force.unconverged,
        "searched": searched,
        "entries": searched + reference,
        "above_limit": int(np.sum(force.c > LIMIT_C)),
        "paper": {
            "unconverged": paper_unconverged,
            "of": paper_entries,
            "searched": paper_entries - published.REFERENCE_C,
            "unconverged_rate_hz": published.UNCONVERGED_RATE_HZ,
        },
    }


def force_sentence(force: ForceMatrix) -> str:
    """Return sentences on the outcome of the search for C, with the paper's figures."""
    counts, shares = count_search_statuses(force), unconverged_shares(force)
    searched, entries, n = shares["searched"], shares["entries"], shares["unconverged"]
    paper = shares["paper"]
    of_searched = _share(paper["unconverged"], paper["searched"])
    of_all = _share(paper["unconverged"], paper["of"])
    return (
        f"C has {entries:,} entries, {entries - searched:,} of them 1 by definition at "
        f"{force.reference_g:g} g; {searched:,} were searched: {counts['converged']:,} converged "
        f"within 0.1 Hz ({shares['above_limit']:,} of them above {LIMIT_C:g}), "
        f"{counts['capped']:,} did not and are limited to {LIMIT_C:g}, "
        f"{counts['discontinuity']:,} lie at a jump of the rate. Not converged: "
        f"{_share(n, searched)} searched (the paper: {of_searched}), and "
        f"{_share(n, entries)} with the reference entries (the paper: {of_all})"
        f"{_difference_sentence(force)}"
    )


def _share(part: int, whole: int) -> str:
    return f"{100 * part / max(1, whole):.1f} %, {part:,} of {whole:,}"


def _difference_sentence(force: ForceMatrix) -> str:
    """Return a sentence on the entry that misses its target most, "" where all converged."""
    found = unconverged_entries(force)
    if not found:
        return ""
    worst = found[0]
    targets_hz = [entry.target_hz for entry in found if entry.target_hz is not None]
    of = "" if worst.target_hz is None else f" of {worst.target_hz:.1f}"
    highest = f", and the highest target is {max(targets_hz):.1f} Hz" if targets_hz else ""
    return (
        f". The SA rates of those entries miss their targets by at most "
        f"{abs(worst.difference_hz):.1f}{of} Hz (texture {worst.texture}, taxel {worst.taxel}, "
        f"{worst.speed_mm_s:g} mm/s, {worst.force_g:g} g){highest} (the paper: trains of at most "
        f"{published.UNCONVERGED_RATE_HZ:g} spikes/s)"
    )


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


class ScaledBy(StrEnum):
    """The C that multiplies the SA current of the spikes in the file."""

    NONE = "none"
    TEXTURE = "texture"
    BLIND = "blind"


def trials_to_encode(trials: TrialSet, reference_g: float, scaled_by: ScaledBy) -> TrialSet:
    """Return the trials without gaps, those without C left out where C is to scale them.

    Raises WrongUse where C cannot be searched.
    """
    trials = trials.without_gaps()
    if scaled_by is ScaledBy.NONE:
        return trials
    if obstacle := force_scaling_obstacle(trials, reference_g):
        raise WrongUse(f"--scaled-by {scaled_by} needs C. {obstacle}")
    return with_c(trials, reference_g)


def sa_factors(
    prepared: PreparedTrials, force: ForceMatrix | None, scaled_by: ScaledBy
) -> NDArray[np.float64] | None:
    """Return the factors on the SA current, float64 (n_trials, n_taxels), or None for 1."""
    if force is None or scaled_by is ScaledBy.NONE:
        return None
    return c_per_trial(prepared.trials.trials, force, blind=scaled_by is ScaledBy.BLIND)
