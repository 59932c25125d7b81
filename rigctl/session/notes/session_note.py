"""One note on a session, or a verdict on one of its trials."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from rigctl.config.visible_text import visible
from rigctl.errors import SessionError

KIND, VERSION = "rigctl-note", 1
MAX_LETTERS = 2000
MAX_AUTHOR_LETTERS = 200
_HEX = re.compile(r"(?:[0-9a-f]{64})?")


class Mark(StrEnum):
    """A person's verdict on an attempt at a trial. ``NONE``: the note has none."""

    NONE = ""
    BAD = "bad"
    GOOD = "good"


@dataclass(frozen=True, slots=True)
class SessionNote:
    """A text with its time, ISO 8601 in UTC with seconds, such as ``2026-11-23T14:00:00Z``.

    ``trial_id`` and ``attempt`` are those of the trial that it is about, 0 for the whole session.
    A trial marked bad does not count; ``GOOD`` takes the mark back. ``closing_digest``: that of the
    session when the note was made, empty while it was recorded.
    """

    made_utc: str
    text: str
    trial_id: int = 0
    attempt: int = 0
    mark: Mark = Mark.NONE
    author: str = ""
    closing_digest: str = ""

    def describe(self) -> str:
        """Return the note as a line, without its time."""
        trial = f"trial {self.trial_id}, attempt {self.attempt}" if self.trial_id else ""
        mark = f"marked {self.mark}" if self.mark else ""
        about = ", ".join(filter(None, (trial, mark)))
        return f"{about}: {self.text}" if about else self.text

    def to_members(self) -> dict[str, Any]:
        """Return the members of the note's file."""
        return {"kind": KIND, "version": VERSION, **asdict(self), "mark": self.mark.value}


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
    if min(note.trial_id, note.attempt) < 0 or bool(note.trial_id) != bool(note.attempt):
        raise SessionError("a note on a trial needs its number and attempt, both from 1")
    try:
        datetime.strptime(note.made_utc, "%Y-%m-%dT%H:%M:%SZ")
    except ValueError as error:
        raise SessionError(
            f"{note.made_utc!r} is not a time such as 2026-11-23T14:00:00Z"
        ) from error
    return note


def parse_note(members: dict[str, Any], path: Path) -> SessionNote:
    """Return the note of a file's members. Raises SessionError for other ones."""
    if (members.pop("kind", None), members.pop("version", None)) != (KIND, VERSION):
        raise SessionError(f"{path} is not a note that this program reads")
    wanted = asdict(SessionNote("", ""))
    for name, example in wanted.items():
        if type(members.get(name)) is not (int if type(example) is int else str):
            raise SessionError(f"{path}: {name} is missing or of another type")
    if members["mark"] not in set(Mark) or not _HEX.fullmatch(members["closing_digest"]):
        raise SessionError(f"{path}: its mark or its closing digest is none")
    values = {name: members[name] for name in wanted} | {"mark": Mark(members["mark"])}
    try:
        return check_note(SessionNote(**values))
    except SessionError as error:
        raise SessionError(f"{path}: {error}") from error
