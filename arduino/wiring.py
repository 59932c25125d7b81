"""Draws ``wiring.svg``: both boards, what hangs on their pins, and the resistors that matter.

    python3 wiring.py            write the drawing
    python3 wiring.py --check    exit code 1 where the drawing is not what the headers say

Pins come from ``drum/board.h`` and ``taxels/board.h``, so the drawing follows the firmware.
Only the standard library is needed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
DRAWING = HERE / "wiring.svg"
COLOURS = {
    "red": "#c62828",
    "black": "#222222",
    "orange": "#e07b00",
    "yellow": "#c9a400",
    "green": "#2e7d32",
    "blue": "#1565c0",
    "violet": "#7b1fa2",
    "grey": "#6d6d6d",
    "white": "#b9b9b9",
    "brown": "#6d4c41",
}
WIDTH, ROW, GAP = 1180, 32, 26
BOARD_LEFT, BOARD_RIGHT = 176, 384
PART_LEFT, PART_RIGHT = 800, 1140
LABEL_AT, PULL_AT = 400, 660


class Row(NamedTuple):
    """One wire: a board's pin, the part's terminal, its colour, and a resistor on it."""

    pin: str
    signal: str
    terminal: str
    colour: str
    pull: str = ""


class Part(NamedTuple):
    """What hangs on a board, wire by wire, with a remark beneath its name."""

    name: str
    remark: str
    rows: tuple[Row, ...]


def drum_pins() -> dict[str, str]:
    """Arduino pin of each signal of the drum board, as in ``drum/board.h``."""
    text = (HERE / "drum" / "board.h").read_text(encoding="utf-8")
    found = re.findall(r"constexpr uint8_t (\w+) = _BV\(P\w\d\);\s*// (D\d+)", text)
    return dict(found)


def taxel_pins() -> tuple[list[str], list[str], str]:
    """Lines and inputs in wire order, and the divider, as in ``taxels/board.h``."""
    text = (HERE / "taxels" / "board.h").read_text(encoding="utf-8")
    lines = _numbers(text, r"LINE_BIT\[LINES\] = \{([^}]*)\}")
    inputs = _numbers(text, r"INPUT_CHANNEL\[INPUTS\] = \{([^}]*)\}")
    (ohm,) = _numbers(text, r"DIVIDER_OHM = (\d+)")
    return [f"D{n}" for n in lines], [f"A{n}" for n in inputs], f"{ohm / 1000:g} kΩ"


def _numbers(text: str, pattern: str) -> list[int]:
    found = re.search(pattern, text)
    assert found is not None, pattern
    return [int(n) for n in found[1].split(",")]


def drum_parts() -> list[Part]:
    """What hangs on the Mega."""
    p = drum_pins()
    enable = p["STEPPER_ENABLE"]
    return [
        Part(
            "Stepper driver",
            "motor supply through E-stop contact 2",
            (
                Row(p["STEP"], "step", "STEP", "orange"),
                Row(p["DIRECTION"], "direction", "DIR", "yellow"),
                Row(enable, "off when high", "EN, active low", "green", "10 kΩ to 5 V"),
                Row("GND", "ground", "GND", "black"),
            ),
        ),
        Part(
            "H-bridge of the actuator",
            "motor supply through E-stop contact 2",
            (
                Row(p["PRESS"], "press, 4 kHz", "IN 1", "orange", "10 kΩ to GND"),
                Row(p["LIFT"], "lift, 4 kHz", "IN 2", "yellow", "10 kΩ to GND"),
                Row(p["BRIDGE_ON"], "on when high", "EN", "green", "10 kΩ to GND"),
                Row("GND", "ground", "GND", "black"),
            ),
        ),
        Part(
            "Actuator: position and ends",
            "switches open at the end",
            (
                Row("A0", "position", "potentiometer, wiper", "blue"),
                Row("5V", "supply", "potentiometer, lower end", "red"),
                Row("GND", "ground", "potentiometer, upper end", "black"),
                Row(p["END_UP"], "end up", "upper switch, to GND", "white", "4.7 kΩ to 5 V"),
                Row(p["END_DOWN"], "end down", "lower switch, to GND", "grey", "4.7 kΩ to 5 V"),
            ),
        ),
        Part(
            "Load-cell amplifier HX711",
            "RATE to its supply: 80 samples a second",
            (
                Row(p["LOADCELL_DATA"], "data", "DOUT", "white"),
                Row(p["LOADCELL_CLOCK"], "clock", "SCK", "violet", "10 kΩ to GND"),
                Row("5V", "supply", "VCC", "red"),
                Row("GND", "ground", "GND", "black"),
            ),
        ),
        Part(
            "Emergency stop",
            "contact 2 is in the motor supply",
            (
                Row(p["ESTOP"], "stop, open = tripped", "contact 1", "brown", "4.7 kΩ to 5 V"),
                Row("GND", "ground", "contact 1", "black"),
            ),
        ),
        Part(
            "Index sensor at the drum",
            "high at the mark",
            (
                Row(p["INDEX"], "index", "OUT", "blue", "4.7 kΩ to 5 V"),
                Row("5V", "supply", "VCC", "red"),
                Row("GND", "ground", "GND", "black"),
            ),
        ),
    ]


def taxel_parts() -> list[Part]:
    """What hangs on the Uno."""
    lines, inputs, divider = taxel_pins()
    line_colours, input_colours = ("red", "orange", "yellow"), ("green", "blue", "violet")
    return [
        Part(
            "Sensor: driven lines",
            "high one at a time, 50 µs",
            tuple(
                Row(pin, f"line {i + 1}", f"common line {i + 1}: row {i + 1}", colour)
                for i, (pin, colour) in enumerate(zip(lines, line_colours, strict=True))
            ),
        ),
        Part(
            "Sensor: read lines",
            "a divider at each, close to the Uno",
            (
                *(
                    Row(
                        pin,
                        f"input {i + 1}",
                        f"{'top' if i < 3 else 'bottom'} read line {i % 3 + 1}: column {i % 3 + 1}",
                        input_colours[i % 3] if i < 3 else ("grey", "white", "brown")[i % 3],
                        f"{divider} to GND",
                    )
                    for i, pin in enumerate(inputs)
                ),
                Row("GND", "ground", "shield only", "black"),
            ),
        ),
    ]


def drawing() -> str:
    """The whole picture as SVG."""
    body: list[str] = []
    top = 92
    mega_bottom = top + _height(drum_parts())
    uno_top = mega_bottom + 84
    uno_bottom = uno_top + _height(taxel_parts())
    body += _board("Arduino Mega 2560", "drum", top, mega_bottom)
    body += _board("Arduino Uno", "taxels", uno_top, uno_bottom)
    body += _parts(drum_parts(), top)
    body += _parts(taxel_parts(), uno_top)
    body += _between(mega_bottom, uno_top)
    body += _text(40, 40, "Wiring of both boards", 22, "start", "bold")
    note = "USB of both boards to the computer. Pin names are those printed on the boards."
    body += _text(40, 64, note, 14)
    height = uno_bottom + 30
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        f'width="{WIDTH}" height="{height}" font-family="DejaVu Sans, Verdana, sans-serif">'
    )
    ground = f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>'
    return "\n".join([head, ground, *body, "</svg>", ""])


def _height(parts: list[Part]) -> int:
    return sum(_part_height(part) for part in parts) + GAP * (len(parts) + 1)


def _part_height(part: Part) -> int:
    return 52 + ROW * len(part.rows)


def _board(name: str, folder: str, top: int, bottom: int) -> Iterator[str]:
    yield _box(BOARD_LEFT, top, BOARD_RIGHT, bottom, "#e3eef8", "#33587a")
    yield from _text(BOARD_LEFT + 14, top + 28, name, 16, "start", "bold")
    yield from _text(BOARD_LEFT + 14, top + 48, f"arduino/{folder}", 13)


def _parts(parts: list[Part], top: int) -> Iterator[str]:
    y = top + GAP
    for part in parts:
        yield _box(PART_LEFT, y, PART_RIGHT, y + _part_height(part), "#f6f1e4", "#7a6a33")
        yield from _text(PART_LEFT + 14, y + 22, part.name, 15, "start", "bold")
        yield from _text(PART_LEFT + 14, y + 40, part.remark, 12)
        for i, row in enumerate(part.rows):
            yield from _wire(row, y + 52 + ROW * i + 8)
        y += _part_height(part) + GAP


def _wire(row: Row, y: int) -> Iterator[str]:
    yield _line(BOARD_RIGHT, y, PART_LEFT, y, row.colour)
    yield from _text(BOARD_RIGHT - 12, y + 5, row.pin, 14, "end", "bold")
    yield from _text(PART_LEFT + 14, y + 5, row.terminal, 14)
    yield from _text(LABEL_AT, y - 5, f"{row.signal} ({row.colour})", 12)
    if row.pull:
        yield from _resistor(PULL_AT, y, row.pull)


def _resistor(x: int, y: int, text: str) -> Iterator[str]:
    """A resistor in a row of its wire: a dot, a short lead upwards, and what it leads to."""
    yield f'<circle cx="{x - 46}" cy="{y}" r="4" fill="#222222"/>'
    yield _line(x - 46, y, x - 46, y - 11, "black", 1.6)
    yield _line(x - 46, y - 11, x - 36, y - 11, "black", 1.6)
    yield (
        f'<rect x="{x - 36}" y="{y - 16}" width="30" height="10" fill="#ffffff" '
        'stroke="#222222" stroke-width="1.6"/>'
    )
    yield _line(x - 6, y - 11, x + 4, y - 11, "black", 1.6)
    yield from _text(x + 9, y - 7, text, 12)


def _between(mega_bottom: int, uno_top: int) -> Iterator[str]:
    """Sync, index and ground from the Mega's lower edge to the Uno's left side."""
    p = drum_pins()
    wires = (
        (p["SYNC"], "D8", "sync", "orange", "10 kΩ to GND"),
        (p["INDEX"], "D9", "index", "blue", ""),
        ("GND", "GND", "ground", "black", ""),
    )
    for i, (mega, uno, signal, colour, pull) in enumerate(wires):
        y, x, into = mega_bottom - 40 - 30 * i, 150 - 44 * i, uno_top + 84 + 30 * i
        yield _line(BOARD_LEFT, y, x, y, colour)
        yield _line(x, y, x, into, colour)
        yield _line(x, into, BOARD_LEFT, into, colour)
        yield from _text(BOARD_LEFT + 12, y + 5, mega, 14, "start", "bold")
        yield from _text(BOARD_LEFT + 12, into + 5, uno, 14, "start", "bold")
        yield _upright(x - 8, mega_bottom + 10, f"{signal} ({colour})")
        if pull:
            yield f'<circle cx="{x}" cy="{uno_top - 20}" r="4" fill="#222222"/>'
            yield _line(x, uno_top - 20, x + 16, uno_top - 20, "black", 1.6)
            yield (
                f'<rect x="{x + 16}" y="{uno_top - 25}" width="30" height="10" fill="#ffffff" '
                'stroke="#222222" stroke-width="1.6"/>'
            )
            yield _line(x + 46, uno_top - 20, x + 56, uno_top - 20, "black", 1.6)
            yield from _text(x + 61, uno_top - 16, pull, 12)


def _box(left: int, top: int, right: int, bottom: int, fill: str, edge: str) -> str:
    return (
        f'<rect x="{left}" y="{top}" width="{right - left}" height="{bottom - top}" rx="6" '
        f'fill="{fill}" stroke="{edge}" stroke-width="2"/>'
    )


def _line(x1: int, y1: int, x2: int, y2: int, colour: str, width: float = 3.0) -> str:
    return (
        f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="{COLOURS[colour]}" '
        f'stroke-width="{width}" stroke-linecap="round"/>'
    )


def _text(
    x: int, y: int, text: str, size: int, anchor: str = "start", weight: str = "normal"
) -> Iterator[str]:
    yield (
        f'<text x="{x}" y="{y}" font-size="{size}" text-anchor="{anchor}" '
        f'font-weight="{weight}" fill="#222222">{escape(text)}</text>'
    )


def _upright(x: int, y: int, text: str) -> str:
    return (
        f'<text transform="translate({x} {y}) rotate(-90)" font-size="12" text-anchor="middle" '
        f'fill="#222222">{escape(text)}</text>'
    )


def main(arguments: list[str]) -> int:
    """Write the drawing, or compare it."""
    if arguments == ["--check"]:
        same = DRAWING.is_file() and DRAWING.read_text(encoding="utf-8") == drawing()
        print(
            "wiring.svg matches the headers"
            if same
            else "wiring.svg is stale: run python arduino/wiring.py"
        )
        return 0 if same else 1
    DRAWING.write_text(drawing(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
