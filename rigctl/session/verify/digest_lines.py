"""Check ``digests.txt`` and the texts beside the parts against the parts themselves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from rigctl.config.text_file import read_bytes, refuse_link_outside
from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.digests import PREVIOUS_DIGEST
from rigctl.session.format.digests_file import CONTINUES, DigestLine, DigestLines, utc_at
from rigctl.session.format.file_names import DIGEST_LINES_FILE, PROTOCOL_FILE, RIG_FILE
from rigctl.session.read.closing_digest import last_digest, session_end
from rigctl.session.read.part import PartReader
from rigctl.session.verify.report import VerifyReport

MAX_TEXT_BYTES = 16 << 20
"""Of a text beside the parts."""
MAX_SITTING_S = 1e9


class CommittedTrials(NamedTuple):
    """The trials that were committed by the end of each part, by its name.

    ``exact``: no part is missing or was recovered, else there may have been more.
    """

    counts: Mapping[str, int]
    exact: bool

    def fit(self, line: DigestLine, part: PartReader) -> bool:
        """Return whether the counts of a line are those of the parts."""
        committed, planned = map(int, line.counts.split("/"))
        least = self.counts[line.part]
        most = least if self.exact else part.header.trials_planned
        return least <= committed <= most and planned == part.header.trials_planned


def check_digest_lines(
    found: DigestLines,
    parts: Sequence[PartReader],
    committed: CommittedTrials,
    report: VerifyReport,
) -> None:
    """Compare ``digests.txt`` with the parts that are there and have digests."""
    if not found.exists and not any(part.has_digests and part.finished for part in parts):
        return
    wrong = _wrong_lines(found, parts, committed)
    report.problems += [f"{DIGEST_LINES_FILE}: {line}" for line in wrong]


def _wrong_lines(
    found: DigestLines, parts: Sequence[PartReader], committed: CommittedTrials
) -> Iterator[str]:
    if not found.exists:
        yield "is missing, so nothing names parts that vanished"
        return
    for number in found.wrong:
        yield f"line {number} is not one that a recording wrote"
    by_name = {part.path.name: part for part in parts}
    for part in parts:
        if part.has_digests and part.finished:  # else killed before its lines
            yield from _missing_lines(found, part.path.name)
    if repeated := len(found.lines) - len(found.once):
        yield f"has lines of parts that it names already: {repeated}"
    begun = ""  # when the next part begins, if it is one of the same sitting
    for line in found.once:
        if line.part in by_name and by_name[line.part].has_digests:
            yield from _wrong_line(line, by_name[line.part], committed)
            yield from _wrong_time(line, by_name[line.part], begun)
        elif line.part in by_name:
            yield f"has a digest of {line.part}, the part has none: it was exchanged"
        begun = line.utc if line.word == CONTINUES else ""


def _missing_lines(found: DigestLines, name: str) -> Iterator[str]:
    words = {bool(line.word) for line in found.lines if line.part == name}
    if not words:
        yield f"does not name {name}, which was put in later"
    elif len(words) == 1:
        yield f"does not say that {name} was {'opened' if True in words else 'closed'}"


def _wrong_line(line: DigestLine, part: PartReader, committed: CommittedTrials) -> Iterator[str]:
    if not line.word:
        if line.digest != part.attributes.get(PREVIOUS_DIGEST):
            yield f"{line.part} began with another digest: the part or the line was exchanged"
    elif line.digest != last_digest(part):
        yield f"{line.part} was closed with another digest: the part or the line was exchanged"
    elif (line.word, line.counts) != _ending(part, line):
        yield f"{line.part} was closed as {line.word} {line.counts}, the part says otherwise"
    elif line.word == CONTINUES and not committed.fit(line, part):
        yield (
            f"{line.part} was closed with {line.counts} trials committed, the parts up to it have "
            f"{committed.counts[line.part]}/{part.header.trials_planned}"
        )


def _wrong_time(line: DigestLine, part: PartReader, begun: str) -> Iterator[str]:
    at_s = part.header.start_loop_s
    if line.word and part.n_rows(layout.EVENTS):
        at_s = float(part.rows(layout.EVENTS, part.n_rows(layout.EVENTS) - 1)["at_s"][0])
    if not abs(at_s - part.header.start_loop_s) < MAX_SITTING_S:
        return  # its events are not those that were recorded, which another check says
    expected = (line.word == "" and begun) or utc_at(part.header, at_s)
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


def changed_texts(folder: Path, first: PartReader) -> Iterator[str]:
    """Yield the names of the texts beside the parts that part 1 does not hold.

    Only part 1 was begun with them: a resumed session may have another rig.
    """
    for name, path in (
        (PROTOCOL_FILE, "/protocol_toml"),
        (RIG_FILE, "/rig_toml"),
    ):
        beside = _read(folder / name) if first.number == 1 else None
        if beside is not None and _unix_lines(beside) != _unix_lines(first.text(path).encode()):
            yield name


def check_texts(folder: Path, first: PartReader, report: VerifyReport) -> None:
    """Compare the protocol and the rig beside the parts with the texts in part 1."""
    report.notes += [
        f"{name}: is missing, {first.path.name} contains it"
        for name in (PROTOCOL_FILE, RIG_FILE)
        if not (folder / name).exists()
    ]
    report.problems += [
        f"{name}: was changed since the recording, {first.path.name} contains the text that was "
        "used"
        for name in changed_texts(folder, first)
    ]


def _unix_lines(text: bytes) -> bytes:
    return text.replace(b"\r\n", b"\n")


def _read(path: Path) -> bytes | None:
    refuse_link_outside(path, SessionError)
    return read_bytes(path, MAX_TEXT_BYTES, SessionError) if path.exists() else None
