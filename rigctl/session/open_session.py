"""Open a session of any experiment."""

from __future__ import annotations

from pathlib import Path

from rigctl.session.read.finger_session import FingerSession, is_finger_session
from rigctl.session.read.session import Session
from rigctl.session.read.session_reader import SessionReader


def open_session(path: Path) -> SessionReader:
    """Open a session with the reader of its experiment.

    Raises SessionError if no part can be read, and for another kind of folder.
    """
    return FingerSession.open(path) if is_finger_session(path) else Session.open(path)


def describe_missing(path: Path) -> list[str]:
    """Return a sentence for each missing part of a session and for trials that are left out."""
    with open_session(path) as session:
        return session.describe_missing()
