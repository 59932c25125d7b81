"""Write ``digests.txt`` anew from the parts, which hold all that it says."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.digests import PREVIOUS_DIGEST
from rigctl.session.format.digests_file import (
    CONTINUES,
    DigestLine,
    read_digest_lines,
    replace_lines,
    utc_at,
)
from rigctl.session.read.closing_digest import last_digest, session_end
from rigctl.session.read.missing_parts import open_parts
from rigctl.session.read.part import PartReader
from rigctl.session.read.part_file import existing_parts
from rigctl.session.read.recovery_file import read_recoveries
from rigctl.values import Verdict

IS_DIGEST = re.compile(r"[0-9a-f]{64}")


def lines_problem(folder: Path) -> str:
    """Return what is wrong with the file, empty for nothing; sessions may be older than it.

    A part that is not there says nothing about its line, and one that was recovered has another.
    """
    recovered = {part.name for record in read_recoveries(folder) for part in record.parts}
    try:
        found = read_digest_lines(folder)
    except SessionError as error:
        return str(error).removeprefix(f"{folder / layout.DIGEST_LINES_FILE} ")
    parts, _ = open_parts(existing_parts(folder))
    try:
        wanted = {_sure_words(line) for line in _lines(parts)}
    finally:
        for part in parts:
            part.close()
    if not wanted:
        return ""
    if not found.exists:
        return "is missing"
    known = {(part, bool(word)) for part, word, *_ in wanted if part not in recovered}
    own = {_sure_words(line) for line in found.lines if (line.part, bool(line.word)) in known}
    if found.wrong or found.once != found.lines or not wanted >= own:
        return "does not say what the parts say"
    return ""


def rebuild_lines(folder: Path) -> None:
    """Write the file as the parts have it. Raises OSError."""
    parts, _ = open_parts(existing_parts(folder))
    try:
        replace_lines(folder, list(_lines(parts)))
    finally:
        for part in parts:
            part.close()


def _lines(parts: Sequence[PartReader]) -> Iterator[DigestLine]:
    begun, committed = "", set[int]()
    for part in parts:
        rows = part.rows(part.layout.trials)
        committed |= set(rows["trial_id"][rows["verdict"] == Verdict.COMMITTED.value].tolist())
        if not part.has_digests:
            continue
        header, name = part.header, part.path.name
        opened = begun or utc_at(header, header.start_loop_s)
        yield DigestLine(opened, name, "", "", str(part.attributes[PREVIOUS_DIGEST]))
        line = _closing_line(part, f"{len(committed)}/{header.trials_planned}")
        begun = line.utc if line and line.word == CONTINUES else ""
        if line:
            yield line


def _sure_words(line: DigestLine) -> tuple[str, ...]:
    """Return what a part alone knows: not what was committed, or closed, in a part before it."""
    counts = "" if line.word == CONTINUES else line.counts
    return line.part, line.word, counts, line.utc if line.word else "", line.digest


def _closing_line(part: PartReader, counts: str) -> DigestLine | None:
    """Return the line of a part that was closed and whose last events can be read."""
    digest = last_digest(part)
    if not part.finished or not IS_DIGEST.fullmatch(digest):
        return None
    last_event = part.rows(layout.EVENTS, part.n_rows(layout.EVENTS) - 1)
    utc = utc_at(part.header, float(last_event["at_s"][0]))
    try:
        end = session_end(part)
    except SessionError:
        return None
    if end is None:
        return DigestLine(utc, part.path.name, CONTINUES, counts, digest)
    counts = f"{end['committed']}/{end['planned']}"
    return DigestLine(utc, part.path.name, str(end["outcome"]), counts, digest)
