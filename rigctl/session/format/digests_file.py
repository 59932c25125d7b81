"""Read and write ``digests.txt`` beside the parts: a line for each part opened and closed.

The file names parts that vanish later, and its last line is the one to keep elsewhere: with the
closing digest, anyone can check that the session is still what was recorded.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from rigctl.config.text_file import read_bytes, refuse_link_outside
from rigctl.errors import SessionError
from rigctl.session.format.file_names import DIGEST_LINES_FILE, part_number
from rigctl.session.format.metadata.header import SessionHeader

CONTINUES = "continues"
"""The word for a closed part that another follows in the same sitting."""
MAX_BYTES = 16 << 20
"""More than 100,000 sittings."""
_LINE = re.compile(
    r"(?P<utc>\S+) (?:opened (?P<opened>part-[0-9]{4,5}\.h5)"
    r"|closed (?P<closed>part-[0-9]{4,5}\.h5) (?P<word>finished|stopped|failed|continues) "
    r"(?P<committed>[0-9]{1,9})/(?P<planned>[0-9]{1,9})) (?P<digest>[0-9a-f]{64})"
)


@dataclass(frozen=True, slots=True)
class DigestLine:
    """A line of ``digests.txt``; ``word`` and ``counts`` are empty for a part that was opened."""

    utc: str
    part: str
    word: str
    counts: str
    digest: str

    def __str__(self) -> str:
        ending = f"closed {self.part} {self.word} {self.counts}"
        return f"{self.utc} {ending if self.word else f'opened {self.part}'} {self.digest}\n"


@dataclass(frozen=True, slots=True)
class DigestLines:
    """The lines of ``digests.txt`` and the numbers of those that are no such line."""

    lines: tuple[DigestLine, ...] = ()
    wrong: tuple[int, ...] = ()
    exists: bool = True

    @property
    def once(self) -> tuple[DigestLine, ...]:
        """The lines without those that name a part as opened, or as closed, once more."""
        first = {(line.part, bool(line.word)): line for line in reversed(self.lines)}
        return tuple(line for line in self.lines if first[line.part, bool(line.word)] is line)

    @property
    def closed(self) -> dict[str, str]:
        """The last digest of each closed part."""
        return {line.part: line.digest for line in self.lines if line.word}


def read_digest_lines(folder: Path) -> DigestLines:
    """Return the lines beside a session's parts. Raises SessionError if they cannot be read."""
    path = folder / DIGEST_LINES_FILE
    refuse_link_outside(path, SessionError)
    if not path.exists():
        return DigestLines(exists=False)
    data = read_bytes(path, MAX_BYTES, SessionError)
    lines, wrong = [], []
    for number, text in enumerate(data.decode("ascii", "replace").split("\n")[:-1], start=1):
        found = _LINE.fullmatch(text)
        if found is None:
            wrong.append(number)
            continue
        counts = f"{found['committed']}/{found['planned']}" if found["closed"] else ""
        part = found["opened"] or found["closed"]
        lines.append(DigestLine(found["utc"], part, found["word"] or "", counts, found["digest"]))
    if data and not data.endswith(b"\n"):
        wrong.append(data.count(b"\n") + 1)
    return DigestLines(tuple(lines), tuple(wrong))


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
    parts: dict[int, ListedPart] = {}
    with suppress(SessionError):
        for line in read_digest_lines(folder).lines:
            number = part_number(Path(line.part))
            if number and line.word:
                parts[number] = ListedPart(number, line.digest, int(line.counts.split("/")[0]))
            elif number:
                parts.setdefault(number, ListedPart(number))
    return parts


def append_line(folder: Path, line: DigestLine) -> None:
    """Append one line and sync it. Raises OSError."""
    with (folder / DIGEST_LINES_FILE).open("a", encoding="utf-8", newline="\n") as file:
        file.write(str(line))
        file.flush()
        os.fsync(file.fileno())


def replace_lines(folder: Path, lines: Sequence[DigestLine]) -> None:
    """Write the file anew, whole or not at all. Raises OSError."""
    new = folder / f"{DIGEST_LINES_FILE}.new"
    with new.open("w", encoding="utf-8", newline="\n") as file:
        file.write("".join(map(str, lines)))
        file.flush()
        os.fsync(file.fileno())
    new.replace(folder / DIGEST_LINES_FILE)


def utc_at(header: SessionHeader, at_s: float) -> str:
    """Return loop time ``at_s`` as ISO 8601 with seconds; the header knows when the loop began.

    A header without a time that can be counted on from gives its own words.
    """
    try:
        start = datetime.fromisoformat(header.start_utc)
        start = start if start.tzinfo else start.replace(tzinfo=UTC)
        now = start + timedelta(seconds=at_s - header.start_loop_s)
    except (ValueError, OverflowError):
        return header.start_utc.replace(" ", "T") or "unknown"
    return now.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
