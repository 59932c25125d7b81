"""Render the drum's tables as the firmware's headers and as the reference page.

``python -m rigctl.wire.codegen`` writes the files; ``--check`` only names those that are stale.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from enum import IntEnum
from pathlib import Path

from rigctl.values import SCALE_BAND_UG_PER_COUNT
from rigctl.wire.drum import codes
from rigctl.wire.drum import register_table as table
from rigctl.wire.drum.codes import Guard
from rigctl.wire.drum.register_entry import Register
from rigctl.wire.drum.states import FAULT_TEXT, LIFT_FAULTS, OUTPUTS, Fault, State, StateEvent
from rigctl.wire.drum.states import next_state as after

CHECKOUT = Path(__file__).resolve().parents[2]
PAGE = "docs/reference/drum-wire.md"
REFUSED = 255
_KINDS = {"u16": "U16", "i16": "I16", "u32": "U32", "i32": "I32"}
_GUARDED = {Guard.NONE: "", Guard.RESTING: "at rest", Guard.LIFTED: "lifted"}
_ACTUATOR = {"off": 0, "hold": 1, "approach": 2, "force_loop": 3, "lift": 4}


def rendered() -> dict[str, str]:
    """Return every generated file: path in the checkout → its whole text."""
    return {
        PAGE: _page(),
        "arduino/drum/drum_map.h": _map_header(),
        "arduino/drum/drum_states.h": _states_header(),
    }


def stale(checkout: Path = CHECKOUT) -> list[str]:
    """Paths of generated files that are missing or differ from what the tables say."""
    return [path for path, text in rendered().items() if _text_of(checkout / path) != text]


def _text_of(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.is_file() else None


# --- C++ headers ---------------------------------------------------------------------------


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _enum(enum: type[IntEnum], underlying: str, name: str = "") -> str:
    body = "\n".join(f"    {_camel(member.name)} = {member.value}," for member in enum)
    return f"enum class {name or enum.__name__} : {underlying} {{\n{body}\n}};\n"


def _header(guard: str, source: str, body: Iterable[str]) -> str:
    top = (
        f"// Generated from rigctl/wire/{source} by `python -m rigctl.wire.codegen`;\n"
        f"// change the table there, never this file.\n"
        f"#ifndef {guard}\n#define {guard}\n\n#include <stdint.h>\n\n"
        '#include "flash.h"  // constant tables stay in program memory\n\n'
    )
    return top + "\n".join(body) + f"\n#endif  // {guard}\n"


def _constant(name: str, value: int, kind: str = "uint16_t") -> str:
    return f"constexpr {kind} {name} = {value};"


def _addresses() -> str:
    lines = [f"constexpr uint16_t {r.name} = {r.address};" for r in table.REGISTERS]
    return "namespace reg {\n" + "\n".join(lines) + "\n}  // namespace reg\n"


def _c_integer(value: int) -> str:
    return f"{value}L"


def _setting_line(register: Register) -> str:
    numbers = (register.low, register.high, register.default, register.least)
    kind = f"Kind::{_KINDS[register.kind]}, Guard::{_camel(register.guard.name)}"
    values = ", ".join(map(_c_integer, numbers))
    return f"    {{{register.address}, {kind}, {values}}},  // {register.name}, {register.unit}"


def _settings_table() -> str:
    lines = "\n".join(_setting_line(r) for r in table.SETTINGS)
    return (
        "// Everything that may be written, by rising address; bounds are raw register integers,\n"
        "// `least` bounds the magnitude.\n"
        "struct Setting {\n    uint16_t address;\n    Kind kind;\n    Guard guard;\n"
        "    int32_t low, high, initial, least;\n};\n\n"
        f"constexpr uint8_t SETTING_COUNT = {len(table.SETTINGS)};\n"
        f"constexpr Setting SETTINGS[SETTING_COUNT] FLASH = {{\n{lines}\n}};\n"
    )


def _map_header() -> str:
    start, count = table.SETTINGS_BLOCK
    constants = [
        _constant("MAGIC", table.MAGIC),
        _constant("MAP_VERSION", table.MAP_VERSION),
        _constant("BOARD_DRUM", table.BOARD_DRUM),
        _constant("UNIT", table.UNIT, "uint8_t"),
        _constant("BAUD", table.BAUD, "uint32_t"),
        _constant("LOADCELL_RECENT", table.LOADCELL_RECENT, "uint8_t"),
        _constant("RING_DEPTH", table.RING_DEPTH, "uint8_t"),
        _constant("TARE_PLACES", table.TARE_PLACES, "uint8_t"),
        _constant("SCALE_LEAST_UG", SCALE_BAND_UG_PER_COUNT[0], "int32_t"),
        _constant("SCALE_MOST_UG", SCALE_BAND_UG_PER_COUNT[1], "int32_t"),
        _constant("SETTINGS_START", start),
        _constant("SETTINGS_WORDS", count),
        _constant("COUNTERS_END", table.COUNTERS[-1].end),
        _constant("MAP_END", table.END),
    ]
    enums = [
        _enum(codes.Command, "uint8_t"),
        _enum(codes.CommandResult, "uint8_t"),
        _enum(codes.ForceMode, "uint8_t"),
        _enum(codes.Signal, "uint8_t"),
        _enum(codes.SettingsFrom, "uint8_t"),
        _enum(codes.Status, "uint8_t"),
        _enum(codes.Guard, "uint8_t"),
        _enum(codes.ResetCause, "uint8_t"),
        "enum class Kind : uint8_t { U16, I16, U32, I32 };\n",
    ]
    body = ["\n".join(constants) + "\n", *enums, _addresses(), _settings_table()]
    return _header("DRUM_MAP_H", "drum/register_table.py", body)


def _transition_row(state: State) -> str:
    targets = [after(state, event) for event in StateEvent]
    cells = ", ".join(str(REFUSED if t is None else int(t)) for t in targets)
    return f"    {{{cells}}},  // {state.name}"


def _transitions() -> str:
    rows = "\n".join(_transition_row(state) for state in State)
    return (
        "// TRANSITIONS[state][event] is the next state, REFUSED where the event is refused.\n"
        f"constexpr uint8_t REFUSED = {REFUSED};\n"
        f"constexpr uint8_t TRANSITIONS[STATE_COUNT][EVENT_COUNT] FLASH = {{\n{rows}\n}};\n"
    )


def _output_row(state: State) -> str:
    out = OUTPUTS[state]
    cells = f"{int(out.stepper_enabled)}, {int(out.stepper_may_step)}, {_ACTUATOR[out.actuator]}"
    return f"    {{{cells}}},  // {state.name}"


def _outputs() -> str:
    words = "\n".join(f"    {_camel(name)} = {value}," for name, value in _ACTUATOR.items())
    rows = "\n".join(_output_row(state) for state in State)
    return (
        f"enum class Drive : uint8_t {{\n{words}\n}};\n\n"
        "// What the drivers may do in a state; everything not allowed here is held off.\n"
        "struct Outputs {\n    uint8_t stepper_enabled, stepper_may_step, drive;\n};\n\n"
        f"constexpr Outputs OUTPUTS[STATE_COUNT] FLASH = {{\n{rows}\n}};\n"
    )


def _states_header() -> str:
    lift_mask = sum(1 << int(fault) for fault in LIFT_FAULTS)
    body = [
        _enum(State, "uint8_t"),
        _enum(StateEvent, "uint8_t", "Event"),
        _enum(Fault, "uint8_t"),
        f"constexpr uint8_t STATE_COUNT = {len(State)};\n"
        f"constexpr uint8_t EVENT_COUNT = {len(StateEvent)};\n"
        f"constexpr uint8_t FAULT_COUNT = {len(Fault)};\n\n"
        "// Bit n: fault n lifts off before it switches off; all others switch off.\n"
        f"constexpr uint16_t LIFT_FAULTS = 0x{lift_mask:04x};\n",
        _transitions(),
        _outputs(),
    ]
    return _header("DRUM_STATES_H", "drum/states.py", body)


# --- reference page ------------------------------------------------------------------------


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _unit(register: Register) -> str:
    if register.scale == 1:
        return register.unit or "–"
    return f"{register.scale:g} {register.unit}".strip()


def _place(register: Register) -> str:
    last = register.end - 1
    return f"{register.address}" if last == register.address else f"{register.address}–{last}"


def _read_rows(registers: Iterable[Register]) -> str:
    rows = [(_place(r), f"`{r.name}`", r.kind, _unit(r), r.doc) for r in registers]
    return _table(("address", "name", "kind", "one count is", "meaning"), rows)


def _write_rows(registers: Iterable[Register]) -> str:
    rows = [
        (
            _place(r),
            f"`{r.name}`",
            r.kind,
            _unit(r),
            _bounds(r),
            str(r.default),
            _GUARDED[r.guard],
            r.doc,
        )
        for r in registers
    ]
    head = ("address", "name", "kind", "one count is", "bounds", "at boot", "changed", "meaning")
    return _table(head, rows)


def _bounds(register: Register) -> str:
    if register.least:
        return f"±{register.least} … ±{register.high}"
    return f"{register.low} … {register.high}"


def _enum_rows(enum: type[IntEnum]) -> str:
    return ", ".join(f"{member.value} {member.name}" for member in enum)


def _state_rows() -> str:
    rows = [
        (
            f"{state.value} {state.name}",
            "on" if OUTPUTS[state].stepper_enabled else "off",
            "yes" if OUTPUTS[state].stepper_may_step else "no",
            OUTPUTS[state].actuator,
            _arrows(state),
        )
        for state in State
    ]
    return _table(("state", "stepper", "may step", "actuator", "event → next state"), rows)


def _arrows(state: State) -> str:
    pairs = [(event, after(state, event)) for event in StateEvent]
    return ", ".join(f"{e.name} → {t.name}" for e, t in pairs if t is not None)


def _fault_rows() -> str:
    rows = [
        (
            f"{fault.value} {fault.name}",
            "lift, then off" if fault in LIFT_FAULTS else ("–" if not fault else "off at once"),
            FAULT_TEXT[fault],
        )
        for fault in Fault
    ]
    return _table(("fault", "the drum", "what it says"), rows)


_INTRODUCTION = f"""# The drum's wire

