"""Sessions to spike counts: taxel ranges, the search for C, and what is not done a second time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.cache import Arrays, Cache, Job, key_of, remembered
from rigctl.analysis.data.condition_tasks import (
    ConditionTask,
    counted_condition,
    fingerprints_of,
    joined_matrix,
    piece_of,
    with_force,
)
from rigctl.analysis.data.trial_set import TrialRef, TrialSet
from rigctl.analysis.execution.executor import HERE, Executor, Progress
from rigctl.analysis.paper import published
from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.errors import WrongUse
from rigctl.session.read.sample_index import SampleFile

CHUNK = 256
"""Trials that are read in one piece of work."""

Layouts = tuple[FeatureLayout, FeatureLayout]


class RangesOver(StrEnum):
    """Which trials the taxel ranges are taken over."""

    ALL = "all"
    TRAINING = "training"


@dataclass(frozen=True, slots=True)
class Resources:
    """Who works, what is kept of it, and who is told how far it is."""

    crew: Executor = HERE
    kept: Cache = field(default_factory=Cache)
    progress: Progress = lambda stage, done, all_: None


class PreparedTrials(NamedTuple):
    """What every later step stands on.

    ``trials``: the complete ones; ``hashes``: uint64 (n,), their contents' names.
    """

    trials: TrialSet
    hashes: NDArray[np.uint64]
    normalisation: Normalisation
    layouts: Layouts


class ConditionGroup(NamedTuple):
    """The trials of one texture and speed: their rows in the set, and the work to be done."""

    rows: list[int]
    condition: ConditionTask


def prepare(
    trials: TrialSet, means: Resources, ranges: RangesOver | Normalisation = RangesOver.ALL
) -> PreparedTrials:
    """Leave out trials with gaps; find ranges and layouts for the others.

    Raises SessionError where no complete trial is left, WrongUse where ``ranges`` do not fit.
    """
    torn = [i for i, trial in enumerate(trials.trials) if not trial.place.complete]
    trials = trials.without(torn, "gaps in their samples")
    hashes, low, high = _fingerprints(trials, means)
    normalisation = _ranges(trials, low, high, ranges)
    outside = np.any((low < normalisation.low) | (high > normalisation.high), axis=1)
    said = list(trials.remarks)
    if np.any(outside):
        said.append(
            f"taxel ranges are {normalisation.source}: readings outside are cut off, "
            f"which {np.count_nonzero(outside)} of {len(low)} trials have"
        )
    if normalisation.constant_taxels:
        named = ", ".join(map(str, normalisation.constant_taxels))
        said.append(f"constant taxels, which read 0 and never spike: {named}")
    lengths = [trial.n_planned for trial in trials.trials]
    speeds = [trial.speed_mm_s for trial in trials.trials]
    layouts = (
        FeatureLayout.covering(lengths, speeds, scaled=False),
        FeatureLayout.covering(lengths, speeds, scaled=True),
    )
    return PreparedTrials(replace(trials, remarks=tuple(said)), hashes, normalisation, layouts)


def groups_of(
    ground: PreparedTrials, parameters: EncoderParameters, reference_g: float, *, with_c: bool
) -> list[ConditionGroup]:
    """The set by texture and speed, in sorted order; ``with_c``: C is to be searched."""
    rows: dict[tuple[str, float], list[int]] = {}
    for i, trial in enumerate(ground.trials.trials):
        rows.setdefault((trial.texture, trial.speed_mm_s), []).append(i)
    forces = ground.trials.forces_g if with_c else ()
    ways = (ground.normalisation, parameters, ground.layouts, forces, reference_g, ())
    return [ConditionGroup(rows[key], _condition(ground, rows[key], *ways)) for key in sorted(rows)]


def count(
    ground: PreparedTrials, groups: Sequence[ConditionGroup], means: Resources
) -> Iterator[Arrays]:
    """Counts without C of each group, and where it is to be searched C and the counts with it."""
    return _remembered(ground, groups, "searching C, encoding", means)


def c_of(groups: Sequence[ConditionGroup], counted: Sequence[Arrays]) -> ForceMatrix | None:
    """The C that :func:`count` found, None where it was not to be searched."""
    pieces = [
        piece_of(group.condition, found)
        for group, found in zip(groups, counted, strict=True)
        if "c" in found
    ]
    return joined_matrix(pieces) if pieces else None


def with_own_c(group: ConditionGroup, counted: Arrays) -> NDArray[Any]:
    """Counts of a group with the C that was found for it."""
    return with_force(counted["plain"], counted["forced"], group.condition.scaled_rows)


def with_c(
    groups: Sequence[ConditionGroup], force: ForceMatrix, *, blind: bool
) -> list[ConditionGroup]:
    """Groups with a C that is known: their texture's own, or ``blind`` the mean over textures."""
    return [
        ConditionGroup(rows, condition._replace(**_given(condition, force, blind)))
        for rows, condition in groups
    ]


def count_with(
    ground: PreparedTrials,
    known: Sequence[ConditionGroup],
    plain: Sequence[Arrays],
    means: Resources,
) -> Iterator[NDArray[Any]]:
    """Counts of groups whose C is known; ``plain``: what :func:`count` gave for them."""
    found = _remembered(ground, known, "encoding with a C that is known", means)
    for group, counted, forced in zip(known, plain, found, strict=True):
        yield with_force(counted["plain"], forced["forced"], group.condition.scaled_rows)


