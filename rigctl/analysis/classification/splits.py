"""Training and test trials: the paper's draws, folds and extrapolation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.component_sweep import Labels, Rows
from rigctl.analysis.data.trial_set import TrialSet
from rigctl.analysis.paper import published
from rigctl.errors import WrongUse

Fold = tuple[Rows, Rows]
"""Training rows and test rows."""
FAMILIES = ("folds", "extrapolation", "leave-speed-out", "leave-force-out")
EXTRAPOLATIONS = {
    (True, True): "trained-both",
    (True, False): "untrained-force",
    (False, True): "untrained-speed",
    (False, False): "untrained-both",
}
"""Task that tests a condition, by whether its speed and its force are trained."""


@dataclass(frozen=True, slots=True)
class Design:
    """Labels and conditions of a set's trials, an element for each trial.

    ``texture``: int64 index into ``textures``; ``speed_mm_s``, ``force_g``: float64.
    """

    textures: tuple[str, ...]
    texture: NDArray[np.int64]
    speed_mm_s: NDArray[np.float64]
    force_g: NDArray[np.float64]

    @classmethod
    def from_trials(cls, trials: TrialSet) -> Design:
        """Return the design of a set of trials."""
        names = trials.textures
        return cls(
            names,
            np.array([names.index(t.texture) for t in trials.trials], np.int64),
            np.array([t.speed_mm_s for t in trials.trials]),
            np.array([t.force_g for t in trials.trials]),
        )

    @property
    def groups(self) -> tuple[str, ...]:
        """The paper's texture groups in the set; empty where a texture has none."""
        if not all(name in published.GROUPS for name in self.textures):
            return ()
        return tuple(dict.fromkeys(published.GROUPS[name] for name in self.textures))

    def classes(self, task: published.Task) -> tuple[str, ...]:
        """Return the class names of a task."""
        return self.groups if task.grouped else self.textures

    def labels(self, task: published.Task) -> NDArray[np.int64]:
        """Return the index of each trial's class in :meth:`classes`, int64."""
        if not task.grouped:
            return self.texture
        group = [self.groups.index(published.GROUPS[name]) for name in self.textures]
        return np.array(group, np.int64)[self.texture]

    def conditions(self) -> list[Rows]:
        """Return the rows of each texture × speed × force in the set, in a fixed order."""
        keys = np.stack([self.texture, self.speed_mm_s, self.force_g], axis=1)
        _, which = np.unique(keys, axis=0, return_inverse=True)
        order = np.argsort(which.reshape(-1), kind="stable")
        ends = np.cumsum(np.bincount(which.reshape(-1)))[:-1]
        return list(np.split(order, ends))


class Split(NamedTuple):
    """The training rows of one fit, and its test rows by task key."""

    train: Rows
    tests: dict[str, Rows]


def make_splits(design: Design, family: str, seed: int, iteration: int) -> list[Split]:
    """Return the splits of one iteration, equal for every representation.

    Raises :class:`WrongUse`, with the reason, where the trials do not allow them.
    """
    random = np.random.default_rng([seed, iteration, FAMILIES.index(family)])
    if family == "folds":
        return _folds(design, random)
    if family == "extrapolation":
        return [_extrapolation(design, random)]
    levels = design.speed_mm_s if family == "leave-speed-out" else design.force_g
    return _leave_one_out(design, random, family, levels)


def extrapolation_fits(design: Design) -> bool:
    """Return whether the set has the paper's trained speeds and forces, and others to test."""
    speeds, forces = set(design.speed_mm_s.tolist()), set(design.force_g.tolist())
    trained = np.isin(design.speed_mm_s, published.TRAINED_SPEEDS_MM_S)
    trained &= np.isin(design.force_g, published.TRAINED_FORCES_G)
    return (
        set(published.TRAINED_SPEEDS_MM_S) < speeds
        and set(published.TRAINED_FORCES_G) < forces
        and len(np.unique(design.texture[trained])) == len(design.textures)
    )


