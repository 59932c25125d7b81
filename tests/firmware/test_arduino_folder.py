"""The README and drawing of the boards agree with the headers; the IDE can build both folders."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigctl.boards.flash import write_sketches
from rigctl.boards.taxel_frames import input_name, line_name
from rigctl.config.resources import checkout
from rigctl.config.rig_config import TaxelArray
from rigctl.errors import WrongUse
from rigctl.finger.board_messages import model_header
from rigctl.values import DRAWN_WIRING
from tests.firmware.building import built

ROOT = checkout()
assert ROOT is not None
FOLDER = ROOT / "arduino"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
MEGA = {
    "PA0": "D22",
    "PA1": "D23",
    "PA2": "D24",
    "PB5": "D11",
    "PC6": "D31",
    "PC7": "D30",
    "PD2": "D19",
    "PE3": "D5",
    "PE4": "D2",
    "PE5": "D3",
    "PH3": "D6",
    "PH4": "D7",
    "PH5": "D8",
}
"""Pin names on an Arduino Mega 2560 R3 by port of the ATmega2560."""
IDE_FLAGS = [
    "-c",
    "-g",
    "-Os",
    "-std=gnu++11",
    "-fpermissive",
    "-fno-exceptions",
    "-ffunction-sections",
    "-fdata-sections",
    "-fno-threadsafe-statics",
    "-Wno-error=narrowing",
    "-flto",
    "-DF_CPU=16000000L",
    "-DARDUINO=10819",
    "-DARDUINO_ARCH_AVR",
]
IDE_LINK = ["-w", "-Os", "-g", "-flto", "-fuse-linker-plugin", "-Wl,--gc-sections"]
CORE = """
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <avr/io.h>
#include <avr/interrupt.h>
#include <avr/pgmspace.h>
#define min(a, b) ((a) < (b) ? (a) : (b))
#define max(a, b) ((a) > (b) ? (a) : (b))
#define abs(x) ((x) > 0 ? (x) : -(x))
#define round(x) ((x) >= 0 ? (long)((x) + 0.5) : (long)((x)-0.5))
#define constrain(x, low, high) ((x) < (low) ? (low) : ((x) > (high) ? (high) : (x)))
#define bit(b) (1UL << (b))
#define sq(x) ((x) * (x))
#define interrupts() sei()
#define noInterrupts() cli()
#define HIGH 0x1
#define LOW 0x0
#define INPUT 0x0
#define OUTPUT 0x1
typedef bool boolean;
typedef uint8_t byte;
"""
"""Macros and types of the Arduino core's header."""


def table(heading: str) -> list[list[str]]:
    """Return the cells of the first table after a heading of the README."""
    section = README.split(heading, 1)[1]
    rows = re.findall(r"(?:^\|.*\|\n)+", section, re.MULTILINE)[0].splitlines()[2:]
    return [[cell.strip(" `") for cell in row.strip("|").split("|")] for row in rows]


def test_the_drums_pin_table_agrees_with_its_header() -> None:
    header = (FOLDER / "drum" / "board.h").read_text(encoding="utf-8")
    pattern = r"constexpr uint8_t (\w+) = _BV\((P\w\d)\);\s*// (D\d+)"
    declared = {name: (pin, port) for name, port, pin in re.findall(pattern, header)}
    listed = {row[0]: (row[1], row[2]) for row in table("### Mega 2560")}
    assert listed == declared
    pins = header[header.index("namespace pins") : header.index("}  // namespace pins")]
    assert len(declared) == pins.count("constexpr uint8_t")
    assert all(MEGA[port] == pin for pin, port in declared.values())


def test_the_taxel_boards_pin_table_agrees_with_its_header() -> None:
    header = (FOLDER / "taxels" / "board.h").read_text(encoding="utf-8")
    rows = {row[0]: (row[1], row[2]) for row in table("### Uno")}
    found = re.search(r"LINE_BIT\[LINES\] = \{([\d, ]+)\}", header)
    assert found is not None
    lines = [int(n) for n in found[1].split(",")]
    found = re.search(r"INPUT_CHANNEL\[INPUTS\] = \{([\d, ]+)\}", header)
    assert found is not None
    inputs = [int(n) for n in found[1].split(",")]
    expected = {f"line {i + 1}": (f"D{bit}", f"PD{bit}") for i, bit in enumerate(lines)}
    expected |= {f"input {i + 1}": (f"A{n}", f"PC{n}") for i, n in enumerate(inputs)}
    masks = dict(re.findall(r"(SYNC|INDEX)_MASK = (0x\d+);", header))
    for name, mask in masks.items():
        bit = int(mask, 16).bit_length() - 1
        expected[name.lower()] = (f"D{8 + bit}", f"PB{bit}")
    assert rows == expected
    # The host uses these names in its messages.
    assert [f"D{bit}" for bit in lines] == [line_name(line) for line in range(3)]
    assert [f"A{n}" for n in inputs] == [input_name(i) for i in range(6)]


