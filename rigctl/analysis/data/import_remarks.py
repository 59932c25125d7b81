"""What was said when recordings were imported, for whoever reads an analysis of them."""

from __future__ import annotations

from pathlib import Path

from rigctl.analysis.data.trial_set import TrialSet
from rigctl.session.format.header import IMPORTED
from rigctl.session.read.session import Session

EVENT_KIND = "import"
"""Of the events of an imported session that say what was found."""
TOLD = ("sampled too slowly", "forces are levels", "rows a second: taken at 1 kHz")
"""Words of the lines that bear on every trial."""


def imported_remarks(trials: TrialSet) -> list[str]:
    """Sentences that bear on a whole import, and how many others its events hold."""
    said = []
    for path, source in zip(trials.paths, trials.provenance, strict=True):
        if source["rig"] == IMPORTED:
            said += _remarks_of(path)
    return said


def _remarks_of(path: Path) -> list[str]:
    with Session.open(path) as session:
        lines = [event.text for event in session.events if event.kind == EVENT_KIND]
    told = [line for line in lines if any(words in line for words in TOLD)]
    said = [f"{path}: {line}" for line in told]
    if len(lines) > len(told):
        said.append(
            f"{path}: {len(lines) - len(told)} more remarks on single files stand in its events "
            "(kind import)"
        )
    return said
