"""Write ``digests.txt`` anew from the parts, which hold all that it says."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from rigctl.errors import SessionError
from rigctl.session.format import file_names, layout
from rigctl.session.format.digests import PREVIOUS_DIGEST
from rigctl.session.format.digests_file import (
    CONTINUES,
    DigestLine,
    read_digest_lines,
    replace_lines,
    utc_at,
)
from rigctl.session.read.closing_digest import count_committed, last_digest, session_end
from rigctl.session.read.missing_parts import open_parts
from rigctl.session.read.part import PartReader
from rigctl.session.read.part_file import existing_parts
from rigctl.session.read.recovery_file import read_recoveries

IS_DIGEST = re.compile(r"[0-9a-f]{64}")


def lines_problem(folder: Path) -> str:
    """Return what is wrong with the file, empty for nothing; sessions may be older than it.

    A part that is not there says nothing about its line, and one that was recovered has another.
    """
    recoveries = read_recoveries(folder)
    recovered = {part.name for record in recoveries for part in record.parts}
    try:
        found = read_digest_lines(folder)
    except SessionError as error:
        return str(error).removeprefix(f"{folder / file_names.DIGEST_LINES_FILE} ")
    parts, _ = open_parts(existing_parts(folder))
    try:
        complete = not recoveries and _are_complete(parts)
        wanted = {_sure_words(line, complete) for line in _lines(parts)}
    finally:
        for part in parts:
            part.close()
    if not wanted:
        return ""
    if not found.exists:
        return "is missing"
    known = {(part, bool(word)) for part, word, *_ in wanted if part not in recovered}
    lines = [line for line in found.lines if (line.part, bool(line.word)) in known]
    own = {_sure_words(line, complete) for line in lines}
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
    begun, committed = "", count_committed(parts)
    for part in parts:
        if not part.has_digests:
            continue
        header, name = part.header, part.path.name
        opened = begun or utc_at(header, header.start_loop_s)
        yield DigestLine(opened, name, "", "", str(part.attributes[PREVIOUS_DIGEST]))
        line = _closing_line(part, f"{committed[name]}/{header.trials_planned}")
        begun = line.utc if line and line.word == CONTINUES else ""
        if line:
            yield line


def _are_complete(parts: Sequence[PartReader]) -> bool:
    return [part.number for part in parts] == list(range(1, len(parts) + 1))


def _sure_words(line: DigestLine, complete: bool) -> tuple[str, ...]:
    """Return what the parts know: not what was committed before, unless they are ``complete``."""
    counts = "" if line.word == CONTINUES and not complete else line.counts
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
