"""Print where a new session is, and the line that proves it."""

from __future__ import annotations

from pathlib import Path

from rigctl.session.session_reader import read_closing_digest


def print_session(folder: Path) -> None:
    """Print a session's folder and, if it is closed, its closing digest."""
    print(f"session: {folder}")
    if digest := read_closing_digest(folder):
        print(f"digest: {digest} (keep this line: `rigctl verify` compares it with --digest)")