def c_of_trials(trials: TrialSet, force: ForceMatrix, *, blind: bool) -> NDArray[np.float64]:
    """The factor on each trial's SA current, float64 (n_trials, n_taxels)."""
    return np.array(
        [
            force.texture_blind(t.speed_mm_s, t.force_g)
            if blind
            else force.of(t.texture, t.speed_mm_s, t.force_g)
            for t in trials.trials
        ]
    )


def _condition(ground: PreparedTrials, rows: Sequence[int], *ways: Any) -> ConditionTask:
    trials = tuple(ground.trials.trials[i] for i in rows)
    return ConditionTask(only_files(ground.trials.files, trials), trials, *ways)


def only_files(files: Sequence[SampleFile], trials: Sequence[TrialRef]) -> dict[int, SampleFile]:
    """The files that some trials lie in, by the number that their places tell."""
    return {number: files[number] for number in sorted({t.place.file for t in trials})}


def _given(condition: ConditionTask, force: ForceMatrix, blind: bool) -> dict[str, Any]:
    texture, speed = condition.trials[0].texture, condition.trials[0].speed_mm_s
    forces = tuple(sorted({trial.force_g for trial in condition.trials}))
    given = tuple(
        force.texture_blind(speed, f) if blind else force.of(texture, speed, f) for f in forces
    )
    return {"forces_g": forces, "given": given}


def _remembered(
    ground: PreparedTrials, groups: Sequence[ConditionGroup], stage: str, means: Resources
) -> Iterator[Arrays]:
    jobs = [group.condition for group in groups]
    keys = [_key(group.condition, ground.hashes[group.rows]) for group in groups]
    return through(counted_condition, jobs, keys, stage, means)


def through(
    work: Callable[[Job], Arrays],
    jobs: Sequence[Job],
    keys: Sequence[str],
    stage: str,
    means: Resources,
) -> Iterator[Arrays]:
    """:func:`remembered` with these means."""
    kept, crew, progress = means.kept, means.crew, means.progress
    return remembered(work, jobs, keys, kept=kept, crew=crew, stage=stage, progress=progress)


def _key(condition: ConditionTask, hashes: NDArray[np.uint64]) -> str:
    plain = condition.parameters.as_dict()
    del plain["name"]
    return key_of(
        "counts",
        hashes,
        [(trial.force_g, trial.speed_mm_s) for trial in condition.trials],
        condition.normalisation.low,
        condition.normalisation.high,
        sorted(plain.items()),
        condition.layouts,
        condition.forces_g,
        condition.reference_g,
        *condition.given,
    )


def _fingerprints(
    trials: TrialSet, means: Resources
) -> tuple[NDArray[np.uint64], NDArray[np.uint16], NDArray[np.uint16]]:
    """Hash, lowest and highest reading of each trial."""
    chunks = _chunks(trials)
    some = [tuple(trials.trials[i] for i in rows) for rows in chunks]
    jobs = [(only_files(trials.files, chunk), chunk) for chunk in some]
    keys = [_file_key(*job, means.kept) for job in jobs]
    stage = "reading trials for the taxel ranges"
    found = through(fingerprints_of, jobs, keys, stage, means)
    n = len(trials.trials)
    hashes = np.empty(n, np.uint64)
    low, high = (np.empty((n, trials.n_taxels), np.uint16) for _ in range(2))
    for rows, prints in zip(chunks, found, strict=True):
        hashes[rows], low[rows], high[rows] = prints["hashes"], prints["low"], prints["high"]
    return hashes, low, high


def _chunks(trials: TrialSet) -> list[list[int]]:
    """Rows of trials that lie in one file, some at a time."""
    by_file: dict[int, list[int]] = {}
    for i, trial in enumerate(trials.trials):
        by_file.setdefault(trial.place.file, []).append(i)
    return [rows[at : at + CHUNK] for rows in by_file.values() for at in range(0, len(rows), CHUNK)]


def _file_key(files: dict[int, SampleFile], trials: Sequence[TrialRef], kept: Cache) -> str:
    """A file that has its old name, size, age and number has its old content."""
    (file,) = files.values()
    if file.offsets is None:
        return ""  # it grows, or is not as we write it
    seen = file.path.stat()
    if not kept.is_settled(seen.st_mtime_ns):
        return ""
    rows = np.array([(trial.place.start, trial.place.stop) for trial in trials])
    known = (str(file.path.resolve()), seen.st_size, seen.st_mtime_ns, seen.st_ino)
    return key_of("fingerprints", known, rows)


def _ranges(
    trials: TrialSet,
    low: NDArray[np.uint16],
    high: NDArray[np.uint16],
    over: RangesOver | Normalisation,
) -> Normalisation:
    if isinstance(over, Normalisation):
        if over.n_taxels != trials.n_taxels:
            raise WrongUse(
                f"{trials.paths[0]} has {trials.n_taxels} taxels, {over.source} has "
                f"{over.n_taxels}: the ranges do not fit"
            )
        return over
    if over is RangesOver.ALL:
        return Normalisation.over([low, high], "minimum and maximum over all trials used")
    trained = [
        i
        for i, trial in enumerate(trials.trials)
        if trial.speed_mm_s in published.TRAINED_SPEEDS_MM_S
        and trial.force_g in published.TRAINED_FORCES_G
    ]
    if not trained:
        raise WrongUse(
            "no trial was made at a training speed and force of the paper (40, 60, 80 mm/s and "
            "250, 500 g): take the ranges over all"
        )
    words = "minimum and maximum over the trials at 40, 60, 80 mm/s and 250, 500 g"
    return Normalisation.over([low[trained], high[trained]], words)
