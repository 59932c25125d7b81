"""Draws the wiring of each board on a page of its own: ``wiring-mega.svg``, ``-uno``, ``-teensy``.

    python3 wiring.py            write the drawings
    python3 wiring.py --check    exit code 1 where a drawing is not what the headers say

Pins come from ``drum/board.h``, ``taxels/board.h`` and ``finger/board.h``, so the drawings follow
the firmware. Each fits a sheet of A4 upright. Only the standard library is needed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
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
WIDTH, ROW, GAP, NOTE = 1180, 32, 18, 18
BOARD_LEFT, BOARD_RIGHT = 40, 250
PART_LEFT, PART_RIGHT = 790, 1150
LABEL_AT, SERIES_AT, PULL_AT = 264, 460, 690
TOP = 92
INPUT_FILTER = "1 kΩ"


class Row(NamedTuple):
    """One wire: a board's pin, the part's terminal, its colour, and what is soldered to it.

    ``series`` is a resistor in the wire, ``pull`` one from the wire to a supply or to ground.
    """

    pin: str
    signal: str
    terminal: str
    colour: str
    pull: str = ""
    series: str = ""


class Part(NamedTuple):
    """What hangs on a board, wire by wire, with a remark beneath its name and notes at its end."""

    name: str
    remark: str
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()


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


def finger_pins() -> tuple[list[str], list[str], int]:
    """Lines and inputs of the finger board, and the taxel board's baud: ``finger/board.h``."""
    text = (HERE / "finger" / "board.h").read_text(encoding="utf-8")
    lines = _numbers(text, r"LINE_PIN\[3\] = \{([^}]*)\}")
    inputs = _numbers(text, r"INPUT_PIN\[3\] = \{([^}]*)\}")
    (baud,) = _numbers(text, r"TAXEL_BOARD_BAUD = (\d+)")
    return [str(n) for n in lines], [f"{n} (A{n - 14})" for n in inputs], baud


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
                Row("A0", "position", "potentiometer, wiper", "blue", "1 MΩ to GND"),
                Row("5V", "supply", "potentiometer, lower end", "red", series="470 Ω"),
                Row("GND", "ground", "potentiometer, upper end", "black", series="470 Ω"),
                _switch(p["END_UP"], "end up", "upper switch, to GND", "white", "100 nF"),
                _switch(p["END_DOWN"], "end down", "lower switch, to GND", "grey", "100 nF"),
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
            (
                "Load cell, often: E+ red, E− black, A+ green,",
                "A− white (see its sheet); B+ and B− stay free.",
                "E− also to GND, where the module leaves it open.",
            ),
        ),
        Part(
            "Emergency stop",
            "contact 2 is in the motor supply",
            (
                _switch(p["ESTOP"], "stop, open = tripped", "contact 1", "brown", "1 nF"),
                Row("GND", "ground", "contact 1", "black"),
            ),
        ),
        Part(
            "Index sensor at the drum",
            "high at the mark",
            (
                _switch(p["INDEX"], "index", "OUT", "blue", "10 nF"),
                Row("5V", "supply", "VCC", "red"),
                Row("GND", "ground", "GND", "black"),
            ),
        ),
        Part(
            "Arduino Uno",
            "its page has the other ends",
            (
                Row(p["SYNC"], "sync", "D8, 10 kΩ to GND there", "orange"),
                Row(p["INDEX"], "index", "D9", "blue"),
                Row("GND", "ground", "GND", "black"),
            ),
        ),
    ]


def _switch(pin: str, signal: str, terminal: str, colour: str, capacitor: str) -> Row:
    """A contact or an open collector: pulled up at the wire, filtered at the pin."""
    return Row(pin, signal, terminal, colour, "4.7 kΩ to 5 V", f"{INPUT_FILTER}, {capacitor}")


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
        Part(
            "Arduino Mega",
            "its page has the other ends",
            (
                Row("D8", "sync", drum_pins()["SYNC"], "orange", "10 kΩ to GND"),
                Row("D9", "index", drum_pins()["INDEX"], "blue"),
                Row("GND", "ground", "GND", "black"),
            ),
        ),
        Part(
            "Teensy, for the moving finger",
            "its page has the level shifter",
            (
                Row("D1 (TX)", "frames", "level shifter, 5 V side", "violet"),
                Row("GND", "ground", "GND", "black"),
            ),
        ),
    ]


def finger_parts() -> list[Part]:
    """What hangs on the Teensy: the taxel board, or the sensor itself."""
    lines, inputs, baud = finger_pins()
    return [
        Part(
            "Taxel board, through a level shifter",
            f"{baud:,} baud; TAXEL_BOARD_FITTED = true",
            (
                Row("0 (RX1)", "frames", "shifter, 3.3 V side; Uno D1", "violet"),
                Row("3.3V", "supply", "shifter, low side", "red"),
                Row("GND", "ground", "shifter and Uno GND", "black"),
            ),
        ),
        Part(
            "or the finger's sensor itself",
            "TAXEL_BOARD_FITTED = false; 3.3 V, never 5 V",
            (
                *(
                    Row(pin, f"line {i}", f"common line {i}: row {i}", colour)
                    for i, (pin, colour) in enumerate(
                        zip(lines, ("red", "orange", "yellow"), strict=True), 1
                    )
                ),
                *(
                    Row(pin, f"input {i}", f"read line {i}: column {i}", colour, "10 kΩ to GND")
                    for i, (pin, colour) in enumerate(
                        zip(inputs, ("green", "blue", "grey"), strict=True), 1
                    )
                ),
                Row("GND", "ground", "shield only", "black"),
            ),
        ),
    ]


