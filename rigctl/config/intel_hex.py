"""Intel HEX, the text form in which compilers hand over a chip's program."""

from __future__ import annotations

from collections.abc import Iterable

from rigctl.errors import WrongUse

Segments = list[tuple[int, bytes]]
"""Addresses and the bytes that lie there, ascending; neighbours are joined."""
DATA, END, SEGMENT, LINEAR = 0, 1, 2, 4
RECORD_BYTES = 16


def parse_intel_hex(text: str) -> Segments:
    """Return the bytes of a program with their addresses. Raises WrongUse for a damaged text."""
    pieces: dict[int, bytes] = {}
    base, ended = 0, False
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.startswith(":"):
            continue
        kind, address, data = _record(line, number)
        if kind == DATA:
            pieces[base + address] = data
        elif kind in (SEGMENT, LINEAR):
            base = int.from_bytes(data, "big") << (4 if kind == SEGMENT else 16)
        ended = ended or kind == END
    if not pieces or not ended:
        raise WrongUse("it is not whole: it has no end, or no data")
    return _join(sorted(pieces.items()))


def format_intel_hex(segments: Iterable[tuple[int, bytes]]) -> str:
    """Return the text of a program."""
    lines: list[str] = []
    for start, data in segments:
        at, end = start, start + len(data)
        while at < end:
            if at == start or at % 0x10000 == 0:
                lines.append(_line(LINEAR, 0, (at >> 16).to_bytes(2, "big")))
            count = min(RECORD_BYTES - at % RECORD_BYTES, end - at)
            piece = data[at - start : at - start + count]
            lines.append(_line(DATA, at % 0x10000, piece))
            at += count
    return "\n".join([*lines, _line(END, 0, b""), ""])


def _record(line: str, number: int) -> tuple[int, int, bytes]:
    try:
        record = bytes.fromhex(line[1:].strip())
    except ValueError:
        record = b""
    if len(record) < 5 or len(record) != record[0] + 5 or sum(record) % 256:
        raise WrongUse(f"line {number} is damaged")
    return record[3], int.from_bytes(record[1:3], "big"), record[4:-1]


def _line(kind: int, address: int, data: bytes) -> str:
    record = bytes([len(data)]) + address.to_bytes(2, "big") + bytes([kind]) + data
    return f":{record.hex().upper()}{-sum(record) % 256:02X}"


def _join(pieces: Iterable[tuple[int, bytes]]) -> Segments:
    joined: list[tuple[int, bytearray]] = []
    for address, data in pieces:
        if joined and address == joined[-1][0] + len(joined[-1][1]):
            joined[-1][1].extend(data)
        else:
            joined.append((address, bytearray(data)))
    return [(address, bytes(data)) for address, data in joined]
