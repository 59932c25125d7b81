"""Pieces of the way from sessions to features, each of which can run in a process of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.fingerprint import look_at
from rigctl.analysis.data.trial_set import ScratchMemory, TrialReader, TrialRef, opened
from rigctl.encoding.batch import (
    Counts,
    counts_without_and_with,
    cuts_of,
    mean_level,
    sa_rates_hz,
    stretch_counts,
)
from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.force_search import ForceSearch, search_to
from rigctl.encoding.kernel.prefetch import TrialRows
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.errors import WrongUse
from rigctl.session.read.sample_index import SampleFile, SampleFiles


class ConditionTask(NamedTuple):
    """All trials of one texture at one speed; ``given``: C by force instead of a search."""

    files: SampleFiles
    trials: tuple[TrialRef, ...]
    normalisation: Normalisation
    parameters: EncoderParameters
    layouts: tuple[FeatureLayout, FeatureLayout]
    forces_g: tuple[float, ...]
    reference_g: float
    given: tuple[NDArray[np.float64], ...]

    @property
    def lengths(self) -> list[int]:
        """Samples of each trial."""
        return [trial.place.stop - trial.place.start for trial in self.trials]

    @property
    def cuts(self) -> NDArray[np.int64]:
        """Of the stretches in which the spikes are counted."""
        return cuts_of(self.layouts, max(self.lengths), self.trials[0].speed_mm_s)

    def rows_at(self, force_g: float) -> list[int]:
        """Trials made at one force."""
        return [i for i, trial in enumerate(self.trials) if trial.force_g == force_g]

    @property
    def scaled_rows(self) -> list[int]:
        """Trials whose SA current a C changes."""
        if self.given:
            ones = {f for f, c in zip(self.forces_g, self.given, strict=True) if (c == 1.0).all()}
        else:
            ones = {self.reference_g}
        return [i for i, trial in enumerate(self.trials) if trial.force_g not in ones]


Arrays = dict[str, NDArray[Any]]
SCRATCH = ScratchMemory()
AT_A_LOOK = 32
"""Trials that are read before they are looked at: so few are still in the processor's cache."""


def fingerprints_of(job: tuple[dict[int, SampleFile], tuple[TrialRef, ...]]) -> Arrays:
    """Of some trials: ``hashes`` uint64 (n,); ``low``, ``high`` uint16 (n, n_taxels)."""
    files, trials = job
    with opened(files) as samples:
        looks = [
            look_at(*samples.block_of(trials[first : first + AT_A_LOOK], SCRATCH))
            for first in range(0, len(trials), AT_A_LOOK)
        ]
    hashes, low, high = (np.concatenate(parts) for parts in zip(*looks, strict=True))
    return {"hashes": hashes, "low": low, "high": high}


def counted_condition(condition: ConditionTask) -> Arrays:
    """Spikes of one texture and speed in stretches of time.

    With a C that is given: ``forced``, SA counts of :attr:`ConditionTask.scaled_rows` alone. Else
    ``plain``, counts of all trials; and where there are forces, ``forced`` with the C found, and
    that C: ``c``, ``status``, ``residual_hz``, ``evaluations``, each (n_taxels, n_forces).
    Counts are (trials, trains, stretches) in the narrowest type that holds them.
    """
    with opened(condition.files) as samples:
        if condition.given:
            return {"forced": _narrow(_given(condition, samples))}
        if condition.forces_g:
            return _searched(condition, samples)
        every = range(len(condition.trials))
        return {"plain": _narrow(_counts(condition, _read(condition, samples, every)))}


def _read(condition: ConditionTask, samples: TrialReader, which: Sequence[int]) -> TrialRows:
    """Readings of some trials, in memory that the next call in this thread takes back."""
    if not which:
        return TrialRows.of([])
    return TrialRows.within(*samples.block_of([condition.trials[i] for i in which], SCRATCH))


def _counts(
    condition: ConditionTask, rows: TrialRows, scale: NDArray[np.float64] | None = None
) -> Counts:
    """Counts of both channels, or with a C of SA alone: it changes nothing in RA."""
    return stretch_counts(
        rows,
        condition.cuts,
        condition.normalisation,
        condition.parameters,
        sa_scale=scale,
        sa_only=scale is not None,
    )


def _given(condition: ConditionTask, samples: TrialReader) -> Counts:
    """SA counts of the trials that a C changes, with the C that is given."""
    by_force = dict(zip(condition.forces_g, condition.given, strict=True))
    which = condition.scaled_rows
    scale = np.array([by_force[condition.trials[i].force_g] for i in which])
    return _counts(condition, _read(condition, samples, which), scale)


