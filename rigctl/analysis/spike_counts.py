"""Spike counts of sessions: taxel ranges, the search for C, and counts with a given C.

Each texture and speed is a task that can run in its own process, and every step goes through the
cache, so that nothing is computed twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from xxhash import xxh3_64_intdigest

from rigctl.analysis.cache import Arrays, Cache, Resources, cache_key
from rigctl.analysis.settings import AnalysisSettings, ConditionSettings
from rigctl.analysis.trial_set import (
    ScratchMemory,
    TrialBlock,
    TrialReader,
    TrialRef,
    TrialSet,
    counted,
    open_trials,
)
from rigctl.encoder.batch import (
    Counts,
    common_bin_edges,
    count_spikes,
    mean_normalised_reading,
    sa_rates_hz,
)
from rigctl.encoder.features import FeatureLayout
from rigctl.encoder.force_gain import ForceGain
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.force_search import search_c
from rigctl.encoder.kernel import TrialViews
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters
from rigctl.encoder.root_bracket import SearchStatus
from rigctl.errors import WrongUse
from rigctl.session.sample_index import SampleFile, SampleFiles

Samples = NDArray[np.uint16]
LANES = 32
"""Rows that NumPy compares side by side: single rows are too short for vector instructions."""
SCRATCH = ScratchMemory()
TRIALS_PER_READ = 32
"""Trials read before their fingerprints are computed; that many fit in the processor's cache."""
CHUNK = 256
"""Trials that one task reads."""


def hash_array(data: NDArray[Any]) -> int:
    """Return the XXH3 (64 bits, seed 0) of an array's bytes."""
    return xxh3_64_intdigest(np.ascontiguousarray(data).data)


def fingerprint(
    samples: Samples, starts: NDArray[np.int64], lengths: NDArray[np.int64]
) -> tuple[NDArray[np.uint64], Samples, Samples]:
    """Return hash, minimum and maximum of trials: uint64 (n,), uint16 (n, n_taxels) each.

    Each trial is ``lengths`` rows, at least one, of the contiguous ``samples`` (rows, n_taxels),
    from row ``starts`` on.
    """
    trials = [samples[start : start + n] for start, n in zip(starts, lengths, strict=True)]
    hashes = np.array([hash_array(trial) for trial in trials], np.uint64)
    low, high = (
        np.array([_reduce_rows(extreme, trial) for trial in trials])
        for extreme in (np.minimum, np.maximum)
    )
    return hashes, low, high


def _reduce_rows(extreme: np.ufunc, trial: Samples) -> Samples:
    """Return the minimum or maximum of each column, uint16 (n_taxels,)."""
    width = trial.shape[1]
    n = len(trial) // LANES * LANES
    wide = trial[:n].reshape(-1, LANES * width)
    folded = extreme.reduce(wide).reshape(LANES, width) if n else trial[:0]
    extremes: Samples = extreme.reduce(np.concatenate([folded, trial[n:]]))
    return extremes


class ConditionTask(NamedTuple):
    """The trials of one texture at one speed, to be encoded; ``rows``: their rows in the set.

    All other row numbers count the condition's own trials from 0. ``forces_g``: levels of force
    that need a C, none for counts without C. ``given_c``: the C of each of them, float64
    (n_taxels,), or empty for a search. ``gains``: of the SA current, for each trial; none for 1.
    """

    rows: list[int]
    files: SampleFiles
    trials: tuple[TrialRef, ...]
    normalisation: Normalisation
    parameters: EncoderParameters
    layouts: tuple[FeatureLayout, FeatureLayout]
    forces_g: tuple[float, ...]
    reference_g: float
    given_c: tuple[NDArray[np.float64], ...]
    gains: tuple[ForceGain, ...] = ()

    @property
    def texture(self) -> str:
        """Texture of all trials."""
        return self.trials[0].texture

    @property
    def speed_mm_s(self) -> float:
        """Planned speed of all trials."""
        return self.trials[0].speed_mm_s

    @property
    def lengths(self) -> list[int]:
        """Samples of each trial."""
        return [trial.n_samples for trial in self.trials]

    @property
    def bin_edges(self) -> NDArray[np.int64]:
        """Edges of the bins in which the spikes are counted, in samples."""
        return common_bin_edges(self.layouts, max(self.lengths), self.speed_mm_s)

    def rows_at(self, force_g: float) -> list[int]:
        """Return the rows of the trials at one force."""
        return [i for i, trial in enumerate(self.trials) if trial.force_g == force_g]

    @property
    def scaled_rows(self) -> list[int]:
        """Rows of the trials whose SA current a C changes."""
        if self.given_c:
            pairs = zip(self.forces_g, self.given_c, strict=True)
            unscaled = {force_g for force_g, c in pairs if (c == 1.0).all()}
        else:
            unscaled = {self.reference_g}
        return [i for i, trial in enumerate(self.trials) if trial.force_g not in unscaled]


