"""Check ``digests.txt`` and the texts beside the parts against the parts themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.config.text_file import read_bytes
from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.digests import PREVIOUS_DIGEST
from rigctl.session.format.layout import DIGEST_LINES_FILE, SessionOutcome
from rigctl.session.format.table_rows import parse_event
from rigctl.session.read.closing_digest import last_digest
from rigctl.session.read.part import PartReader
from rigctl.session.verify.report import VerifyReport
from rigctl.session.write.digest_lines import utc_at

CONTINUES = "continues"
MAX_BYTES = 16 << 20
"""Of any file beside the parts: more than 100,000 sittings."""
MAX_SITTING_S = 1e9
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


@dataclass(frozen=True, slots=True)
class DigestLines:
    """The lines of ``digests.txt`` and the numbers of those that are no such line."""

    lines: tuple[DigestLine, ...] = ()
    wrong: tuple[int, ...] = ()
    exists: bool = True

    @property
    def closed(self) -> dict[str, str]:
        """The last digest of each closed part."""
        return {line.part: line.digest for line in self.lines if line.word}


def read_digest_lines(folder: Path) -> DigestLines:
    """Return the lines beside a session's parts. Raises SessionError if they cannot be read."""
    data = _read(folder / DIGEST_LINES_FILE)
    if data is None:
        return DigestLines(exists=False)
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


def check_digest_lines(
    found: DigestLines, parts: Sequence[PartReader], report: VerifyReport
) -> None:
    """Compare ``digests.txt`` with the parts that are there and have digests."""
    if not found.exists and not any(part.has_digests and part.finished for part in parts):
        return
    report.problems += [f"{DIGEST_LINES_FILE}: {line}" for line in _wrong_lines(found, parts)]


def _wrong_lines(found: DigestLines, parts: Sequence[PartReader]) -> Iterator[str]:
    if not found.exists:
        yield "is missing, so nothing names parts that vanished"
        return
    for number in found.wrong:
        yield f"line {number} is not one that a recording wrote"
    by_name = {part.path.name: part for part in parts}
    named = {line.part for line in found.lines}
    for name in sorted(by_name.keys() - named):
        if by_name[name].has_digests and by_name[name].finished:  # else killed before its line
            yield f"does not name {name}, which was put in later"
    begun = ""  # when the next part begins, if it is one of the same sitting
    for line in found.lines:
        if line.part in by_name and by_name[line.part].has_digests:
            yield from _wrong_line(line, by_name[line.part])
            yield from _wrong_time(line, by_name[line.part], begun)
        elif line.part in by_name:
            yield f"has a digest of {line.part}, the part has none: it was exchanged"
        begun = line.utc if line.word == CONTINUES else ""


def _wrong_line(line: DigestLine, part: PartReader) -> Iterator[str]:
    if not line.word:
        if line.digest != part.attributes.get(PREVIOUS_DIGEST):
            yield f"{line.part} began with another digest: the part or the line was exchanged"
    elif line.digest != last_digest(part):
        yield f"{line.part} was closed with another digest: the part or the line was exchanged"
    elif (line.word, line.counts) != _ending(part, line):
        yield f"{line.part} was closed as {line.word} {line.counts}, the part says otherwise"


def _wrong_time(line: DigestLine, part: PartReader, begun: str) -> Iterator[str]:
    at_s = part.header.start_loop_s
    if line.word and part.n_rows(layout.EVENTS):
        at_s = float(part.rows(layout.EVENTS, part.n_rows(layout.EVENTS) - 1)["at_s"][0])
    if not abs(at_s - part.header.start_loop_s) < MAX_SITTING_S:
        return  # its events are not those that were recorded, which another check says
    try:
        expected = (line.word == "" and begun) or utc_at(part.header, at_s)
    except OverflowError:
        return  # start_utc is at the end of time, so another check names the description
    if line.utc != expected:
        verb = "closed" if line.word else "opened"
        yield f"{line.part} was {verb} at {expected}, not at {line.utc}"


def _ending(part: PartReader, line: DigestLine) -> tuple[str, str]:
    """Return what a part says of its end; a part that another follows does not know the counts."""
    data = session_end(part)
    if not part.finished:
        return "", ""
    if data is None:
        return CONTINUES, line.counts
    return str(data.get("outcome")), f"{data.get('committed')}/{data.get('planned')}"


def session_end(part: PartReader) -> Mapping[str, object] | None:
    """Return how the sitting ended, if the part is the last one of it.

    Raises SessionError for an event that no recording wrote.
    """
    rows = part.rows_where(layout.EVENTS, "kind", layout.SESSION_END_KIND)
    if not len(rows):
        return None
    data = parse_event(rows[-1], part.path).data
    if data.get("outcome") not in list(SessionOutcome):
        raise SessionError(f"{part.path}: its event session_end has no outcome")
    return data


def check_texts(folder: Path, first: PartReader, report: VerifyReport) -> None:
    """Compare the protocol and the rig beside the parts with the texts in part 1."""
    for name, path in ((layout.PROTOCOL_FILE, "/protocol_toml"), (layout.RIG_FILE, "/rig_toml")):
        beside = _read(folder / name)
        if beside is None:
            report.notes.append(f"{name}: is missing, {first.path.name} contains it")
        elif _unix_lines(beside) != _unix_lines(first.text(path).encode()):
            report.problems.append(
                f"{name}: was changed since the recording, {first.path.name} contains the text "
                "that was used"
            )


def _unix_lines(text: bytes) -> bytes:
    return text.replace(b"\r\n", b"\n")


def _read(path: Path) -> bytes | None:
    return read_bytes(path, MAX_BYTES, SessionError) if path.exists() else None
