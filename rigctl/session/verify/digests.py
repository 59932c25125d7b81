"""Check a session's chain of digests: every row of every part, and the links between parts."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from rigctl.session.chain.digest_table import RowRange
from rigctl.session.chain.links import OnBytes, PartLinks, check_links
from rigctl.session.chain.touched_trials import name_attempts, touched_attempts
from rigctl.session.format.data_sets import DIGESTS
from rigctl.session.format.digests import DESCRIPTION, FIRST_DIGEST, PREVIOUS_DIGEST
from rigctl.session.read.closing_digest import last_digest
from rigctl.session.read.damage import describe_rows
from rigctl.session.read.part import PartReader
from rigctl.session.read.recovery_file import KnownDamage
from rigctl.session.verify.report import VerifyReport

MAX_LINES = 20
"""Ranges of altered rows that are named for each part; a count stands for the others."""
WITHOUT_DIGESTS = "recorded before there were digests: alterations of its rows cannot be seen"


def check_part_digests(
    part: PartReader,
    follower: str,
    known: Sequence[KnownDamage],
    report: VerifyReport,
    on_bytes: OnBytes,
) -> bool:
    """Check every row of a part that has digests; return whether all damage is known.

    ``follower``: the digest that the next part or ``digests.txt`` has for this part's end.
    ``known``: damage that a recovery file lists, which is noted while it does not change.
    """
    links, attested = _split_known(
        part, check_links(part, follower=follower, on_bytes=on_bytes), known
    )
    report.notes += [
        f"{part.path.name}: {line}, as a recovery file says"
        for line in _altered_rows(part, attested, describe_rows)
    ]
    problems = list(_problems(part, links))
    report.problems += [f"{part.path.name}: {line}" for line in problems]
    report.notes += [f"{part.path.name}: {line}" for line in _notes(part, links)]
    return bool(attested) and not problems


def _problems(part: PartReader, links: PartLinks) -> Iterator[str]:
    yield from _altered_rows(part, links.damaged, describe_rows)
    yield from _altered_rows(part, links.coverage.gone, _describe_gone)
    if part.finished:
        yield from _altered_rows(part, links.coverage.uncovered, _describe_added)
    if links.altered:
        yield (
            f"{_rows(links.altered)} of /digests {_were(links.altered)} altered, the rows that "
            "they cover are those that were recorded"
        )
    if misplaced := links.coverage.misplaced:
        yield f"{_rows(misplaced)} of /digests {_were(misplaced)} altered, removed or moved"


def _split_known(
    part: PartReader, links: PartLinks, known: Sequence[KnownDamage]
) -> tuple[PartLinks, list[RowRange]]:
    """Return what no recovery file lists, and the places that one does."""
    attested: list[RowRange] = []

    def unknown(places: Iterable[RowRange]) -> tuple[RowRange, ...]:
        found = {place: _is_known(part, place, known) for place in places}
        attested.extend(place for place, is_known in found.items() if is_known)
        return tuple(place for place, is_known in found.items() if not is_known)

    def unknown_digests(rows: Iterable[int]) -> tuple[int, ...]:
        return tuple(
            place.first_row for place in unknown(RowRange(DIGESTS.path, row, 1) for row in rows)
        )

    coverage = replace(
        links.coverage,
        gone=unknown(links.coverage.gone),
        uncovered=unknown(links.coverage.uncovered),
        misplaced=unknown_digests(links.coverage.misplaced),
    )
    damaged, altered = unknown(links.damaged), unknown_digests(links.altered)
    return PartLinks(coverage, damaged, altered), attested


def _is_known(part: PartReader, place: RowRange, known: Sequence[KnownDamage]) -> bool:
    listed = [rows for rows in known if (rows.table, rows.first_row, rows.n_rows) == place]
    if not listed:
        return False
    end = place.first_row + place.n_rows
    data = (
        part.describe()
        if place.table == DESCRIPTION
        else part.stored_rows(place.table, place.first_row, end).tobytes()
    )
    return hashlib.sha256(data).hexdigest() in {rows.sha256 for rows in listed}


def _notes(part: PartReader, links: PartLinks) -> Iterator[str]:
    """Note rows without a digest: the last ones of a killed writer may lack it."""
    uncovered = links.coverage.uncovered
    if uncovered and not part.finished:
        listed = ", ".join(f"{place.n_rows} of {place.table}" for place in uncovered)
        yield f"its last rows have no digest, because its writer was killed: {listed}"


def _altered_rows(
    part: PartReader, places: Sequence[RowRange], describe: Callable[[RowRange], str]
) -> Iterator[str]:
    for place in places[:MAX_LINES]:
        yield f"{describe(place)}: {name_attempts(part, touched_attempts(part, place))}"
    if len(places) > MAX_LINES:
        tables = sorted({place.table for place in places[MAX_LINES:]})
        yield f"and {len(places) - MAX_LINES} more such blocks of rows of {', '.join(tables)}"


def _describe_gone(place: RowRange) -> str:
    return f"{_row_numbers(place)} of {place.table} were removed or altered, the table is shorter"


def _describe_added(place: RowRange) -> str:
    return f"{_row_numbers(place)} of {place.table} were added, no digest covers them"


def _row_numbers(place: RowRange) -> str:
    return f"rows {place.first_row}–{place.first_row + place.n_rows - 1}"


def _rows(rows: Sequence[int]) -> str:
    if len(rows) == 1:
        return f"row {rows[0]}"
    listed = ", ".join(map(str, rows[:5]))
    return f"rows {listed}" + (f" and {len(rows) - 5} more" if len(rows) > 5 else "")


def _were(rows: Sequence[int]) -> str:
    return "was" if len(rows) == 1 else "were"


def check_succession(
    parts: Sequence[PartReader],
    attested: Mapping[int, str],
    damaged: Collection[int],
    report: VerifyReport,
) -> None:
    """Check that each part continues the chain of the one before it.

    ``damaged``: numbers of parts with known damage, which may be at their end.

    ``attested``: the last digest of parts that were taken out or replaced since, by their number,
    as recovery files say. A missing part is named elsewhere.
    """
    ends: dict[int, str] = dict(attested)
    for number, part in enumerate(parts):
        if not part.has_digests:
            continue
        previous = str(part.attributes.get(PREVIOUS_DIGEST, ""))
        before = parts[:number]
        if part.number - 1 not in damaged and not _follows(part, previous, before, ends):
            name = before[-1].path.name if before else "the beginning of a session"
            report.problems.append(
                f"{part.path.name}: does not follow {name}: one of both was exchanged, or rows at "
                "the end of the part before were"
            )
    without = [part.path.name for part in parts if not part.has_digests]
    report.notes += [f"{name}: {WITHOUT_DIGESTS}" for name in _shortened(without)]


def _follows(
    part: PartReader, previous: str, before: Sequence[PartReader], attested: Mapping[int, str]
) -> bool:
    if attested.get(part.number - 1) == previous:
        return True
    neighbour = before[-1] if before and before[-1].number == part.number - 1 else None
    if neighbour is None and part.number > 1:
        return True  # the part before is missing, which is a problem of its own
    with_digests = [each for each in before if each.has_digests]
    if neighbour is not None and neighbour.has_digests:
        return last_digest(neighbour) == previous
    return previous == (last_digest(with_digests[-1]) if with_digests else FIRST_DIGEST)


def _shortened(names: Iterable[str]) -> list[str]:
    listed = list(names)
    return listed if len(listed) < 3 else [f"{listed[0]} … {listed[-1]}"]


def follower_digests(parts: Sequence[PartReader], closed: Mapping[str, str]) -> dict[int, str]:
    """Return what the next part, or else ``digests.txt``, says of each part's last digest.

    ``closed``: the digests of ``digests.txt`` by the part's name.
    """
    found = {part.number: closed.get(part.path.name, "") for part in parts}
    for part in parts:
        if part.number - 1 in found and part.has_digests:
            found[part.number - 1] = str(part.attributes.get(PREVIOUS_DIGEST, ""))
    return found
