"""Read ``digests.txt``: which parts the recorder began and closed, also those that vanished."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from rigctl.config.text_file import is_plain_file
from rigctl.session.format.layout import DIGEST_LINES_FILE, part_number

MAX_BYTES = 4 << 20
"""A line is about 120 bytes, and a session has at most 32,767 parts."""
_LINE = re.compile(
    r"\S{1,40} (?:opened|closed) (?P<name>part-[0-9]{4,5}\.h5)"
    r"(?: (?P<outcome>[a-z]+) (?P<committed>[0-9]{1,9})/(?P<planned>[0-9]{1,9}))?"
    r" (?P<digest>[0-9a-f]{64})"
)


@dataclass(frozen=True, slots=True)
class ListedPart:
    """What the file says about a part.

    ``digest``: the last digest of the part, empty unless it was closed; ``committed``: trials of
    the session that were committed when it was closed, None unless it was.
    """

    number: int
    digest: str = ""
    committed: int | None = None


def listed_parts(folder: Path) -> dict[int, ListedPart]:
    """Return the parts by number; none for a session without a readable file."""
    path = folder / DIGEST_LINES_FILE
    if path.is_symlink() or not is_plain_file(path):
        return {}
    try:
        with path.open("rb") as file:
            text = file.read(MAX_BYTES).decode(errors="replace")
    except OSError:
        return {}
    parts: dict[int, ListedPart] = {}
    for found in filter(None, map(_LINE.fullmatch, text.splitlines())):
        number = part_number(Path(found["name"]))
        if not number:
            continue
        if found["outcome"]:
            parts[number] = ListedPart(number, found["digest"], int(found["committed"]))
        else:
            parts.setdefault(number, ListedPart(number))
    return parts
