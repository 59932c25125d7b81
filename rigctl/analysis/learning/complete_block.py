"""Choose the trials of one point of a learning curve: plates that have the same conditions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

Condition = tuple[float, float, float]
"""Speed in mm/s, force in g, depth in mm."""
RecordedTrials = Mapping[str, Mapping[Condition, Sequence[int]]]
"""Rows of the trials of each plate by their condition, in the order of recording."""


class CompleteBlock(NamedTuple):
    """Plates that all have some conditions, each with as many trials as asked for."""

    plates: tuple[str, ...]
    conditions: tuple[Condition, ...]


def largest_block(trials: RecordedTrials, n_trials: int) -> CompleteBlock:
    """Return the most plates × conditions with at least ``n_trials`` each; empty for one plate.

    A plate that is still being recorded takes part as soon as the block grows by it: a classifier
    that knew one plate at one speed only would tell speeds apart, not plates.
    """
    full = {
        plate: frozenset(key for key, rows in cells.items() if len(rows) >= n_trials)
        for plate, cells in trials.items()
    }
    best = CompleteBlock((), ())
    for conditions in set(full.values()) - {frozenset()}:
        plates = tuple(sorted(plate for plate, has in full.items() if has >= conditions))
        block = CompleteBlock(plates, tuple(sorted(conditions)))
        if len(plates) > 1 and _rank(block) > _rank(best):
            best = block
    return best


def rows_of(trials: RecordedTrials, block: CompleteBlock, n_trials: int) -> list[int]:
    """Return the rows of the first ``n_trials`` of each plate and condition of a block."""
    return [
        row
        for plate in block.plates
        for condition in block.conditions
        for row in trials[plate][condition][:n_trials]
    ]


def _rank(block: CompleteBlock) -> tuple[int, int, tuple[Condition, ...]]:
    """Return what orders blocks: their cells, then their plates, then something fixed."""
    return len(block.plates) * len(block.conditions), len(block.plates), block.conditions
