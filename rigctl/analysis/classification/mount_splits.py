"""Splits by the mounting of a plate: does a classifier know the texture, or how its plate sat?"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.component_sweep import Labels, Rows

MAX_FOLDS = 4
"""A set of more mountings leaves several out at once."""


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


def number_mountings(texture: Labels, places: Sequence[tuple[int, int]]) -> NDArray[np.int64]:
    """Return the mounting of each trial's plate, from 0 for each texture, int64 (n_trials,).

    ``places``: each trial's session and its mounting there: a plate was mounted anew in another
    session.
    """
    _, place = np.unique(np.array(places, np.int64).reshape(-1, 2), axis=0, return_inverse=True)
    numbers = np.empty(len(texture), np.int64)
    for label in np.unique(texture):
        rows = texture == label
        numbers[rows] = np.unique(place.reshape(-1)[rows], return_inverse=True)[1].reshape(-1)
    return numbers


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
