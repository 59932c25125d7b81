"""Splits of trials into training and test: folds, extrapolation, and a mounting left out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.further_tasks import (
    FURTHER,
    LEVELS_LEFT_OUT,
    TASK_FAMILIES,
    textures_at_one_level,
)
from rigctl.analysis.pca_lda import Labels, Rows, Split
from rigctl.analysis.trial_set import Design
from rigctl.errors import WrongUse

MAX_FOLDS = 4
"""A set of more mountings leaves several out at once."""
Fold = tuple[Rows, Rows]
"""Training rows and test rows."""
FAMILIES = ("folds", "extrapolation", "leave-speed-out", "leave-force-out", "leave-mount-out")
"""Their places seed the draws, so a further family comes behind these."""
EXTRAPOLATIONS = {
    (True, True): "trained-both",
    (True, False): "untrained-force",
    (False, True): "untrained-speed",
    (False, False): "untrained-both",
}
"""Task that tests a condition, by whether its speed and its force are trained."""
LEAST_TRIALS = {"folds": 2, "extrapolation": 1}
"""Trials without which a family leaves a texture out."""
UNTRAINED_SPEED = "-untrained-speed"
"""Ending of the tasks that test mountings at untrained speeds."""


class MountCell(NamedTuple):
    """The trials of one condition in one mounting: those drawn to train on, and the rest."""

    mount: int
    drawn: Rows
    rest: Rows

    @property
    def held_out(self) -> Rows:
        """The rest; of a single trial, that one."""
        return self.rest if len(self.rest) else self.drawn


class MountSplit(NamedTuple):
    """Training rows, and test rows of the same mountings and of those that were left out."""

    train: Rows
    same: Rows
    other: Rows


def mounted_again(texture: Labels, mount: Labels) -> NDArray[np.int64]:
    """Return the labels of the textures whose plates were mounted at least twice, int64.

    ``mount``: from 0; empty if unknown.
    """
    return np.unique(texture[np.flatnonzero(mount > 0)])


def draw_cells(
    conditions: Iterable[Rows], mount: Labels, share: float, random: np.random.Generator
) -> list[MountCell]:
    """Draw a share of each condition in each mounting, but not all of several trials.

    ``conditions``: the rows of each texture, speed and force.
    """
    cells = []
    for rows in conditions:
        for number in np.unique(mount[rows]).tolist():
            shuffled = random.permutation(rows[mount[rows] == number])
            n_drawn = min(max(1, round(len(shuffled) * share)), max(1, len(shuffled) - 1))
            cells.append(MountCell(number, shuffled[:n_drawn], shuffled[n_drawn:]))
    return cells


def split_mountings(
    trained: Sequence[MountCell], tested: Sequence[MountCell], texture: Labels
) -> list[MountSplit]:
    """Leave out each mounting in turn, at most four times; train on what was drawn of the others.

    No trial is tested by a fit that trained on it, nor one of a texture that the fit does not know.
    There is no split where the conditions to train on have a single mounting, nor one whose fit
    would know a single texture.
    """
    n_folds = min(MAX_FOLDS, 1 + max((cell.mount for cell in trained), default=0))
    splits: list[MountSplit] = []
    if n_folds < 2:
        return splits
    for fold in range(n_folds):
        train = _joined(cell.drawn for cell in trained if cell.mount % n_folds != fold)
        if len(np.unique(texture[train])) < 2:
            continue
        same = _joined(cell.held_out for cell in tested if cell.mount % n_folds != fold)
        other = _joined(cell.held_out for cell in tested if cell.mount % n_folds == fold)
        known = [rows[np.isin(texture[rows], texture[train])] for rows in (same, other)]
        splits.append(MountSplit(train, known[0][~np.isin(known[0], train)], known[1]))
    return splits


def _joined(rows: Iterable[Rows]) -> Rows:
    return np.concatenate([np.empty(0, np.int64), *rows])


def make_splits(design: Design, family: str, seed: int, iteration: int) -> list[Split]:
    """Return the splits of one iteration, equal for every representation.

    Raises :class:`WrongUse`, with the reason, where the trials do not allow them.
    """
    seeds = tuple(dict.fromkeys((*FAMILIES, *(one.name for one in FURTHER))))
    # The draws of a plug-in's tasks depend on no other plug-in.
    place = seeds.index(family) if family in seeds else crc32(family.encode())
    random = np.random.default_rng([seed, iteration, place])
    if family == "folds":
        return _folds(design, random)
    if family == "extrapolation":
        return [_extrapolation(design, random)]
    if family == "leave-mount-out":
        return _leave_mount_out(design, random)
    found = TASK_FAMILIES.load(family)
    assert found is not None  # those of the paper are above
    with TASK_FAMILIES.blamed(family):
        return [Split(*split) for split in found.splits(design, random)]


def extrapolation_fits(design: Design) -> bool:
    """Return whether the set has the trained speeds and forces, and others to test."""
    conditions = design.settings.conditions
    taken = [
        (speed_mm_s, force_g)
        for speed_mm_s, force_g in zip(
            design.speed_mm_s.tolist(), design.force_g.tolist(), strict=True
        )
        if conditions.takes(speed_mm_s, force_g)
    ]
    return (
        set(conditions.trained_speeds_mm_s) < {speed_mm_s for speed_mm_s, _ in taken}
        and set(conditions.trained_forces_g) < {force_g for _, force_g in taken}
        and len(design.textures) - len(textures_left_out(design, "extrapolation")) > 1
    )


def textures_left_out(design: Design, family: str) -> tuple[str, ...]:
    """Return the textures that a family cannot use: those with nothing to train on or to test.

    The folds need two trials of a texture, the extrapolation one of a trained condition, the
    mountings a second one.
    """
    if family == "leave-mount-out":
        again = mounted_again(design.texture, design.mount).tolist()
        return tuple(name for label, name in enumerate(design.textures) if label not in again)
    if family in LEVELS_LEFT_OUT:
        rows = textures_at_one_level(design, getattr(design, LEVELS_LEFT_OUT[family]))
        return tuple(design.textures[label] for label in np.unique(design.texture[rows]))
    counted = np.ones(len(design.texture), bool)
    if family == "extrapolation":
        counted = _is_trained(design)
    counts = np.bincount(design.texture[counted], minlength=len(design.textures))
    least = LEAST_TRIALS.get(family, 0)
    return tuple(name for name, n in zip(design.textures, counts, strict=True) if n < least)


def _is_trained(design: Design) -> NDArray[np.bool_]:
    conditions = design.settings.conditions
    trained = np.isin(design.speed_mm_s, conditions.trained_speeds_mm_s)
    return np.asarray(trained & np.isin(design.force_g, conditions.trained_forces_g))


def _folds(design: Design, random: np.random.Generator) -> list[Split]:
    """Return the folds over a random third of each texture's trials."""
    settings = design.settings.folds
    counts = np.bincount(design.texture, minlength=len(design.textures))
    used = np.flatnonzero(counts >= LEAST_TRIALS["folds"])
    if len(used) < 2:
        raise WrongUse("it needs two textures or more, with two trials or more of each")
    n_folds = int(min(settings.count, counts[used].min()))
    # A third, but at least one trial for each fold.
    sizes = [max(round(n * settings.drawn_share), n_folds) for n in counts[used].tolist()]
    rows = [random.permutation(np.flatnonzero(design.texture == t)) for t in used]
    drawn = np.concatenate([one[:size] for one, size in zip(rows, sizes, strict=True)])
    labels = np.searchsorted(used, design.texture[drawn])
    folds = stratified_folds(labels, n_folds, int(random.integers(2**63)))
    grouped = design.group_labels >= 0
    splits = []
    for train, test in folds:
        tested = drawn[test]
        tests = {"textures": tested, "groups": tested[grouped[tested]]}
        splits.append(Split(drawn[train], {key: rows for key, rows in tests.items() if len(rows)}))
    return splits


