"""Watch a session that another program records.

Print its events as they are recorded, and a line with its trials, its losses and the age of its
newest data. It reads the folder alone, on any computer that can, and reaches no rig. Exit code 0:
the session is closed; 1: the program that recorded it is gone.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.progress import ProgressLine
from rigctl.config.text_file import is_plain_file
from rigctl.errors import CheckFailed, SessionError
from rigctl.session import layout
from rigctl.session.layout import PROTOCOL_FILE, parse_event
from rigctl.session.part import existing_parts
from rigctl.session.session import open_session
from rigctl.session.session_reader import SessionReader
from rigctl.session.writer_lock import LOCK_FILE, Writer, lock_owner_pid, writer_of
from rigctl.values import Verdict

LOOK_EVERY_S = 0.5
PAST_EVENTS = 20
"""Of the time before, which are shown first."""
NOTHING_YET = "nothing is recorded yet: it begins with the first plate"
GONE = (
    "the program that recorded {session} is gone: continue it with --resume, or put it in order "
    "with rigctl recover"
)


class Look(NamedTuple):
    """What one look at a session found: the new events, a line about it, and the writer's fate."""

    events: list[str]
    line: str
    has_ended: bool = False
    is_gone: bool = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "session", a_path, help_text="a session's folder")


def run(args: argparse.Namespace) -> int:
    """Show what is recorded until the session is closed. Raises CheckFailed without a recorder."""
    line = ProgressLine(sys.stdout)
    try:
        for look in looks(args.session):
            for event in look.events:
                line.say(event)
            line.show(look.line, last=look.has_ended)
            if look.has_ended:
                return 0
            if look.is_gone:
                raise CheckFailed(GONE.format(session=args.session))
            time.sleep(LOOK_EVERY_S)
    finally:
        line.end()
    return 0


def looks(folder: Path) -> Iterator[Look]:
    """Yield what is new in a session's folder each time; at first its latest events.

    Before its first part, and while the folder cannot be read, only the line says so. Raises
    SessionError for a folder that is no session.
    """
    was_gone = False
    while _is_prepared(folder):
        is_gone = writer_of(folder) is Writer.GONE
        yield Look([], NOTHING_YET, is_gone=is_gone and was_gone)
        was_gone = is_gone
    with open_session(folder) as session:
        taken = session.parts[-1].number, max(0, _n_events(session) - PAST_EVENTS)
        while True:
            try:
                events, taken = _new_events(session, *taken)
                is_gone = not session.finished and writer_of(folder) is Writer.GONE
                has_ended = session.finished and lock_owner_pid(folder) is None
                yield Look(events, _line(session), has_ended, is_gone and was_gone)
                was_gone = is_gone  # two looks must agree: a new writer takes the lock first
                session.refresh()
            except (SessionError, OSError) as error:
                yield Look([], f"the session cannot be read now: {error}")
                with suppress(SessionError, OSError):
                    session.refresh()  # what failed would fail again: its file is opened anew


def _is_prepared(folder: Path) -> bool:
    """Return whether a recorder has prepared a folder, and no part was ever begun in it."""
    prepared = all(is_plain_file(folder / name) for name in (LOCK_FILE, PROTOCOL_FILE))
    return prepared and not existing_parts(folder)


def _n_events(session: SessionReader) -> int:
    return session.parts[-1].n_rows(layout.EVENTS)


def _new_events(session: SessionReader, part: int, row: int) -> tuple[list[str], tuple[int, int]]:
    """Return the texts of the events from a row of a part on, and where the next ones begin."""
    texts: list[str] = []
    for each in session.parts:
        if each.number >= part:
            rows = each.rows(layout.EVENTS, row if each.number == part else 0)
            texts += [parse_event(event, each.path).text for event in rows]
    return [text for text in texts if text], (session.parts[-1].number, _n_events(session))


def _line(session: SessionReader) -> str:
    committed, planned = len(session.committed()), session.header.trials_planned
    rejected = int((session.trials["verdict"] == Verdict.REJECTED.value).sum())
    lost = int(session.gaps["count"].sum())
    age_s = max(0.0, time.time() - session.parts[-1].path.stat().st_mtime)
    return (
        f"{committed} of {planned} trials, {rejected} rejected; {session.n_samples} samples, "
        f"{lost} lost; newest data {age_s:.1f} s old"
    )
