"""What the taxel board sends and accepts: samples, status, identity, self-test.

``docs/reference/taxel-wire.md`` describes the layout; :mod:`rigctl.boards.taxel_decoder` reads it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from enum import IntFlag

from rigctl.values import DRAWN_WIRING

N_INPUTS = 6
"""Inputs of the paper's board; another has ``[taxels] inputs`` of ``rig.toml``."""
FIRST_LINE_PIN = 4
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six")

_BODY = struct.Struct("<2x9B3s3sx")


class Coverage(IntFlag):
    """What the board could test; its divider or its polarity hides the rest."""

    LINES = 1
    OPEN_INPUTS = 2
    SHORT_INPUTS = 4
    TAXELS = 8


@dataclass(frozen=True, slots=True)
class SelfTest:
    """Outcome of one self-test: a bit for each line, input or reading.

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


def line_name(line: int) -> str:
    """Return the pin of a line, from 0; ``arduino/taxels/board.h`` lists pins in this order."""
    return f"D{FIRST_LINE_PIN + line}"


def input_name(input_: int) -> str:
    """Return the pin of an analog input, from 0."""
    return f"A{input_}"


def findings(
    test: SelfTest, wiring: Sequence[int] = DRAWN_WIRING, n_inputs: int = N_INPUTS
) -> list[str]:
    """Return a sentence for each finding: what, where, cure. Empty for a passed test.

    ``wiring``: the reading of each place of the sensor; taxels are named by their place,
    counted from 1. ``n_inputs``: inputs of the board; a reading is n_inputs · line + input.
    """
    return [*_wire_findings(test), *_taxel_findings(test, wiring, n_inputs)]


_TOGETHER = "are connected to each other: separate them"
_LINE, _INPUT = "line", "input"
_WIRE_FAULTS = (
    ("lines_low", _LINE, "stays low: it is connected to ground; free it"),
    ("lines_high", _LINE, "stays high: it is connected to 5 V; free it"),
    ("lines_together", _LINE, _TOGETHER),
    ("inputs_high", _INPUT, "is held high while no line is driven: look for a short to 5 V"),
    ("inputs_low", _INPUT, "is held at ground: look for a short across its divider"),
    ("inputs_open", _INPUT, "has no divider to ground: solder its resistor"),
    ("inputs_together", _INPUT, _TOGETHER),
)
"""Field of :class:`SelfTest`, what its bits are, and what a set bit means."""


def _wire_findings(test: SelfTest) -> Iterator[str]:
    for mask, kind, text in _WIRE_FAULTS:
        names = [_wire(kind, bit) for bit in _bits(getattr(test, mask))]
        if names and text is _TOGETHER:
            names = [" and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))]
        yield from (f"{name} {text}" for name in names)


def _wire(kind: str, number: int) -> str:
    return f"{kind} {line_name(number) if kind == _LINE else input_name(number)}"


def _taxel_findings(test: SelfTest, wiring: Sequence[int], n_inputs: int) -> Iterator[str]:
    """Yield silent and full taxels that no other finding explains, whole wires first."""
    bad_lines = test.lines_low | test.lines_high | test.lines_together
    bad_inputs = test.inputs_high | test.inputs_low | test.inputs_open | test.inputs_together
    silent, full = (
        {
            reading
            for reading in _bits(mask)
            if not (bad_lines >> reading // n_inputs | bad_inputs >> reading % n_inputs) & 1
        }
        for mask in (test.silent, test.full)
    )
    # A shorted taxel pulls its input to the lines that are low, so the others of it read nothing.
    shorted = {reading % n_inputs for reading in full}
    silent = {reading for reading in silent if reading % n_inputs not in shorted}
    if len(silent) == len(wiring):
        yield (
            "no taxel conducts: plug the sensor in (a sensor that rests open reads like this, too)"
        )
    else:
        yield from _open_circuits(silent, wiring, n_inputs)
    for reading in sorted(full):
        yield (
            f"{_taxel(reading, wiring, n_inputs)} reads full scale with nothing on it: "
            "look for a short in the sensor"
        )


def _open_circuits(silent: set[int], wiring: Sequence[int], n_inputs: int) -> Iterator[str]:
    readings = range(len(wiring))
    lines = range(len(wiring) // n_inputs)
    wires = [
        *((_wire(_LINE, line), readings[line * n_inputs :][:n_inputs]) for line in lines),
        *((_wire(_INPUT, i), readings[i::n_inputs]) for i in range(n_inputs)),
    ]
    for name, group in wires:
        if silent.issuperset(group):
            silent = silent.difference(group)
            count = number_word(len(group))
            yield f"{name} does not reach the sensor: its {count} taxels read nothing"
    for reading in sorted(silent):
        yield f"{_taxel(reading, wiring, n_inputs)} does not conduct: it is open or torn"


def number_word(number: int) -> str:
    """Return a small number as a word."""
    return _NUMBERS[number] if number < len(_NUMBERS) else str(number)


def _taxel(reading: int, wiring: Sequence[int], n_inputs: int) -> str:
    place = list(wiring).index(reading)
    line, input_ = divmod(reading, n_inputs)
    return f"taxel {place + 1} ({_wire(_LINE, line)}, {_wire(_INPUT, input_)})"


def _bits(mask: int) -> list[int]:
    return [bit for bit in range(mask.bit_length()) if mask >> bit & 1]


WIRE_VERSION = 2
BAUD = 500_000
CYCLES_PER_US = 16
"""Cycles of the board's chip, the unit of its longest interrupt."""
IDENTIFY, SELF_TEST = 0x01, 0x02
"""Requests to the board; the numbers that follow are of what it sends."""
IDENTITY, DATA, STATUS, SELF_TEST_OUTCOME = 0x10, 0x11, 0x12, 0x13
STATUS_BODY, IDENTITY_BODY, SELF_TEST_BODY = 26, 20, 18
CONTROLS = ((STATUS, STATUS_BODY), (IDENTITY, IDENTITY_BODY), (SELF_TEST_OUTCOME, SELF_TEST_BODY))
READING_BITS = 10
EDGE_BITS = 4
READINGS_AT = 4
"""Offset of the readings in the body of a data frame; behind them are the edges."""
OVERHEAD = 5
"""Bytes that CRC-32 and COBS add to a body, without the closing zero."""
JITTER = 50
"""Samples by which a status frame may lag behind the data frames around it."""
MAX_JUMP = 1000
"""Longest gap that a data frame alone can tell: it holds only 16 bits of the counter."""
LATE = 8
"""Samples of the boot before that may still come behind the news of a reboot."""


