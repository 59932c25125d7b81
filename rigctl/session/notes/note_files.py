"""The notes of a session: ``note-YYYYMMDDThhmmssZ.json`` beside its parts, one file for each.

A second one of the same second is ``note-YYYYMMDDThhmmssZ-002.json``. A file is written once and
never changed; what a later note says of a trial holds.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from rigctl.errors import SessionError
from rigctl.session.format.sealed_json import read_sealed
from rigctl.session.notes.session_note import Mark, SessionNote, parse_note

PATTERN = "note-*.json"
MAX_BYTES = 64 << 10
_NAME = re.compile(r"note-(\d{8}T\d{6}Z)(?:-(\d{3}))?\.json")
_REMEDY = "what it says is lost; move it elsewhere and write the note again"

Attempt = tuple[int, int]
"""Number of a trial, and number of the attempt at it."""


def read_notes(folder: Path) -> tuple[SessionNote, ...]:
    """Return the intact notes of a session, oldest first."""
    found = []
    for path in _note_paths(folder):
        with suppress(SessionError):  # damaged_notes names it
            found.append(_read(path))
    return tuple(found)


def damaged_notes(folder: Path) -> list[str]:
    """Return a sentence for each note that cannot be read or was altered."""
    lines = []
    for path in _note_paths(folder):
        try:
            _read(path)
        except SessionError as error:
            lines.append(str(error))
    return lines


def bad_attempts(notes: Iterable[SessionNote]) -> dict[Attempt, SessionNote]:
    """Return the attempts that are marked bad, with the note that says so."""
    marked = {(note.trial_id, note.attempt): note for note in notes if note.mark}
    return {attempt: note for attempt, note in marked.items() if note.mark is Mark.BAD}


def _read(path: Path) -> SessionNote:
    return parse_note(read_sealed(path, MAX_BYTES, _REMEDY), path)


def _note_paths(folder: Path) -> list[Path]:
    """Return the paths of all notes, oldest first."""
    names = [(path, _NAME.fullmatch(path.name)) for path in folder.glob(PATTERN)]
    dated = [((found[1], int(found[2] or 1)), path) for path, found in names if found]
    return [path for _, path in sorted(dated)]