def _folds(design: Design, random: np.random.Generator) -> list[Split]:
    """Return the folds over a random third of each texture's trials."""
    counts = np.bincount(design.texture, minlength=len(design.textures))
    n_folds = int(min(published.N_FOLDS, counts.min()))
    if len(design.textures) < 2 or n_folds < 2:
        raise WrongUse("it needs two textures or more, with two trials or more of each")
    # A third, but at least one trial for each fold.
    sizes = [max(round(n * published.DRAWN_SHARE), n_folds) for n in counts.tolist()]
    rows = [random.permutation(np.flatnonzero(design.texture == t)) for t in range(len(counts))]
    drawn = np.concatenate([one[:size] for one, size in zip(rows, sizes, strict=True)])
    labels = design.texture[drawn]
    folds = stratified_folds(labels, n_folds, int(random.integers(2**63)))
    return [
        Split(drawn[train], {"textures": drawn[test], "groups": drawn[test]})
        for train, test in folds
    ]


def stratified_folds(labels: Labels, n_folds: int, seed: int) -> list[Fold]:
    """Return folds that spread each class as evenly as possible and test each row once.

    Raises :class:`WrongUse` where a class has fewer rows than there are folds.
    """
    fewest = int(np.bincount(labels).min())
    if not 2 <= n_folds <= fewest:
        raise WrongUse(f"{n_folds} folds cannot be made: the smallest class has {fewest} trials")
    random = np.random.default_rng(seed)
    fold_of = np.empty(len(labels), np.int64)
    dealt = 0
    for label in np.unique(labels):
        rows = random.permutation(np.flatnonzero(labels == label))
        # Each class starts in the fold after the last one used, so all folds have one size.
        fold_of[rows] = (dealt + np.arange(len(rows))) % n_folds
        dealt += len(rows)
    return [(np.flatnonzero(fold_of != f), np.flatnonzero(fold_of == f)) for f in range(n_folds)]


def _extrapolation(design: Design, random: np.random.Generator) -> Split:
    if not extrapolation_fits(design):
        raise WrongUse(
            "it needs 40, 60, 80 mm/s and 250, 500 g of every texture, and another speed and force"
        )
    train: list[Rows] = []
    tests: dict[str, list[Rows]] = {}
    for rows in design.conditions():
        shuffled, n = random.permutation(rows), len(rows)
        speed_is_trained = design.speed_mm_s[rows[0]] in published.TRAINED_SPEEDS_MM_S
        force_is_trained = design.force_g[rows[0]] in published.TRAINED_FORCES_G
        if speed_is_trained and force_is_trained:
            n_train = min(max(1, round(n * published.TRAINED_SHARE)), max(1, n - 1))
            train.append(shuffled[:n_train])
            tested = shuffled[n_train:]
        else:
            tested = shuffled[: max(1, round(n * published.TESTED_SHARE))]
        tests.setdefault(EXTRAPOLATIONS[speed_is_trained, force_is_trained], []).append(tested)
    joined = {key: np.concatenate(rows) for key, rows in tests.items() if rows}
    return Split(np.concatenate(train), {key: rows for key, rows in joined.items() if len(rows)})


def _leave_one_out(
    design: Design, random: np.random.Generator, family: str, levels: NDArray[np.float64]
) -> list[Split]:
    """Draw three quarters of each condition; test each level on a fit of the other levels."""
    if len(np.unique(levels)) < 2:
        raise WrongUse("it needs two levels or more, one to leave out and one to train on")
    if len(design.textures) < 2:
        raise WrongUse("it needs two textures or more")
    drawn = np.concatenate(
        [
            random.permutation(rows)[: max(1, round(len(rows) * published.TRAINED_SHARE))]
            for rows in design.conditions()
        ]
    )
    return [
        Split(drawn[levels[drawn] != level], {family: drawn[levels[drawn] == level]})
        for level in np.unique(levels)
    ]