<!-- Generated by `python -m rigctl.wire.codegen` from rigctl/wire/drum/register_table.py. -->

The drum controller is a Modbus RTU slave: {table.BAUD} baud, 8N1, unit {table.UNIT}.
Registers are 16 bits wide, a 32-bit value takes two with the high word first, addresses count
from 0 as on the wire. Functions 3, 6, 16 and 23 are served; 23 writes first and then reads.

- A frame ends by its function's length, never by a pause; 10 ms of silence reset the parser.
  Requests stay under 64 bytes. A request for another unit or with a bad CRC gets no reply.
- A write is applied whole or not at all. Exception 1: unknown function. 2: no such register, or
  one that cannot be written. 3: a value out of bounds, or a count that does not fit its bytes.
  4: a command or a change that the present state refuses, or whose conditions are not met.
- What decides what a force means, or what stops it, is changed *at rest* only: in IDLE or ARMED,
  the emergency stop closed, no contact known to stand. The tare asks for more: that the drum is
  known to be *lifted* (`CONTACT_MAY_STAND` is 0). Writing the value that a register has is
  harmless in every state.
- TARE and TARE_TURN need a lifted drum and a reading near the zero that the board knows;
  TARE_ANYWAY needs neither. APPROACH needs a lifted drum, a tare near that zero, and a set force
  that leaves a tenth below `over_force` and below the board's own limit.