def _searched(condition: ConditionTask, samples: TrialReader) -> Arrays:
    """Counts without C; C at each force, and the SA counts that it makes.

    The trials of one force are read at a time: so many stay in the processor's last cache.
    """
    n_taxels, n_trials = condition.normalisation.n_taxels, len(condition.trials)
    plain = np.empty((n_trials, 2 * n_taxels, len(condition.cuts) - 1), np.uint32)
    which = condition.rows_at(condition.reference_g)
    reference = _read(condition, samples, which)
    plain[which] = _counts(condition, reference)
    lengths = reference.lengths.tolist()
    target = sa_rates_hz(plain[which, :n_taxels], lengths, condition.parameters)
    goal = mean_level(reference, condition.normalisation)
    forced = np.empty_like(plain[:, :n_taxels])
    shape = (n_taxels, len(condition.forces_g))
    found: Arrays = {"c": np.ones(shape), "status": np.zeros(shape, np.int8)}
    found |= {"residual_hz": np.zeros(shape), "evaluations": np.zeros(shape)}
    for f, force in enumerate(condition.forces_g):
        if force == condition.reference_g:
            continue
        which = condition.rows_at(force)
        rows = _read(condition, samples, which)
        plain[which], search = _search(condition, rows, goal, target)
        forced[which] = search.counts
        found["c"][:, f], found["status"][:, f] = search.c, search.status
        found["residual_hz"][:, f] = search.rate_hz - target
        found["evaluations"][:, f] = search.evaluations
    return {"plain": _narrow(plain), "forced": _narrow(forced[condition.scaled_rows]), **found}


def _search(
    condition: ConditionTask,
    rows: TrialRows,
    goal: NDArray[np.float64],
    target: NDArray[np.float64],
) -> tuple[Counts, ForceSearch]:
    """Counts without C at one force, and its C: the first of them is tried along with none."""
    plain: list[Counts] = []
    cuts, ways = condition.cuts, (condition.normalisation, condition.parameters)

    def first(c: NDArray[np.float64]) -> Counts:
        scale = np.tile(c, (len(rows), 1))
        without, with_c = counts_without_and_with(rows, cuts, *ways, scale)
        plain.append(without)
        return with_c

    search = search_to(rows, goal, target, *ways, cuts=cuts, first=first)
    return plain[0], search


def _narrow(counts: Counts) -> NDArray[Any]:
    """Counts in as few bytes as they need: they travel between processes and stay in files."""
    return counts.astype(np.min_scalar_type(counts.max(initial=0)))


def with_force(plain: NDArray[Any], forced: NDArray[Any], rows: Sequence[int]) -> NDArray[Any]:
    """Counts of both channels where SA counts of some trials are others."""
    n_taxels = plain.shape[1] // 2
    counts: NDArray[Any] = plain.astype(np.uint32)
    counts[list(rows), :n_taxels] = forced
    return counts


def piece_of(condition: ConditionTask, found: Arrays) -> ForceMatrix:
    """The C of one texture and speed."""
    texture, speed = condition.trials[0].texture, condition.trials[0].speed_mm_s
    names = ("c", "status", "residual_hz", "evaluations")
    parts = [found[name][None, :, None, :] for name in names]
    return ForceMatrix((texture,), (speed,), condition.forces_g, condition.reference_g, *parts)


def joined_matrix(pieces: Sequence[ForceMatrix]) -> ForceMatrix:
    """One matrix out of those of single textures and speeds, which come in sorted order."""
    textures = tuple(sorted({piece.textures[0] for piece in pieces}))
    speeds = tuple(sorted({piece.speeds_mm_s[0] for piece in pieces}))
    if len(textures) * len(speeds) != len(pieces):
        raise WrongUse("the force matrix lacks a texture at some speed")

    def joined(name: str) -> NDArray[np.float64]:
        rows = [
            np.concatenate([getattr(p, name) for p in pieces if p.textures[0] == texture], axis=2)
            for texture in textures
        ]
        return np.concatenate(rows, axis=0)

    first = pieces[0]
    return ForceMatrix(
        textures,
        speeds,
        first.forces_g,
        first.reference_g,
        joined("c"),
        joined("status").astype(np.int8),
        joined("residual_hz"),
        joined("evaluations"),
    )
