"""Say what is missing in a session that a command continues or reads."""

from __future__ import annotations

import sys
from pathlib import Path

from rigctl.session.session import describe_missing


def print_missing(folder: Path) -> None:
    """Print a note on each missing part and on trials that are left out, on standard error."""
    for line in describe_missing(folder):
        print(f"note: {folder}: {line}", file=sys.stderr, flush=True)
