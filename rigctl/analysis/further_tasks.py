"""Tasks beyond the paper's: an entry of :data:`FURTHER` with its splits is all that one needs.

The command line, the window's form, tables and figures follow from the entries. They are read at
each start, so this module loads no classifier.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.published import Task
from rigctl.errors import WrongUse

Rows = NDArray[np.intp]
TrainAndTests = tuple[Rows, dict[str, Rows]]
"""Training rows of one fit, and its test rows by the key of a task."""


class Trials(Protocol):
    """What splits are drawn from: :class:`rigctl.analysis.splits.Design`, arrays (n_trials,)."""

    @property
    def texture(self) -> NDArray[np.int64]:
        """Number of each trial's texture."""

    @property
    def speed_mm_s(self) -> NDArray[np.float64]:
        """Planned speed of each trial."""

    @property
    def force_g(self) -> NDArray[np.float64]:
        """Planned force of each trial."""

    @property
    def textures(self) -> tuple[str, ...]:
        """Names of the textures."""

    @property
    def settings(self) -> Any:
        """The settings of the analysis."""

    def conditions(self) -> Iterable[Rows]:
        """Return the trials of each texture, speed and force."""


class Family(NamedTuple):
    """Tasks with the same splits; ``name`` is what ``--task`` takes, ``title`` what the form shows.

    ``splits`` draws one iteration. It raises WrongUse, with the reason, where the trials do not
    allow it.
    """

    name: str
    title: str
    tasks: tuple[Task, ...]
    splits: Callable[[Trials, np.random.Generator], list[TrainAndTests]]


def _each_speed(trials: Trials, random: np.random.Generator) -> list[TrainAndTests]:
    return _leave_one_out(trials, random, "leave-speed-out", trials.speed_mm_s)


def _each_force(trials: Trials, random: np.random.Generator) -> list[TrainAndTests]:
    return _leave_one_out(trials, random, "leave-force-out", trials.force_g)


def _leave_one_out(
    trials: Trials, random: np.random.Generator, key: str, levels: NDArray[np.float64]
) -> list[TrainAndTests]:
    """Draw three quarters of each condition; test each level on a fit of the other levels."""
    if len(np.unique(levels)) < 2:
        raise WrongUse("it needs two levels or more, one to leave out and one to train on")
    if len(trials.textures) < 2:
        raise WrongUse("it needs two textures or more")
    share = trials.settings.extrapolation.trained_share
    drawn = np.concatenate(
        [
            random.permutation(rows)[: max(1, round(len(rows) * share))]
            for rows in trials.conditions()
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
    ("extrapolation", "Extrapolation (Fig. 3C–F)"),
    *((family.name, family.title) for family in FURTHER),
    ("leave-mount-out", "Leave one mounting out"),
)
"""What ``--task`` takes, and how the window's form names it."""
