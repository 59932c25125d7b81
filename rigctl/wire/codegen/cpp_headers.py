"""The firmware's C++ headers: registers, codes, states and transitions."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum

from rigctl.values import SCALE_BAND_UG_PER_COUNT
from rigctl.wire.drum import codes
from rigctl.wire.drum import register_table as table
from rigctl.wire.drum.register_table import Register
from rigctl.wire.drum.states import LIFT_FAULTS, OUTPUTS, Fault, State, StateEvent, next_state

REFUSED = 255
_KINDS = {"u16": "U16", "i16": "I16", "u32": "U32", "i32": "I32"}
_ACTUATOR = {"off": 0, "hold": 1, "approach": 2, "force_loop": 3, "lift": 4, "nudge": 5}
_ENUMERATIONS: tuple[type[IntEnum], ...] = (
    codes.Command,
    codes.CommandResult,
    codes.ForceMode,
    codes.Signal,
    codes.SettingsFrom,
    codes.Status,
    codes.Guard,
    codes.ResetCause,
)


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _enum(enum: type[IntEnum], name: str = "") -> str:
    body = "\n".join(f"    {_camel(member.name)} = {member.value}," for member in enum)
    return f"enum class {name or enum.__name__} : uint8_t {{\n{body}\n}};\n"


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


def _setting_line(register: Register) -> str:
    numbers = (register.low, register.high, register.default, register.least)
    kind = f"Kind::{_KINDS[register.kind]}, Guard::{_camel(register.guard.name)}"
    values = ", ".join(f"{number}L" for number in numbers)
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


def register_header() -> str:
    """Return ``drum_map.h``: constants, codes, addresses and the table of settings."""
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
        *map(_enum, _ENUMERATIONS),
        "enum class Kind : uint8_t { U16, I16, U32, I32 };\n",
    ]
    body = ["\n".join(constants) + "\n", *enums, _addresses(), _settings_table()]
    return _header("DRUM_MAP_H", "drum/register_table.py", body)


def _transition_row(state: State) -> str:
    targets = [next_state(state, event) for event in StateEvent]
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


def state_header() -> str:
    """Return ``drum_states.h``: states, events, faults, transitions and outputs."""
    lift_mask = sum(1 << int(fault) for fault in LIFT_FAULTS)
    body = [
        _enum(State),
        _enum(StateEvent, "Event"),
        _enum(Fault),
        f"constexpr uint8_t STATE_COUNT = {len(State)};\n"
        f"constexpr uint8_t EVENT_COUNT = {len(StateEvent)};\n"
        f"constexpr uint8_t FAULT_COUNT = {len(Fault)};\n\n"
        "// Bit n: fault n lifts off before it switches off; all others switch off.\n"
        f"constexpr uint32_t LIFT_FAULTS = 0x{lift_mask:06x};\n",
        _transitions(),
        _outputs(),
    ]
    return _header("DRUM_STATES_H", "drum/states.py", body)
