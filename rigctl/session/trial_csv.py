"""Write all attempts at a session's trials with their notes as CSV, for a spreadsheet."""

from __future__ import annotations

import csv
from pathlib import Path

from rigctl.session.session import open_session
from rigctl.session.session_reader import SessionReader

COUNTS, WHY_NOT, NOTES, SIMULATED = "counts", "why_not", "notes", "simulated"
"""Columns behind those of the table of trials."""
REPEATED = "repeated"
"""What ``why_not`` says of an attempt where another one at its trial counts."""


def write_trials(session: Path, out: Path) -> None:
    """Write a row for each attempt into a file; notes on the whole session are comments above.

    Raises SessionError for another kind of folder.
    """
    with open_session(session) as opened, out.open("w", encoding="utf-8", newline="") as file:
        general = [note for note in opened.notes if not note.trial_id]
        file.writelines(f"# {note.made_utc} {note.describe()}\n" for note in general)
        writer = csv.writer(file, lineterminator="\n")
        names = opened.trials.dtype.names or ()
        writer.writerow((*names, COUNTS, WHY_NOT, NOTES, SIMULATED))
        writer.writerows(_rows(opened))


def _rows(session: SessionReader) -> list[tuple[object, ...]]:
    simulated = "yes" if session.header.simulated else "no"
    attempts = zip(session.trials.tolist(), judge_attempts(session), strict=True)
    return [(*row, *judged, simulated) for row, judged in attempts]


def judge_attempts(session: SessionReader) -> list[tuple[str, str, str]]:
    """Return of each attempt whether it counts (yes or no), why not, and the notes on it."""
    counted = set(session.committed().tolist())
    left_out, repeated, notes = session.left_out, session.repeated, session.trial_notes()
    return [
        (
            "yes" if index in counted else "no",
            "; ".join(filter(None, (left_out.get(index), REPEATED if index in repeated else ""))),
            notes.get(index, ""),
        )
        for index in range(len(session.trials))
    ]
