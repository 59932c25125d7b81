"""Add a note to a session: a new file beside its parts, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rigctl.errors import DiskFault, SessionError
from rigctl.session.format.sealed_json import sealed_text
from rigctl.session.notes.session_note import Mark, SessionNote, check_note
from rigctl.session.open_session import open_session
from rigctl.session.read.closing_digest import read_closing_digest
from rigctl.session.read.session_reader import SessionReader
from rigctl.session.write.part_writer import sync_folder
from rigctl.values import Verdict

MAX_IN_A_SECOND = 999


def add_note(folder: Path, note: SessionNote) -> Path:
    """Check a note against the session that it is about, and write it; return its path.

    Attempt 0 of a trial means its last committed attempt, else its last one. Raises SessionError
    for a wrong note and for another kind of folder, DiskFault where it cannot be written.
    """
    note = replace(note, closing_digest=read_closing_digest(folder))
    if note.trial_id:
        with open_session(folder) as session:
            note = _about_attempt(session, note)
    return write_note(folder, note)


def write_note(folder: Path, note: SessionNote) -> Path:
    """Write a note beside the parts; return its path.

    Raises SessionError for a wrong note, DiskFault where it cannot be written.
    """
    text = sealed_text(check_note(note).to_members())
    try:
        return _write_new(folder, note.made_utc, text)
    except OSError as error:
        raise DiskFault(
            f"{folder}: the note cannot be written ({error.strerror}): make room or choose another "
            "disk, the record is unchanged"
        ) from error


def _about_attempt(session: SessionReader, note: SessionNote) -> SessionNote:
    """Return the note with its attempt. Raises SessionError where the session has none."""
    trials = session.trials
    rows = trials[trials["trial_id"] == note.trial_id]
    committed = rows["attempt"][rows["verdict"] == Verdict.COMMITTED.value].tolist()
    attempts = rows["attempt"].tolist()
    attempt = note.attempt or max(committed or attempts, default=0)
    if attempt not in attempts:
        what = f"attempt {attempt} at trial" if note.attempt else "trial"
        raise SessionError(f"{session.path} has no {what} {note.trial_id}: name one that it has")
    if note.mark is Mark.GOOD:
        _refuse_second(session, note.trial_id, attempt)
    return replace(note, attempt=attempt)


def _refuse_second(session: SessionReader, trial_id: int, attempt: int) -> None:
    """Raise SessionError where another attempt at a trial counts already."""
    counted = session.trials[session.committed()]
    others = counted["attempt"][counted["trial_id"] == trial_id]
    if np.any(others != attempt):
        raise SessionError(
            f"trial {trial_id} was recorded again and attempt {others[0]} counts: mark that one "
            "bad first"
        )


def _write_new(folder: Path, made_utc: str, text: str) -> Path:
    """Write a file under the first free name of its second; whole, or not at all."""
    for path in _names(folder, made_utc):
        draft = path.with_name(f"{path.name}.new")
        if path.exists() or path.is_symlink():
            continue
        try:
            file = draft.open("x", encoding="utf-8")
        except FileExistsError:  # another process writes this one
            continue
        with file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():  # that process has just finished
            draft.unlink()
            continue
        draft.rename(path)
        sync_folder(folder)
        return path
    raise SessionError(f"{folder} has {MAX_IN_A_SECOND} notes of {made_utc}: wait a second")


def _names(folder: Path, made_utc: str) -> Iterator[Path]:
    stamp = made_utc.replace("-", "").replace(":", "")
    yield folder / f"note-{stamp}.json"
    for number in range(2, MAX_IN_A_SECOND + 1):
        yield folder / f"note-{stamp}-{number:03d}.json"
