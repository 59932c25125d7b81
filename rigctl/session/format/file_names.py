"""The names of the files in a session's folder."""

from __future__ import annotations

import re
from pathlib import Path

PROTOCOL_FILE = "protocol.toml"
RIG_FILE = "rig.toml"
LOCK_FILE = "writer.lock"
DIGEST_LINES_FILE = "digests.txt"
PART_PATTERN = "part-*.h5"
"""Matches every part, and copies such as ``part-0002 (copy).h5``, which are none."""
MAX_PARTS = 32_767
"""``part`` in /trials is a 16-bit number."""
_PART_NAME = re.compile(r"part-([0-9]{4,5})\.h5")


def part_name(number: int) -> str:
    """Return the file name of part ``number``, counted from 1."""
    return f"part-{number:04d}.h5"


def part_number(path: Path) -> int:
    """Return the number in a part's file name; 0 for any other file."""
    found = _PART_NAME.fullmatch(path.name)
    number = int(found[1]) if found else 0
    return number if number <= MAX_PARTS and path.name == part_name(number) else 0
