"""Notes on a session and verdicts on its trials: one JSON file for each, beside the parts.

``note-YYYYMMDDThhmmssZ.json``; a second one of the same second is
``note-YYYYMMDDThhmmssZ-002.json``. A file is written once and never changed; what a later note says
of a trial holds.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from rigctl.config.text_file import read_bytes, refuse_link_outside, visible
from rigctl.errors import DiskFault, SessionError
from rigctl.session.writer_lock import sync_folder

KIND, VERSION = "rigctl-note", 1
MAX_LETTERS = 2000
MAX_AUTHOR_LETTERS = 200
MAX_AT_S = 1e6


class Mark(StrEnum):
    """A person's verdict on an attempt at a trial. ``NONE``: the note has none."""

    NONE = ""
    BAD = "bad"
    GOOD = "good"


@dataclass(frozen=True, slots=True)
class SessionNote:
    """A text with its time, ISO 8601 in UTC with seconds, such as ``2026-11-23T14:00:00Z``.

    ``trial_id`` and ``attempt`` are those of the trial that it is about, 0 for the whole session.
    ``at_s``: the moment in the trial, seconds since its first sample, None for all of it.
    A trial marked bad does not count; ``GOOD`` takes the mark back. ``closing_digest``: that of the
    session when the note was made, empty while it was recorded.
    """

    made_utc: str
    text: str
    trial_id: int = 0
    attempt: int = 0
    mark: Mark = Mark.NONE
    author: str = ""
    closing_digest: Annotated[str, Meta(pattern="^([0-9a-f]{64})?$")] = ""
    at_s: float | None = None

    @property
    def remark(self) -> str:
        """The text with what it says of its trial, without the trial's number."""
        at = f"at {self.at_s:.2f} s" if self.at_s is not None else ""
        mark = f"marked {self.mark}" if self.mark else ""
        about = ", ".join(filter(None, (at, mark)))
        return f"{about}: {self.text}" if about else self.text

    def describe(self) -> str:
        """Return the note as a line, without its time."""
        if not self.trial_id:
            return self.text
        trial = f"trial {self.trial_id}, attempt {self.attempt}"
        return f"{trial}{': ' if self.remark == self.text else ', '}{self.remark}"

    def to_members(self) -> dict[str, Any]:
        """Return the members of the note's file."""
        members = {"kind": KIND, "version": VERSION, **asdict(self), "mark": self.mark.value}
        return {name: value for name, value in members.items() if value is not None}


def check_note(note: SessionNote) -> SessionNote:
    """Return the note. Raises SessionError for what cannot be one."""
    if not note.text.strip():
        raise SessionError("a note needs a text: write one")
    for what, text, most in (
        ("note", note.text, MAX_LETTERS),
        ("author", note.author, MAX_AUTHOR_LETTERS),
    ):
        if len(text) > most:
            raise SessionError(f"the {what} has {len(text):,} letters: {most:,} are the most")
        if visible(text) != text:
            raise SessionError(f"the {what} has control characters: leave them out")
    if note.mark and not note.trial_id:
        raise SessionError(f"only a trial can be marked {note.mark}: name its number")
    if note.at_s is not None and not (note.trial_id and 0 <= note.at_s <= MAX_AT_S):
        raise SessionError("a moment is that of a trial, in seconds since its first sample")
    if min(note.trial_id, note.attempt) < 0 or bool(note.trial_id) != bool(note.attempt):
        raise SessionError("a note on a trial needs its number and attempt, both from 1")
    try:
        datetime.strptime(note.made_utc, "%Y-%m-%dT%H:%M:%SZ")
    except ValueError as error:
        raise SessionError(
            f"{note.made_utc!r} is not a time such as 2026-11-23T14:00:00Z"
        ) from error
    return note


def parse_note(text: bytes, path: Path) -> SessionNote:
    """Return the note in a file's text. Raises SessionError for another one."""
    try:
        members = msgspec.json.decode(text, type=dict[str, Any])
        if (members.get("kind"), members.get("version")) != (KIND, VERSION):
            raise SessionError("it is of another kind or version")
        return check_note(msgspec.convert(members, SessionNote))
    except (msgspec.MsgspecError, SessionError) as error:
        raise SessionError(
            f"{path} is damaged: {error}: what it says is lost; move it elsewhere and write the "
            "note again"
        ) from error


PATTERN = "note-*.json"
MAX_BYTES = 64 << 10
_NAME = re.compile(r"note-(\d{8}T\d{6}Z)(?:-(\d{3}))?\.json")

Attempt = tuple[int, int]
"""Number of a trial, and number of the attempt at it."""


def read_notes(folder: Path) -> tuple[SessionNote, ...]:
    """Return the intact notes of a session, oldest first."""
    found = []
    for path in note_paths(folder):
        with suppress(SessionError):  # damaged_notes names it
            found.append(_read(path))
    return tuple(found)


def damaged_notes(folder: Path) -> list[str]:
    """Return a sentence for each note that cannot be read."""
    lines = []
    for path in note_paths(folder):
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
    refuse_link_outside(path, SessionError)
    return parse_note(read_bytes(path, MAX_BYTES, SessionError), path)


def note_paths(folder: Path) -> list[Path]:
    """Return the paths of all notes, oldest first."""
    names = [(path, _NAME.fullmatch(path.name)) for path in folder.glob(PATTERN)]
    dated = [((found[1], int(found[2] or 1)), path) for path, found in names if found]
    return [path for _, path in sorted(dated)]


MAX_IN_A_SECOND = 999


def write_note(folder: Path, note: SessionNote) -> Path:
    """Write a note beside the parts; return its path.

    Raises SessionError for a wrong note, DiskFault where it cannot be written.
    """
    members = check_note(note).to_members()
    text = json.dumps(members, ensure_ascii=False, indent=1) + "\n"
    try:
        return _write_new(folder, note.made_utc, text)
    except OSError as error:
        raise DiskFault(
            f"{folder}: the note cannot be written ({error.strerror}): make room or choose another "
            "disk, the record is unchanged"
        ) from error


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