def test_the_default_taxel_order_is_that_of_table_and_drawing() -> None:
    rows = [(row[0], row[-1]) for row in table("### Uno")]
    drawn = (FOLDER / "wiring-uno.svg").read_text(encoding="utf-8")
    terminals = re.findall(r">((?:common|top|bottom)[^<]*: (?:row|column) \d)<", drawn)
    assert order_of(rows) == DRAWN_WIRING
    assert order_of(list(zip(SIGNALS, terminals, strict=True))) == DRAWN_WIRING
    assert TaxelArray().order == DRAWN_WIRING
    printed = re.findall(r"^    ([\d ]+\d)  +(?:top|bottom) layer", README, re.MULTILINE)
    assert tuple(int(n) for part in printed for n in part.split()) == DRAWN_WIRING


SIGNALS = [*(f"line {i}" for i in (1, 2, 3)), *(f"input {i}" for i in range(1, 7))]
"""Signals of the taxel board in the order of the drawing."""


def order_of(wires: list[tuple[str, str]]) -> tuple[int, ...]:
    """Return the reading at each place, from the text on the other end of each signal."""
    lines, inputs = {}, {}
    for signal, end in wires:
        kind, _, number = signal.partition(" ")
        if kind == "line":
            (row,) = re.findall(r"row (\d)", end)
            lines[int(row)] = int(number) - 1
        elif kind == "input":
            (column,) = re.findall(r"column (\d)", end)
            inputs["top" in end, int(column)] = int(number) - 1
    places = [
        (top, row, column) for top in (True, False) for row in (1, 2, 3) for column in (1, 2, 3)
    ]
    return tuple(6 * lines[row] + inputs[top, column] for top, row, column in places)


