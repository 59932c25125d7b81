"""The remarks of an import that the reader of an analysis needs."""

from __future__ import annotations

from pathlib import Path

from rigctl.analysis.data.trial_set import TrialSet
from rigctl.session.format.header import IMPORTED
from rigctl.session.read.session import Session

EVENT_KIND = "import"
"""Kind of the events in which an import records its remarks."""
WHOLE_IMPORT = ("sampled too slowly", "forces are levels", "rows a second: taken at 1 kHz")
"""Words of the remarks that concern every trial."""


def imported_remarks(trials: TrialSet) -> list[str]:
    """Return the sentences that concern a whole import, and the number of the other ones."""
    remarks = []
    for path, source in zip(trials.paths, trials.provenance, strict=True):
        if source["rig"] == IMPORTED:
            remarks += _remarks_of(path)
    return remarks


def _remarks_of(path: Path) -> list[str]:
    with Session.open(path) as session:
        lines = [event.text for event in session.events if event.kind == EVENT_KIND]
    remarks = [f"{path}: {line}" for line in lines if any(words in line for words in WHOLE_IMPORT)]
    if len(lines) > len(remarks):
        remarks.append(
            f"{path}: its events (kind {EVENT_KIND}) hold {len(lines) - len(remarks)} more remarks "
            "on single files"
        )
    return remarks