def fingerprint_trials(task: tuple[dict[int, SampleFile], tuple[TrialRef, ...]]) -> Arrays:
    """Return ``hashes`` uint64 (n,); ``low``, ``high`` uint16 (n, n_taxels) of some trials.

    The hashes are of the counts, the others of the readings.
    """
    files, trials = task
    hashes, low, high = _fingerprints(files, trials)
    if any(file.inputs for file in files.values()):
        hashes, _, _ = _fingerprints(counted(files), trials)
    return {"hashes": hashes, "low": low, "high": high}


def _fingerprints(files: SampleFiles, trials: Sequence[TrialRef]) -> tuple[NDArray[Any], ...]:
    with open_trials(files) as reader:
        parts = [
            fingerprint(*reader.read_block(trials[first : first + TRIALS_PER_READ], SCRATCH))
            for first in range(0, len(trials), TRIALS_PER_READ)
        ]
    return tuple(np.concatenate(arrays) for arrays in zip(*parts, strict=True))


def count_condition(condition: ConditionTask) -> Arrays:
    """Return the binned spike counts of one condition.

    With a given C: ``forced``, the SA counts of :attr:`ConditionTask.scaled_rows` alone. Without:
    ``plain``, the counts of all trials; and where there are forces, ``forced`` with the C found,
    and that C: ``c``, ``status``, ``residual_hz``, ``evaluations``, ``rate_hz``, each (n_taxels,
    n_forces).
    Counts are (trials, trains, bins) in the smallest dtype that holds them.
    """
    with open_trials(condition.files) as reader:
        if condition.given_c:
            return {"forced": _downcast(_count_with_given_c(condition, reader))}
        if condition.forces_g:
            return _search_c(condition, reader)
        if condition.gains:
            block = reader.read_block(condition.trials, SCRATCH)
            return {"plain": _downcast(_count_with_gains(condition, block))}
        every = range(len(condition.trials))
        return {"plain": _downcast(_count(condition, _read(condition, reader, every)))}


def _read(condition: ConditionTask, reader: TrialReader, rows: Sequence[int]) -> TrialViews:
    """Return the samples of some trials, in memory that the next call in this thread reuses."""
    if not rows:
        return TrialViews.from_arrays([])
    return TrialViews.from_memory(*reader.read_block([condition.trials[i] for i in rows], SCRATCH))


def _count(
    condition: ConditionTask, trials: TrialViews, scale: NDArray[np.float64] | None = None
) -> Counts:
    """Return the counts of both channels, or with a C of SA alone: C does not change RA."""
    return count_spikes(
        trials,
        condition.bin_edges,
        condition.normalisation,
        condition.parameters,
        sa_scale=scale,
        sa_only=scale is not None,
    )


def _count_with_given_c(condition: ConditionTask, reader: TrialReader) -> Counts:
    """Return the SA counts of the trials that the given C changes."""
    by_force = dict(zip(condition.forces_g, condition.given_c, strict=True))
    rows = condition.scaled_rows
    scale = np.array([by_force[condition.trials[i].force_g] for i in rows])
    return _count(condition, _read(condition, reader, rows), scale)


def _count_with_gains(condition: ConditionTask, block: TrialBlock) -> Counts:
    """Return the counts of both channels; a gain does not change RA, as C does not."""
    counts = _count(condition, TrialViews.from_memory(*block))
    pairs = zip(condition.gains, block.arrays, strict=True)
    scaled = [gain.apply(samples) for gain, samples in pairs]
    n_taxels = condition.normalisation.n_taxels
    counts[:, :n_taxels] = count_spikes(
        scaled, condition.bin_edges, condition.normalisation, condition.parameters, sa_only=True
    )
    return counts


def _search_c(condition: ConditionTask, reader: TrialReader) -> Arrays:
    """Return the counts without C, the C at each force, and the SA counts with it.

    It reads the trials of one force at a time, because they fit in the processor's last cache.
    """
    n_taxels, n_trials = condition.normalisation.n_taxels, len(condition.trials)
    plain = np.empty((n_trials, 2 * n_taxels, len(condition.bin_edges) - 1), np.uint32)
    reading, target = _count_reference(condition, reader, plain)
    forced = np.empty_like(plain[:, :n_taxels])
    shape = (n_taxels, len(condition.forces_g))
    found: Arrays = {"c": np.ones(shape), "status": np.zeros(shape, np.int8)}
    found |= {"residual_hz": np.zeros(shape), "evaluations": np.zeros(shape)}
    found["rate_hz"] = np.tile(target[:, None], len(condition.forces_g))
    for f, force in enumerate(condition.forces_g):
        if force == condition.reference_g:
            continue
        rows = condition.rows_at(force)
        if not rows:
            found["status"][:, f], found["rate_hz"][:, f] = SearchStatus.ABSENT, 0.0
            continue
        search = search_c(
            _read(condition, reader, rows),
            reading,
            target,
            condition.normalisation,
            condition.parameters,
            bin_edges=condition.bin_edges,
            with_plain=True,
        )
        plain[rows] = search.plain
        forced[rows] = search.counts
        found["c"][:, f], found["status"][:, f] = search.c, search.status
        found["rate_hz"][:, f] = search.rate_hz
        found["residual_hz"][:, f] = search.rate_hz - target
        found["evaluations"][:, f] = search.evaluations
    forced = forced[condition.scaled_rows]
    return {"plain": _downcast(plain), "forced": _downcast(forced), **found}