- `CONTACT_MAY_STAND`: the drum may rest on something: it pressed, or a boot or a change of end
  switches or potentiometer left it unknown, and no lift has ended since. ARM lifts. `LIFT_FAILED`:
  the last lift ended without a sign that contact is gone; lift the drum by hand, or ARM again.
- FAULT_LIFT lasts 700 ms at least, and until contact is gone; it ends without that after 1.6 times
  what the whole travel takes. The board lifts at `most_force`, whatever settings say; how far the
  drum may travel meanwhile is `overrun_um`.
- A command is the value of `command`, executed when `command_sequence` changes. Its outcome
  stands in `command_result` once `command_acknowledged` shows the sequence; a command that takes
  time answers RUNNING first.
- Each change of `heartbeat` is a beat. Every state but BOOT, SELFTEST, IDLE and FAULT_OFF needs
  one within `heartbeat_limit_ms`.
- One poll is one function 23: write heartbeat, read {table.POLL_BLOCK[1]} registers from
  {table.POLL_BLOCK[0]}. Load-cell samples that a poll missed stay in the ring: sample *n* is at
  place *n* mod {table.RING_DEPTH}.
"""


def _page() -> str:
    parts = [
        _INTRODUCTION,
        "## Who is there\n",
        _read_rows(table.IDENTITY),
        "## What a poll reads\n",
        _read_rows(table.POLL),
        "## What may be written\n",
        _write_rows(table.SETTINGS),
        "## Counters\n",
        _read_rows(table.COUNTERS),
        "## Load-cell ring\n",
        _read_rows(table.RING),
        f"Register {table.END} is the first that does not exist. Addresses between the entries "
        "read as 0 and refuse writes.\n",
        "## Values\n",
        f"- Command: {_enum_rows(codes.Command)}",
        f"- CommandResult: {_enum_rows(codes.CommandResult)}",
        f"- ForceMode: {_enum_rows(codes.ForceMode)}",
        f"- Signal, bit numbers: {_enum_rows(codes.Signal)}",
        f"- SettingsFrom: {_enum_rows(codes.SettingsFrom)}",
        f"- Status, bit numbers: {_enum_rows(codes.Status)}",
        f"- ResetCause, bit numbers: {_enum_rows(codes.ResetCause)}\n",
        "## States\n",
        _state_rows(),
        "## Faults\n",
        _fault_rows(),
    ]
    return "\n".join(parts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes the files, or with ``--check`` returns 1 and names those that are stale."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only say which files are stale")
    only_check = parser.parse_args(arguments).check
    old = stale()
    for path in old:
        print(f"{path}: {'stale' if only_check else 'written'}")
        if not only_check:
            (CHECKOUT / path).parent.mkdir(parents=True, exist_ok=True)
            (CHECKOUT / path).write_text(rendered()[path], encoding="utf-8")
    return 1 if only_check and old else 0


if __name__ == "__main__":
    sys.exit(main())
