"""Write ``digests.txt`` beside the parts: a line when a part is opened and when it is closed.

The file names parts that vanish later, and its last line is the one to keep elsewhere: with the
closing digest, anyone can check that the session is still what was recorded.
"""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

from rigctl.session.format.header import SessionHeader
from rigctl.session.format.layout import DIGEST_LINES_FILE


def append_line(folder: Path, utc: str, *words: str) -> None:
    """Append one line and sync it. Raises OSError."""
    with (folder / DIGEST_LINES_FILE).open("a", encoding="utf-8", newline="\n") as file:
        file.write(" ".join((utc, *words)) + "\n")
        file.flush()
        os.fsync(file.fileno())


def utc_at(header: SessionHeader, at_s: float) -> str:
    """Return loop time ``at_s`` as ISO 8601 with seconds; the header knows when the loop began."""
    try:
        start = datetime.fromisoformat(header.start_utc)
    except ValueError:
        return header.start_utc.replace(" ", "T") or "unknown"
    start = start if start.tzinfo else start.replace(tzinfo=UTC)
    now = start + timedelta(seconds=at_s - header.start_loop_s)
    return now.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
