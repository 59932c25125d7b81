"""The outcome of the taxel board's self-test, as bits on the wire and as sentences.

Lines are the three wires that the board drives, inputs the six that it reads; reading
*6 l + i* is of line *l* and input *i*. Pin names are those of ``arduino/taxels/board.h``.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from enum import IntFlag

from rigctl.values import DRAWN_WIRING, N_TAXELS

N_LINES, N_INPUTS = 3, 6
LINE_PINS = ("D4", "D5", "D6")
INPUT_PINS = ("A0", "A1", "A2", "A3", "A4", "A5")

_BODY = struct.Struct("<2x9B3s3sx")


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


def decode_self_test(body: bytes) -> SelfTest:
    """Return the outcome in the body of a self-test frame."""
    *small, silent, full = _BODY.unpack_from(body)
    return SelfTest(*small, *(int.from_bytes(mask, "little") for mask in (silent, full)))


def findings(test: SelfTest, wiring: Sequence[int] = DRAWN_WIRING) -> list[str]:
    """Return a sentence for each finding: what, where, cure. Empty for a passed test.

    ``wiring``: the reading of each place of the sensor; taxels are named by their place,
    counted from 1.
    """
    return [*_wire_findings(test), *_taxel_findings(test, wiring)]


_TOGETHER = "are connected to each other: separate them"
_LINES = tuple(f"line {pin}" for pin in LINE_PINS)
_INPUTS = tuple(f"input {pin}" for pin in INPUT_PINS)
_WIRE_FAULTS = (
    ("lines_low", _LINES, "stays low: it is connected to ground; free it"),
    ("lines_high", _LINES, "stays high: it is connected to 5 V; free it"),
    ("lines_together", _LINES, _TOGETHER),
    ("inputs_high", _INPUTS, "is held high while no line is driven: look for a short to 5 V"),
    ("inputs_low", _INPUTS, "is held at ground: look for a short across its divider"),
    ("inputs_open", _INPUTS, "has no divider to ground: solder its resistor"),
    ("inputs_together", _INPUTS, _TOGETHER),
)
"""Field of :class:`SelfTest`, names of its bits, and what a set bit means."""


def _wire_findings(test: SelfTest) -> Iterator[str]:
    for mask, wires, text in _WIRE_FAULTS:
        names = [wires[bit] for bit in _bits(getattr(test, mask))]
        if names and text is _TOGETHER:
            names = [" and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))]
        yield from (f"{name} {text}" for name in names)


def _taxel_findings(test: SelfTest, wiring: Sequence[int]) -> Iterator[str]:
    """Yield silent and full taxels that no other finding explains, whole wires first."""
    bad_lines = test.lines_low | test.lines_high | test.lines_together
    bad_inputs = test.inputs_high | test.inputs_low | test.inputs_open | test.inputs_together
    silent = _unexplained(test.silent, bad_lines, bad_inputs)
    full = _unexplained(test.full, bad_lines, bad_inputs)
    # A shorted taxel pulls its input to the lines that are low, so the others of it read nothing.
    shorted = {reading % N_INPUTS for reading in full}
    silent = {reading for reading in silent if reading % N_INPUTS not in shorted}
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
    readings = range(N_TAXELS)
    wires = [
        *(
            (name, "six", readings[line * N_INPUTS :][:N_INPUTS])
            for line, name in enumerate(_LINES)
        ),
        *((name, "three", readings[i::N_INPUTS]) for i, name in enumerate(_INPUTS)),
    ]
    for name, count, group in wires:
        if silent.issuperset(group):
            silent = silent.difference(group)
            yield f"{name} does not reach the sensor: its {count} taxels read nothing"
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
    return f"taxel {place + 1} ({_LINES[line]}, {_INPUTS[input_]})"


def _bits(mask: int) -> list[int]:
    return [bit for bit in range(mask.bit_length()) if mask >> bit & 1]
