"""Tasks beyond the paper's: an entry of :data:`FURTHER` with its splits is all that one needs.

The command line, the window's form, tables and figures follow from the entries. They are read at
each start, so this module loads no classifier.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.published import Task
from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from rigctl.analysis.trial_set import Design

EXTRAPOLATION = "extrapolation"
"""Family of Figures 3C to 3F."""
Rows = NDArray[np.intp]
TrainAndTests = tuple[Rows, dict[str, Rows]]
"""Training rows of one fit, and its test rows by the key of a task."""


class Family(NamedTuple):
    """Tasks with the same splits; ``name`` is what ``--task`` takes, ``title`` what the form shows.

    ``splits`` draws one iteration. It raises WrongUse, with the reason, where the trials do not
    allow it.
    """

    name: str
    title: str
    tasks: tuple[Task, ...]
    splits: Callable[[Design, np.random.Generator], list[TrainAndTests]]


def _each_speed(design: Design, random: np.random.Generator) -> list[TrainAndTests]:
    return _leave_one_out(design, random, "leave-speed-out", design.speed_mm_s)


def _each_force(design: Design, random: np.random.Generator) -> list[TrainAndTests]:
    return _leave_one_out(design, random, "leave-force-out", design.force_g)


def _leave_one_out(
    design: Design, random: np.random.Generator, key: str, levels: NDArray[np.float64]
) -> list[TrainAndTests]:
    """Draw three quarters of each condition; test each level on a fit of the other levels."""
    if len(np.unique(levels)) < 2:
        raise WrongUse("it needs two levels or more, one to leave out and one to train on")
    if len(design.textures) < 2:
        raise WrongUse("it needs two textures or more")
    share = design.settings.extrapolation.trained_share
    drawn = np.concatenate(
        [
            random.permutation(rows)[: max(1, round(len(rows) * share))]
            for rows in design.conditions()
        ]
    )
    return [
        (drawn[levels[drawn] != level], {key: drawn[levels[drawn] == level]})
        for level in np.unique(levels)
    ]


FURTHER = (
    Family(
        "leave-speed-out",
        "Leave one speed out",
        (Task("leave-speed-out", "Each speed left out", "", "leave-speed-out"),),
        _each_speed,
    ),
    Family(
        "leave-force-out",
        "Leave one force out",
        (Task("leave-force-out", "Each force left out", "", "leave-force-out"),),
        _each_force,
    ),
)
TASKS = (
    *published.TASKS,
    *(task for family in FURTHER for task in family.tasks),
    *published.MOUNT_TASKS,
)
"""Every task, in the order of a report."""
OFFERED = (
    ("textures", "Individual textures"),
    ("groups", "Texture groups"),
    (EXTRAPOLATION, "Extrapolation (Fig. 3C–F)"),
    *((family.name, family.title) for family in FURTHER),
    ("leave-mount-out", "Leave one mounting out"),
)
"""What ``--task`` takes, and how the window's form names it."""