class SelfTestBit(IntFlag):
    """Bits of :attr:`TaxelStatus.self_test_bits`."""

    DONE = 1
    FOUND = 2
    RUNNING = 4


class Flag(IntFlag):
    """Low bits of a data frame's flags; bits 4–7 count dropped frames, saturating at 15."""

    SYNC = 1
    INDEX = 2
    LATE = 4
    OVERRUN = 8


@dataclass(frozen=True, slots=True)
class TaxelStatus:
    """Status that the taxel board sends ten times a second, in the order of the wire."""

    sample_counter: int
    frames_dropped: int
    late_slots: int
    longest_isr_cycles: int
    supply_mv: int
    reset_cause: int
    boot_count: int
    free_stack_bytes: int
    idle_permille: int
    sync_rises: int
    self_test_bits: int


@dataclass(frozen=True, slots=True)
class TaxelIdentity:
    """Identity that the taxel board sends on request, in the order of the wire."""

    magic: int
    wire_version: int
    board_id: int
    firmware_version: int
    build_hash: int
    n_taxels: int
    rate_hz: int
    boot_count: int
    reset_cause: int
    slot_cycles: int
    slots: int


def cobs_encode(data: bytes) -> bytes:
    """Return at most 253 bytes without zero bytes, so that a zero can end a frame.

    Consistent overhead byte stuffing: Cheshire and Baker, IEEE/ACM Transactions on Networking
    7(2), 1999.
    """
    return b"".join(bytes([len(run) + 1]) + run for run in data.split(b"\0"))


def frame(body: bytes) -> bytes:
    """Return the frame of ``body``: with CRC-32, stuffed, with the closing zero."""
    return cobs_encode(body + zlib.crc32(body).to_bytes(4, "little")) + b"\0"


def data_body(n_taxels: int) -> int:
    """Return the bytes in the body of a data frame, as ``DATA_SIZE`` in the firmware's wire.h."""
    bits = READING_BITS * n_taxels + EDGE_BITS
    return READINGS_AT + -(-bits // 8)


def frame_bytes(n_taxels: int) -> int:
    """Return the bytes of a data frame on the wire, its closing zero included."""
    return data_body(n_taxels) + OVERHEAD + 1


def encode_request(kind: int) -> bytes:
    """Return a request to the board: IDENTIFY or SELF_TEST."""
    return frame(bytes([kind]))
