"""Spike counts of sessions: taxel ranges, the search for C, and counts with a given C.

Every step goes through the cache, so that nothing is computed twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.cache import Arrays, Cache, Resources, cache_key
from rigctl.analysis.data.condition_tasks import (
    ConditionTask,
    count_condition,
    fingerprint_trials,
    join_force_matrix,
    replace_sa_counts,
    select_c,
)
from rigctl.analysis.data.trial_set import TrialRef, TrialSet
from rigctl.analysis.settings.analysis_settings import AnalysisSettings, ConditionSettings
from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.errors import WrongUse
from rigctl.session.sample_index import SampleFile, SampleFiles

CHUNK = 256
"""Trials that one task reads."""


class RangesOver(StrEnum):
    """The trials that determine the taxel ranges."""

    ALL = "all"
    TRAINING = "training"


class PreparedTrials(NamedTuple):
    """Complete trials with all that later steps need; ``hashes``: of their samples, uint64 (n,)."""

    trials: TrialSet
    hashes: NDArray[np.uint64]
    normalisation: Normalisation
    layouts: tuple[FeatureLayout, FeatureLayout]


def prepare_trials(
    trials: TrialSet,
    resources: Resources,
    ranges: RangesOver | Normalisation = RangesOver.ALL,
    settings: AnalysisSettings | None = None,
) -> PreparedTrials:
    """Leave out trials with gaps; compute hashes, taxel ranges and layouts of the others.

    Raises SessionError where no complete trial is left, WrongUse where ``ranges`` do not fit.
    """
    settings = settings or AnalysisSettings()
    trials = trials.without_gaps()
    hashes, low, high = _fingerprints(trials, resources)
    normalisation = _ranges(trials, low, high, ranges, settings.conditions)
    outside = np.any((low < normalisation.low) | (high > normalisation.high), axis=1)
    remarks = list(trials.remarks)
    if np.any(outside):
        remarks.append(
            f"taxel ranges are {normalisation.source}: {np.count_nonzero(outside)} of {len(low)} "
            "trials have readings outside, which are clipped"
        )
    if normalisation.constant_taxels:
        listed = ", ".join(map(str, normalisation.constant_taxels))
        remarks.append(f"constant taxels, which read 0 and never spike: {listed}")
    layouts = _layouts(trials, settings)
    return PreparedTrials(replace(trials, remarks=tuple(remarks)), hashes, normalisation, layouts)


def _layouts(trials: TrialSet, settings: AnalysisSettings) -> tuple[FeatureLayout, FeatureLayout]:
    """Return the unscaled and the speed-scaled windows."""
    windows = settings.windows
    lengths = [trial.n_planned for trial in trials.trials]
    speeds = [trial.speed_mm_s for trial in trials.trials]
    layouts = []
    for scaled, n_windows in ((False, windows.unscaled), (True, windows.speed_scaled)):
        layout = FeatureLayout.covering(
            lengths,
            speeds,
            scaled=scaled,
            window_ms=windows.length_ms,
            reference_mm_s=windows.reference_speed_mm_s,
        )
        layouts.append(replace(layout, n_windows=n_windows) if n_windows else layout)
    return layouts[0], layouts[1]


def group_by_condition(
    prepared: PreparedTrials, parameters: EncoderParameters, reference_g: float, *, search_c: bool
) -> list[ConditionTask]:
    """Return the set by texture and speed, in sorted order, with or without a search for C.

    A texture and speed without a trial at the reference force is not searched.
    """
    trials = prepared.trials
    encoder = (prepared.normalisation, parameters, prepared.layouts)
    conditions = []
    for rows in trials.by_condition().values():
        members = tuple(trials.trials[i] for i in rows)
        files = files_of_trials(trials.files, members)
        searched = search_c and any(trial.force_g == reference_g for trial in members)
        forces = trials.forces_g if searched else ()
        conditions.append(ConditionTask(rows, files, members, *encoder, forces, reference_g, ()))
    return conditions


def count_conditions(
    prepared: PreparedTrials, conditions: Sequence[ConditionTask], resources: Resources
) -> Iterator[Arrays]:
    """Yield the counts without C of each condition; after a search also C and counts with it."""
    searches = any(condition.forces_g for condition in conditions)
    stage = "searching C, encoding" if searches else "encoding"
    return _map_conditions(prepared, conditions, stage, resources)


def join_searched_c(
    conditions: Sequence[ConditionTask], counted: Sequence[Arrays]
) -> ForceMatrix | None:
    """Return the C that :func:`count_conditions` found, None without a search."""
    searched = any("c" in arrays for arrays in counted)
    return join_force_matrix(conditions, counted) if searched else None


def count_with_given_c(
    prepared: PreparedTrials,
    conditions: Sequence[ConditionTask],
    plain: Sequence[Arrays],
    force: ForceMatrix,
    resources: Resources,
    *,
    blind: bool,
) -> Iterator[NDArray[Any]]:
    """Yield the counts of each condition with the C of its texture, or ``blind`` with the mean.

    ``plain``: from :func:`count_conditions`.
    """
    scaled = [_with_given_c(condition, force, blind) for condition in conditions]
    found = _map_conditions(prepared, scaled, "encoding with a given C", resources)
    for condition, counted, forced in zip(scaled, plain, found, strict=True):
        yield replace_sa_counts(counted["plain"], forced["forced"], condition.scaled_rows)


def _with_given_c(condition: ConditionTask, force: ForceMatrix, blind: bool) -> ConditionTask:
    forces = tuple(sorted({trial.force_g for trial in condition.trials}))
    texture, speed = condition.texture, condition.speed_mm_s
    c = tuple(select_c(force, texture, speed, force_g, blind=blind) for force_g in forces)
    return condition._replace(forces_g=forces, given_c=c)


def files_of_trials(
    files: Sequence[SampleFile], trials: Sequence[TrialRef]
) -> dict[int, SampleFile]:
    """Return the files that hold some trials, by their number in the set."""
    return {number: files[number] for number in sorted({t.sample_range.file for t in trials})}


def inputs_of(files: SampleFiles) -> list[tuple[int, ...]]:
    """Return how files share inputs, as a part of a cache key."""
    every = files.values() if isinstance(files, Mapping) else files
    return sorted({file.inputs for file in every})


def encoder_items(parameters: EncoderParameters) -> list[tuple[str, Any]]:
    """Return the parameters that determine spikes, as a part of a cache key."""
    return sorted((name, value) for name, value in parameters.as_dict().items() if name != "name")


def _map_conditions(
    prepared: PreparedTrials, conditions: Sequence[ConditionTask], stage: str, resources: Resources
) -> Iterator[Arrays]:
    keys = [_condition_key(one, prepared.hashes[one.rows]) for one in conditions]
    return resources.map_cached(count_condition, conditions, keys, stage)


def _condition_key(condition: ConditionTask, hashes: NDArray[np.uint64]) -> str:
    return cache_key(
        "counts",
        hashes,
        [(trial.force_g, trial.speed_mm_s) for trial in condition.trials],
        condition.normalisation.low,
        condition.normalisation.high,
        encoder_items(condition.parameters),
        inputs_of(condition.files),
        condition.layouts,
        condition.forces_g,
        condition.reference_g,
        *condition.given_c,
    )


def _fingerprints(
    trials: TrialSet, resources: Resources
) -> tuple[NDArray[np.uint64], NDArray[np.uint16], NDArray[np.uint16]]:
    """Return hash, minimum and maximum of each trial."""
    chunks = _chunks(trials)
    parts = [tuple(trials.trials[i] for i in rows) for rows in chunks]
    tasks = [(files_of_trials(trials.files, part), part) for part in parts]
    keys = [_file_key(*task, resources.cache) for task in tasks]
    stage = "reading trials for the taxel ranges"
    n = len(trials.trials)
    hashes = np.empty(n, np.uint64)
    low, high = (np.empty((n, trials.n_taxels), np.uint16) for _ in range(2))
    results = resources.map_cached(fingerprint_trials, tasks, keys, stage)
    for rows, found in zip(chunks, results, strict=True):
        hashes[rows], low[rows], high[rows] = found["hashes"], found["low"], found["high"]
    return hashes, low, high


def _chunks(trials: TrialSet) -> list[list[int]]:
    """Return rows of trials, each chunk from one file."""
    by_file: dict[int, list[int]] = {}
    for i, trial in enumerate(trials.trials):
        by_file.setdefault(trial.sample_range.file, []).append(i)
    return [rows[at : at + CHUNK] for rows in by_file.values() for at in range(0, len(rows), CHUNK)]


def _file_key(files: dict[int, SampleFile], trials: Sequence[TrialRef], cache: Cache) -> str:
    """Return a key of path, size, mtime and inode, which determine the content; "" for no cache."""
    (file,) = files.values()
    if file.offsets is None:
        return ""  # the file still grows, or another program wrote it
    status = file.path.stat()
    if not cache.trusts_mtime(status.st_mtime_ns):
        return ""
    rows = np.array([(trial.sample_range.start, trial.sample_range.stop) for trial in trials])
    identity = (str(file.path.resolve()), status.st_size, status.st_mtime_ns, status.st_ino)
    return cache_key("fingerprints", identity, rows, file.inputs)


def _ranges(
    trials: TrialSet,
    low: NDArray[np.uint16],
    high: NDArray[np.uint16],
    over: RangesOver | Normalisation,
    conditions: ConditionSettings,
) -> Normalisation:
    if isinstance(over, Normalisation):
        if over.n_taxels != trials.n_taxels:
            raise WrongUse(
                f"{trials.paths[0]} has {trials.n_taxels} taxels, {over.source} has "
                f"{over.n_taxels}: the ranges do not fit"
            )
        if over.reading is not trials.reading:
            raise WrongUse(
                f"the taxel ranges ({over.source}) are of {over.reading}, the encoder takes "
                f"{trials.reading}: take ranges of the same reading"
            )
        return over
    if over is RangesOver.ALL:
        source = "minimum and maximum over all trials used"
        return Normalisation.from_samples([low, high], source, trials.reading)
    trained = [
        i
        for i, trial in enumerate(trials.trials)
        if conditions.trains_speed(trial.speed_mm_s) and conditions.trains_force(trial.force_g)
    ]
    if not trained:
        raise WrongUse(
            f"no trial has a training speed and force ({conditions.training_text}): use "
            "--ranges all, or name others in an analysis file"
        )
    source = f"minimum and maximum over the trials at {conditions.training_text}"
    return Normalisation.from_samples([low[trained], high[trained]], source, trials.reading)
