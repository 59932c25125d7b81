"""Analyses beside the tasks, each on the trials, draws and folds of the report: ``--also NAME``.

An entry of :data:`ANALYSES` and its module are all that one needs; command line, form, report and
files follow. The entries are read at each start, so a module is loaded where its analysis runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from rigctl.analysis.study import Findings, Study


class FurtherAnalysis(NamedTuple):
    """An analysis; ``name`` is what ``--also`` takes, ``title`` what form and report show.

    Its module has ``measure``, which takes a Study and returns Findings. It raises WrongUse, with
    the reason, where the trials do not allow it.
    """

    name: str
    title: str
    module: str


ANALYSES = (
    FurtherAnalysis("stages", "Figure 1B, every stage", "rigctl.analysis.stages"),
    FurtherAnalysis("invariance", "One taxel, every module", "rigctl.analysis.invariance"),
    FurtherAnalysis("c", "C, and rates by force", "rigctl.analysis.c_figure"),
    FurtherAnalysis("loadings", "Loadings of components", "rigctl.analysis.loadings"),
    FurtherAnalysis("ranges", "Both taxel ranges", "rigctl.analysis.range_comparison"),
    FurtherAnalysis("trains", "Some of the trains", "rigctl.analysis.train_choice"),
    FurtherAnalysis("lost", "Taxels lost one by one", "rigctl.analysis.lost_taxels"),
    FurtherAnalysis("noise", "Noise on the readings", "rigctl.analysis.reading_noise"),
    FurtherAnalysis("classifiers", "Other classifiers", "rigctl.analysis.classifiers"),
    FurtherAnalysis("training", "Training trials", "rigctl.analysis.training_curve"),
    FurtherAnalysis("poisson", "A Poisson control", "rigctl.analysis.poisson_control"),
    FurtherAnalysis("distances", "Distances of spike trains", "rigctl.analysis.train_distances"),
)
OFFERED = (("", "Nothing more"), *((one.name, one.title) for one in ANALYSES))
"""What ``--also`` takes, and how the window's form names it."""


def check_names(names: Sequence[str]) -> None:
    """Raise WrongUse for a name that is no analysis."""
    known = [one.name for one in ANALYSES]
    for name in names:
        if name not in known:
            raise WrongUse(f"no further analysis {name!r}: choose from {', '.join(known)}")


def run_further(names: Sequence[str], study: Study) -> tuple[dict[str, Findings], tuple[str, ...]]:
    """Return the findings of the named analyses, and a remark on each that the trials lack."""
    found: dict[str, Findings] = {}
    remarks = []
    for one in (one for one in ANALYSES if one.name in names):
        try:
            found[one.name] = import_module(one.module).measure(study)
        except WrongUse as reason:
            remarks.append(f"{one.title.lower()}: left out, {reason}")
    return found, tuple(remarks)
