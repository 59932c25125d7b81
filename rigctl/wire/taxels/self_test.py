"""The outcome of the taxel board's self-test, as bits on the wire and as sentences.

Lines are the three wires that the board drives, inputs the six that it reads; reading
*6 l + i* is of line *l* and input *i*. Pin names are those of ``arduino/taxels/board.h``.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from enum import IntFlag

from rigctl.values import DRAWN_WIRING, N_TAXELS

N_LINES, N_INPUTS = 3, 6
LINE_PINS = ("D4", "D5", "D6")
INPUT_PINS = ("A0", "A1", "A2", "A3", "A4", "A5")

_BODY = struct.Struct("<9B3s3sx")


class Coverage(IntFlag):
    """What the board could test; its divider or its polarity hides the rest."""

    LINES = 1
    OPEN_INPUTS = 2
    SHORT_INPUTS = 4
    TAXELS = 8


@dataclass(frozen=True, slots=True)
class SelfTest:
    """Outcome of one self-test: a bit for each line (0–2), input (0–5) or reading (0–17).

    ``count``: tests since boot, from 1. ``lines_low``, ``lines_high``: stuck whatever the board
    drives. ``lines_together``, ``inputs_together``: connected to each other. ``inputs_high``,
    ``inputs_low``: connected to the supply or to ground. ``inputs_open``: without a divider.
    ``silent``, ``full``: readings at either end of the range, with nothing on the sensor.
    """

    count: int
    tested: int
    lines_low: int = 0
    lines_high: int = 0
    lines_together: int = 0
    inputs_high: int = 0
    inputs_low: int = 0
    inputs_open: int = 0
    inputs_together: int = 0
    silent: int = 0
    full: int = 0

    @property
    def passed(self) -> bool:
        """True without findings."""
        return not any(astuple(self)[2:])


def decode_self_test_body(body: bytes) -> SelfTest:
    """Return the outcome of a body after type and version."""
    *small, silent, full = _BODY.unpack_from(body)
    wide = int.from_bytes(silent, "little"), int.from_bytes(full, "little")
    return replace(SelfTest(*small), silent=wide[0], full=wide[1])


def findings(test: SelfTest, wiring: Sequence[int] = DRAWN_WIRING) -> list[str]:
    """Return a sentence for each finding: what, where, cure. Empty for a passed test.

    ``wiring``: the reading of each place of the sensor; taxels are named by their place,
    counted from 1.
    """
    return [*_line_findings(test), *_input_findings(test), *_taxel_findings(test, wiring)]


def _line_findings(test: SelfTest) -> Iterator[str]:
    for line in _bits(test.lines_low):
        yield f"{_line(line)} stays low: it is connected to ground; free it"
    for line in _bits(test.lines_high):
        yield f"{_line(line)} stays high: it is connected to 5 V; free it"
    if test.lines_together:
        names = _join([_line(line) for line in _bits(test.lines_together)])
        yield f"{names} are connected to each other: separate them"


def _input_findings(test: SelfTest) -> Iterator[str]:
    for i in _bits(test.inputs_high):
        yield f"{_input(i)} is held high while no line is driven: look for a short to 5 V"
    for i in _bits(test.inputs_low):
        yield f"{_input(i)} is held at ground: look for a short across its divider"
    for i in _bits(test.inputs_open):
        yield f"{_input(i)} has no divider to ground: solder its resistor"
    if test.inputs_together:
        names = _join([_input(i) for i in _bits(test.inputs_together)])
        yield f"{names} are connected to each other: separate them"


def _taxel_findings(test: SelfTest, wiring: Sequence[int]) -> Iterator[str]:
    """Yield silent and full taxels that no other finding explains, whole wires first."""
    bad_lines = test.lines_low | test.lines_high | test.lines_together
    bad_inputs = test.inputs_high | test.inputs_low | test.inputs_open | test.inputs_together
    silent = _unexplained(test.silent, bad_lines, bad_inputs)
    full = _unexplained(test.full, bad_lines, bad_inputs)
    if len(silent) == N_TAXELS:
        yield (
            "no taxel conducts: plug the sensor in (a sensor that rests open reads like this, too)"
        )
    else:
        yield from _open_circuits(silent, wiring)
    for reading in sorted(full):
        yield (
            f"{_taxel(reading, wiring)} reads full scale with nothing on it: "
            "look for a short in the sensor"
        )


def _open_circuits(silent: set[int], wiring: Sequence[int]) -> Iterator[str]:
    for line in range(N_LINES):
        group = {line * N_INPUTS + i for i in range(N_INPUTS)}
        if group <= silent:
            silent = silent - group
            yield f"{_line(line)} does not reach the sensor: its six taxels read nothing"
    for i in range(N_INPUTS):
        group = {line * N_INPUTS + i for line in range(N_LINES)}
        if group <= silent:
            silent = silent - group
            yield f"{_input(i)} does not reach the sensor: its three taxels read nothing"
    for reading in sorted(silent):
        yield f"{_taxel(reading, wiring)} does not conduct: it is open or torn"


def _unexplained(mask: int, bad_lines: int, bad_inputs: int) -> set[int]:
    return {
        reading
        for reading in _bits(mask)
        if not (bad_lines >> reading // N_INPUTS | bad_inputs >> reading % N_INPUTS) & 1
    }


def _taxel(reading: int, wiring: Sequence[int]) -> str:
    place = list(wiring).index(reading)
    line, input_ = divmod(reading, N_INPUTS)
    return f"taxel {place + 1} (line {LINE_PINS[line]}, input {INPUT_PINS[input_]})"


def _line(line: int) -> str:
    return f"line {LINE_PINS[line]}"


def _input(number: int) -> str:
    return f"input {INPUT_PINS[number]}"


def _bits(mask: int) -> list[int]:
    return [bit for bit in range(mask.bit_length()) if mask >> bit & 1]


def _join(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]