def _leave_mount_out(design: Design, random: np.random.Generator) -> list[Split]:
    """Leave out mountings; test them, and what was not drawn of those that are trained.

    Where the extrapolation fits, further fits train on its conditions and test untrained speeds.
    """
    again = mounted_again(design.texture, design.mount)
    if len(again) < 2:
        raise WrongUse(
            "it needs two plates or more that were mounted again: give mounts = 2 in the protocol"
        )
    conditions = [rows for rows in design.conditions() if design.texture[rows[0]] in again]
    splits = _mount_splits(design, random, conditions, conditions, "")
    if extrapolation_fits(design):
        levels = [_trained_levels(design, rows) for rows in conditions]
        trained, untrained_speed = (
            [rows for rows, level in zip(conditions, levels, strict=True) if level == wanted]
            for wanted in ((True, True), (False, True))
        )
        splits += _mount_splits(design, random, trained, untrained_speed, UNTRAINED_SPEED)
    return splits


def _mount_splits(
    design: Design,
    random: np.random.Generator,
    trained: list[Rows],
    tested: list[Rows],
    suffix: str,
) -> list[Split]:
    """Return the splits of conditions to train and to test on, with their tasks' keys."""
    share, mount = design.settings.extrapolation.trained_share, design.mount
    cells = draw_cells(trained, mount, share, random)
    others = cells if tested is trained else draw_cells(tested, mount, share, random)
    splits = []
    for train, same, other in split_mountings(cells, others, design.texture):
        tests = {f"trained-mount{suffix}": same, f"leave-mount-out{suffix}": other}
        splits.append(Split(train, {key: rows for key, rows in tests.items() if len(rows)}))
    return splits


def _trained_levels(design: Design, rows: Rows) -> tuple[bool, bool] | None:
    """Return whether the extrapolation trains a speed and force; None for one without a part."""
    conditions = design.settings.conditions
    level = float(design.speed_mm_s[rows[0]]), float(design.force_g[rows[0]])
    if not conditions.takes(*level):
        return None
    return conditions.trains_speed(level[0]), conditions.trains_force(level[1])


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
    settings, conditions = design.settings.extrapolation, design.settings.conditions
    if not extrapolation_fits(design):
        raise WrongUse(
            f"it needs {conditions.training_text} of two textures or more, and another speed and "
            "force"
        )
    left_out = {design.textures.index(n) for n in textures_left_out(design, "extrapolation")}
    train: list[Rows] = []
    tests: dict[str, list[Rows]] = {}
    for rows in design.conditions():
        trained = _trained_levels(design, rows)
        if design.texture[rows[0]] in left_out or trained is None:
            continue
        shuffled, n = random.permutation(rows), len(rows)
        if all(trained):
            n_train = min(max(1, round(n * settings.trained_share)), max(1, n - 1))
            train.append(shuffled[:n_train])
            tested = shuffled[n_train:]
        else:
            tested = shuffled[: max(1, round(n * settings.tested_share))]
        tests.setdefault(EXTRAPOLATIONS[trained], []).append(tested)
    joined = {key: np.concatenate(rows) for key, rows in tests.items() if rows}
    return Split(np.concatenate(train), {key: rows for key, rows in joined.items() if len(rows)})
