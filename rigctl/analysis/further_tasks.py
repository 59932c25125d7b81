"""Tasks beyond the paper's: an entry of :data:`FURTHER` with its splits is all that one needs.

The command line, the window's form, tables and figures follow from the entries. They are read at
each start, so this module loads no classifier.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.published import Task
from rigctl.errors import WrongUse
from rigctl.plugins import Lookup, Plugin, installed

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


LEVELS_LEFT_OUT = {"leave-speed-out": "speed_mm_s", "leave-force-out": "force_g"}
"""Column of a design whose levels a family leaves out."""


def textures_at_one_level(design: Design, levels: NDArray[np.float64]) -> Rows:
    """Return the rows of textures with one level: no fit that leaves it out knows them."""
    single = [
        label
        for label in range(len(design.textures))
        if len(np.unique(levels[design.texture == label])) < 2
    ]
    return np.flatnonzero(np.isin(design.texture, single))


def _each_speed(design: Design, random: np.random.Generator) -> list[TrainAndTests]:
    return _leave_one_out(design, random, "leave-speed-out")


def _each_force(design: Design, random: np.random.Generator) -> list[TrainAndTests]:
    return _leave_one_out(design, random, "leave-force-out")


def _leave_one_out(design: Design, random: np.random.Generator, key: str) -> list[TrainAndTests]:
    """Draw three quarters of each condition; test each level on a fit of the other levels."""
    levels: NDArray[np.float64] = getattr(design, LEVELS_LEFT_OUT[key])
    if len(np.unique(levels)) < 2:
        raise WrongUse("it needs two levels or more, one to leave out and one to train on")
    unknown = textures_at_one_level(design, levels)
    if len(np.unique(np.delete(design.texture, unknown))) < 2:
        raise WrongUse("it needs two textures or more, each at two levels or more")
    share = design.settings.extrapolation.trained_share
    drawn = np.concatenate(
        [
            random.permutation(rows)[: max(1, round(len(rows) * share))]
            for rows in design.conditions()
        ]
    )
    drawn = drawn[~np.isin(drawn, unknown)]
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
"""Our tasks, in the order of a report."""


def _check(family: Family, plugin: Plugin) -> None:
    """Raise WrongUse for tasks under another name than the plug-in's, or under one of ours."""
    known = {task.key for task in TASKS}
    wrong = [t.key for t in family.tasks if t.key in known or t.family != plugin.name]
    if family.name != plugin.name or wrong:
        raise WrongUse(
            f"{plugin} has a wrong name or family in {', '.join(wrong) or family.name}: install "
            f"another version of {plugin.package}, or ask its author"
        )


_OURS = {
    "textures": "Individual textures",
    "groups": "Texture groups",
    EXTRAPOLATION: "Extrapolation (Fig. 3C–F)",
    **{family.name: family.title for family in FURTHER},
    "leave-mount-out": "Leave one mounting out",
}
OFFERED = (
    *_OURS.items(),
    *((one.name, f"{one.name} ({one.package})") for one in installed("task")),
)
"""What ``--task`` takes, and how the window's form names it."""
TASK_FAMILIES: Lookup[Family | None] = Lookup(
    "task", {**dict.fromkeys(_OURS), **{one.name: one for one in FURTHER}}, Family, _check
)
"""Families by name; :mod:`rigctl.analysis.splits` has the splits of the paper's."""


def tasks_of(names: Sequence[str]) -> tuple[Task, ...]:
    """Return our tasks, and behind them those of the plug-ins among ``names``. Raises WrongUse."""
    others = [
        family
        for name in names
        if TASK_FAMILIES.plugin(name) and (family := TASK_FAMILIES.load(name))
    ]
    return (*TASKS, *(task for family in others for task in family.tasks))
