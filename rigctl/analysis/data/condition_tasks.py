"""Tasks from sessions to spike counts, each of which can run in its own process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.fingerprint import fingerprint
from rigctl.analysis.data.trial_set import (
    ScratchMemory,
    TrialReader,
    TrialRef,
    counted,
    open_trials,
)
from rigctl.encoding.batch import (
    Counts,
    common_bin_edges,
    count_spikes,
    count_spikes_without_and_with_c,
    mean_normalised_reading,
    sa_rates_hz,
)
from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.force_search import ForceSearch, search_c
from rigctl.encoding.kernel import TrialViews
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.encoding.root_bracket import SearchStatus
from rigctl.session.sample_index import SampleFile, SampleFiles


class ConditionTask(NamedTuple):
    """The trials of one texture at one speed, to be encoded; ``rows``: their rows in the set.

    All other row numbers count the condition's own trials from 0. ``forces_g``: levels of force
    that need a C, none for counts without C. ``given_c``: the C of each of them, float64
    (n_taxels,), or empty for a search.
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


Arrays = dict[str, NDArray[Any]]
SCRATCH = ScratchMemory()
TRIALS_PER_READ = 32
"""Trials read before their fingerprints are computed; that many fit in the processor's cache."""


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
        plain[rows], search = _search_at_force(
            condition, _read(condition, reader, rows), reading, target
        )
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


def _search_at_force(
    condition: ConditionTask,
    trials: TrialViews,
    reading: NDArray[np.float64],
    target: NDArray[np.float64],
) -> tuple[Counts, ForceSearch]:
    """Return the counts without C, which the first encoding of the search adds, and the search."""
    plain: list[Counts] = []
    edges, encoder = condition.bin_edges, (condition.normalisation, condition.parameters)

    def count_first(c: NDArray[np.float64]) -> Counts:
        scale = np.tile(c, (len(trials), 1))
        without, with_c = count_spikes_without_and_with_c(trials, edges, *encoder, scale)
        plain.append(without)
        return with_c

    search = search_c(trials, reading, target, *encoder, bin_edges=edges, first_counts=count_first)
    return plain[0], search


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


def join_force_matrix(conditions: Sequence[ConditionTask], found: Sequence[Arrays]) -> ForceMatrix:
    """Return the C of all conditions; those that were not searched have none (ABSENT)."""
    textures = tuple(sorted({condition.texture for condition in conditions}))
    speeds = tuple(sorted({condition.speed_mm_s for condition in conditions}))
    pairs = zip(conditions, found, strict=True)
    searched = [(condition, arrays) for condition, arrays in pairs if "c" in arrays]
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