def test_the_drawings_agree_with_the_headers() -> None:
    command = [sys.executable, str(FOLDER / "wiring.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_mechanics_are_drawn_with_the_dimensions_of_the_firmware() -> None:
    command = [sys.executable, str(FOLDER / "mechanics.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("board", ["mega", "uno", "teensy"])
def test_a_drawing_fits_one_sheet(board: str) -> None:
    drawn = (FOLDER / f"wiring-{board}.svg").read_text(encoding="utf-8")
    found = re.search(r'viewBox="0 0 (\d+) (\d+)"', drawn)
    assert found is not None
    assert int(found[2]) / int(found[1]) < 297 / 210


def test_every_resistor_of_the_readme_is_in_the_drawings() -> None:
    mega, uno, teensy = (
        (FOLDER / f"wiring-{board}.svg").read_text(encoding="utf-8")
        for board in ("mega", "uno", "teensy")
    )
    assert mega.count("10 kΩ to 5 V") == 1  # the stepper driver's enable
    assert mega.count("4.7 kΩ to 5 V") == 4  # emergency stop, two ends, index
    assert mega.count(">10 kΩ to GND<") == 3 + 1  # bridge, clock
    assert mega.count(">470 Ω<") == 2  # the potentiometer's ends
    assert mega.count("1 MΩ to GND") == 1  # its wiper
    assert uno.count(">10 kΩ to GND<") == 6 + 1  # dividers, sync
    assert teensy.count("10 kΩ to GND") == 3  # dividers


@pytest.mark.parametrize("name", ["chip_reset.h", "chip_reset.cpp"])
def test_both_sketches_have_the_same_code_for_resets(name: str) -> None:
    """The Arduino IDE builds a folder without looking outside of it."""
    assert (FOLDER / "drum" / name).read_bytes() == (FOLDER / "taxels" / name).read_bytes()


@pytest.mark.parametrize(("board", "mcu"), [("drum", "atmega2560"), ("taxels", "atmega328p")])
def test_a_sketch_builds_as_the_ide_builds_it(board: str, mcu: str, tmp_path: Path) -> None:
    folder = {path.name: path for path in write_sketches(tmp_path / "sketches")}[board]
    core = tmp_path / "core"
    core.mkdir()
    (core / "Arduino.h").write_text(CORE)
    sketch = tmp_path / f"{board}.ino.cpp"
    sketch.write_text(f'#include <Arduino.h>\n#line 1 "{board}.ino"\n')
    with sketch.open("a", encoding="utf-8") as text:
        text.write((folder / f"{board}.ino").read_text(encoding="utf-8"))
    objects = []
    for source in [sketch, *sorted(folder.glob("*.cpp"))]:
        objects.append(str(tmp_path / f"{source.name}.o"))
        include = [f"-I{core}", f"-I{folder}"]
        compile_ = ["avr-g++", *IDE_FLAGS, f"-mmcu={mcu}", *include, str(source)]
        subprocess.run([*compile_, "-o", objects[-1]], check=True, capture_output=True)
    image = tmp_path / f"{board}.elf"
    link = ["avr-gcc", *IDE_LINK, f"-mmcu={mcu}", *objects, "-lm", "-o", str(image)]
    subprocess.run(link, check=True, capture_output=True)
    budgets = [sys.executable, str(FOLDER / "budgets.py"), board, str(image)]
    assert subprocess.run(budgets, capture_output=True, check=False).returncode == 0


TEENSY_FLAGS = [
    "-c",
    "-std=gnu++17",
    "-O2",
    "-Wall",
    "-Werror",
    "-mcpu=cortex-m7",
    "-mthumb",
    "-mfpu=fpv5-d16",
    "-mfloat-abi=hard",
    "-fno-exceptions",
    "-fno-rtti",
    "-DARDUINO=10819",
    "-D__IMXRT1062__",
    "-include",
    "Arduino.h",
]


@pytest.mark.parametrize("with_model", [False, True])
def test_the_fingers_sketch_builds_as_it_is_written(with_model: bool, tmp_path: Path) -> None:
    """Against a stub of the Teensy core, each file on its own, as the IDE compiles them."""
    random = np.random.default_rng(3)
    features, components, textures = 180, 4, ["A", "B"]
    model = tmp_path / "my model.h"
    model.write_text(
        model_header(
            random.standard_normal(features),
            random.standard_normal((features, components)),
            random.standard_normal((2, components)),
            random.standard_normal(2),
            textures,
        )
    )
    folder = write_sketches(tmp_path / "sketches", model if with_model else None)[-1]
    assert (folder / "trained_model.h").exists() == with_model
    (folder / "finger.ino").rename(folder / "finger.ino.cpp")
    stub = Path(__file__).parent / "teensy"
    for source in sorted(folder.glob("*.cpp")):
        output = tmp_path / f"{source.name}.o"
        command = ["arm-none-eabi-g++", *TEENSY_FLAGS, f"-I{stub}", f"-I{folder}", str(source)]
        done = subprocess.run(
            [*command, "-o", str(output)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        if source.name == "finger.ino.cpp":
            names = subprocess.run(
                ["arm-none-eabi-nm", "-C", str(output)], capture_output=True, text=True, check=True
            )
            assert ("FINGER_CLASSIFIER" in names.stdout) == with_model


def test_sketches_are_never_written_over_and_a_model_is_one(tmp_path: Path) -> None:
    folders = write_sketches(tmp_path / "here")
    names = [path.name for folder in folders for path in folder.iterdir()]
    assert all(name == name.lower() and name.isascii() for name in names)
    with pytest.raises(WrongUse, match="exists already: give another folder"):
        write_sketches(tmp_path / "here")
    (tmp_path / "notes.h").write_text("nothing")
    with pytest.raises(WrongUse, match="is no model of the finger board: write one with"):
        write_sketches(tmp_path / "there", tmp_path / "notes.h")
    assert not (tmp_path / "there").exists()


def test_the_image_to_flash_is_intel_hex_without_eeprom() -> None:
    lines = built("firmware/taxels.hex").read_text().splitlines()
    assert lines[-1] == ":00000001FF"
    highest = max(int(line[3:7], 16) for line in lines if line[7:9] == "00")
    assert highest < 32256