def _count_reference(
    condition: ConditionTask, reader: TrialReader, plain: Counts
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Count the trials at the reference force into ``plain``.

    Returns each taxel's mean normalised reading and SA rate in Hz, float64 (n_taxels,) each.
    """
    rows = condition.rows_at(condition.reference_g)
    reference = _read(condition, reader, rows)
    plain[rows] = _count(condition, reference)
    sa_counts = plain[rows, : condition.normalisation.n_taxels]
    rates_hz = sa_rates_hz(sa_counts, reference.lengths.tolist(), condition.parameters)
    return mean_normalised_reading(reference, condition.normalisation), rates_hz


def _downcast(counts: Counts) -> NDArray[Any]:
    """Return counts in the smallest dtype: processes exchange them and the cache stores them."""
    return counts.astype(np.min_scalar_type(counts.max(initial=0)))


def replace_sa_counts(
    plain: NDArray[Any], forced: NDArray[Any], rows: Sequence[int]
) -> NDArray[Any]:
    """Return the counts of both channels with other SA counts in some rows."""
    n_taxels = plain.shape[1] // 2
    counts: NDArray[Any] = plain.astype(np.uint32)
    counts[list(rows), :n_taxels] = forced
    return counts


def select_c(
    force: ForceMatrix, texture: str, speed_mm_s: float, force_g: float, *, blind: bool
) -> NDArray[np.float64]:
    """Return the C of a texture, or ``blind`` the mean over textures, float64 (n_taxels,)."""
    if blind:
        return force.texture_blind(speed_mm_s, force_g)
    return force.c_at(texture, speed_mm_s, force_g)


def c_per_trial(
    trials: Sequence[TrialRef], force: ForceMatrix, *, blind: bool
) -> NDArray[np.float64]:
    """Return the factor on each trial's SA current, float64 (n_trials, n_taxels)."""
    return np.array(
        [select_c(force, t.texture, t.speed_mm_s, t.force_g, blind=blind) for t in trials]
    )


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
    hashes, low, high = _map_fingerprints(trials, resources)
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
    prepared: PreparedTrials,
    conditions: Sequence[ConditionTask],
    resources: Resources,
    stage: str = "",
) -> Iterator[Arrays]:
    """Yield the counts without C of each condition; after a search also C and counts with it.

    ``stage``: what the progress calls it.
    """
    searches = any(condition.forces_g for condition in conditions)
    stage = stage or ("searching C, encoding" if searches else "encoding")
    return _map_conditions(prepared, conditions, stage, resources)


def join_searched_c(
    conditions: Sequence[ConditionTask], counted: Sequence[Arrays]
) -> ForceMatrix | None:
    """Return the C that :func:`count_conditions` found, None without a search.

    Conditions that were not searched have none (ABSENT).
    """
    pairs = zip(conditions, counted, strict=True)
    searched = [(condition, arrays) for condition, arrays in pairs if "c" in arrays]
    if not searched:
        return None
    textures = tuple(sorted({condition.texture for condition in conditions}))
    speeds = tuple(sorted({condition.speed_mm_s for condition in conditions}))
    first, of_first = searched[0]
    n_taxels, n_forces = of_first["c"].shape
    shape = (len(textures), n_taxels, len(speeds), n_forces)
    joined: Arrays = {name: np.zeros(shape) for name in ("residual_hz", "evaluations", "rate_hz")}
    joined |= {"c": np.ones(shape), "status": np.full(shape, SearchStatus.ABSENT, np.int8)}
    for condition, arrays in searched:
        t, v = textures.index(condition.texture), speeds.index(condition.speed_mm_s)
        for name, values in joined.items():
            values[t, :, v] = arrays[name]
    return ForceMatrix(textures, speeds, first.forces_g, first.reference_g, **joined)


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
    for condition, without, forced in zip(scaled, plain, found, strict=True):
        yield replace_sa_counts(without["plain"], forced["forced"], condition.scaled_rows)


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
        condition.gains,
    )


def _map_fingerprints(
    trials: TrialSet, resources: Resources
) -> tuple[NDArray[np.uint64], NDArray[np.uint16], NDArray[np.uint16]]:
    """Return hash, minimum and maximum of each trial."""
    chunks = _chunks(trials)
    parts = [tuple(trials.trials[i] for i in rows) for rows in chunks]
    tasks = [(files_of_trials(trials.files, part), part) for part in parts]
    keys = [_file_key(*task, resources.cache) for task in tasks]
    stage = f"reading {trials.reading} for the taxel ranges"
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