PAGES = {
    "mega": ("Arduino Mega 2560", "drum", drum_parts),
    "uno": ("Arduino Uno", "taxels", taxel_parts),
    "teensy": ("Teensy 4.0", "finger", finger_parts),
}


def drawing(page: str) -> str:
    """The page of one board as SVG."""
    name, folder, parts_of = PAGES[page]
    parts = parts_of()
    bottom = TOP + _height(parts)
    note = "USB to the computer. Pin names are those printed on the board."
    if any(", " in row.series for part in parts for row in part.rows):
        note += f" {INPUT_FILTER}, 100 nF: in the wire, and from the pin to GND."
    body = [
        *_text(40, 40, f"Wiring of the {name}", 22, "start", "bold"),
        *_text(40, 64, note, 13),
        *_board(name, folder, TOP, bottom),
        *_parts(parts, TOP),
    ]
    if page == "mega":
        body += _supply(bottom + 30)
        bottom += 90
    height = bottom + 30
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        f'width="{WIDTH}" height="{height}" font-family="DejaVu Sans, Verdana, sans-serif">'
    )
    ground = f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>'
    return "\n".join([head, ground, *body, "</svg>", ""])


def part_id(name: str) -> str:
    """The id of a part's box and wires in a drawing, by which a setup shows that part alone."""
    return re.sub("[^a-z0-9]+", "-", name.lower()).strip("-")


def _height(parts: list[Part]) -> int:
    return sum(_part_height(part) for part in parts) + GAP * (len(parts) + 1)


def _part_height(part: Part) -> int:
    return 52 + ROW * len(part.rows) + NOTE * len(part.notes)


def _board(name: str, folder: str, top: int, bottom: int) -> Iterator[str]:
    yield _box(BOARD_LEFT, top, BOARD_RIGHT, bottom, "#e3eef8", "#33587a")
    yield from _text(BOARD_LEFT + 14, top + 28, name, 16, "start", "bold")
    yield from _text(BOARD_LEFT + 14, top + 48, f"arduino/{folder}", 13)


def _parts(parts: list[Part], top: int) -> Iterator[str]:
    y = top + GAP
    for part in parts:
        yield f'<g id="{part_id(part.name)}">'
        yield _box(PART_LEFT, y, PART_RIGHT, y + _part_height(part), "#f6f1e4", "#7a6a33")
        yield from _text(PART_LEFT + 14, y + 22, part.name, 15, "start", "bold")
        yield from _text(PART_LEFT + 14, y + 40, part.remark, 12)
        for i, row in enumerate(part.rows):
            yield from _wire(row, y + 52 + ROW * i + 8)
        for i, note in enumerate(part.notes):
            yield from _text(PART_LEFT + 14, y + 60 + ROW * len(part.rows) + NOTE * i, note, 12)
        yield "</g>"
        y += _part_height(part) + GAP


def _wire(row: Row, y: int) -> Iterator[str]:
    yield _line(BOARD_RIGHT, y, PART_LEFT, y, row.colour)
    yield from _text(BOARD_RIGHT - 12, y + 5, row.pin, 14, "end", "bold")
    yield from _text(PART_LEFT + 14, y + 5, row.terminal, 14)
    yield from _text(LABEL_AT, y - 5, f"{row.signal} ({row.colour})", 12)
    if row.series:
        yield _symbol(SERIES_AT, y - 5)
        yield from _text(SERIES_AT + 34, y - 5, row.series, 12)
    if row.pull:
        yield from _resistor(PULL_AT, y, row.pull)


def _symbol(x: int, y: int) -> str:
    return (
        f'<rect x="{x}" y="{y}" width="30" height="10" fill="#ffffff" '
        'stroke="#222222" stroke-width="1.6"/>'
    )


SUPPLY = ("supply, 24 V or 12 V", "limit of its current", "E-stop, contact 2", "driver and bridge")


def _supply(top: int) -> Iterator[str]:
    """The way of the motors' supply, which no pin of the board is part of."""
    width = (PART_RIGHT - BOARD_LEFT - 3 * 40) // 4
    for place, name in enumerate(SUPPLY):
        left = BOARD_LEFT + place * (width + 40)
        yield _box(left, top, left + width, top + 50, "#f8e3e3", "#8a3a3a")
        yield from _text(left + width // 2, top + 30, name, 14, "middle", "bold")
        if place:
            yield _line(left - 40, top + 25, left, top + 25, "red")


def _resistor(x: int, y: int, text: str) -> Iterator[str]:
    """A resistor in a row of its wire: a dot, a short lead upwards, and what it leads to."""
    yield f'<circle cx="{x - 46}" cy="{y}" r="4" fill="#222222"/>'
    yield _line(x - 46, y, x - 46, y - 11, "black", 1.6)
    yield _line(x - 46, y - 11, x - 36, y - 11, "black", 1.6)
    yield _symbol(x - 36, y - 16)
    yield _line(x - 6, y - 11, x + 4, y - 11, "black", 1.6)
    yield from _text(x + 9, y - 7, text, 12)


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


def main(arguments: list[str]) -> int:
    """Write the drawings, or compare them."""
    stale = []
    for page in PAGES:
        path = HERE / f"wiring-{page}.svg"
        if arguments != ["--check"]:
            path.write_text(drawing(page), encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != drawing(page):
            stale.append(path.name)
    if stale:
        print(f"{', '.join(stale)}: stale; run python arduino/wiring.py")
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
