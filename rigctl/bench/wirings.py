"""The catalogue of wrong wirings and faulty parts: switches of the simulated bench.

Each :class:`Wiring` changes fields of the :class:`~rigctl.bench.circuit.Circuit`.
Wirings of one ``group`` look the same to every sensor of the rig; a check by hand decides which it
is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any, Literal

from rigctl.bench.circuit import AS_DRAWN, Circuit, Direction, Wiper, Wire
from rigctl.config.text_file import shorten
from rigctl.errors import WrongUse

N_NEAR = 4
"""Names that an error lists."""


@dataclass(frozen=True, slots=True)
class Wiring:
    """One wrong wiring or faulty part.

    ``name`` is what a person would call it, ``board`` the board whose wires or parts it concerns,
    ``text`` says what is connected how, ``effects`` are fields of the circuit, ``group`` names
    those that no sensor can tell apart, empty for one that stands alone. ``reaches`` says where the
    effect shows: on both builds, on simulated chips alone, or only to a person with a meter.
    """

    name: str
    board: Literal["drum", "taxels", "both"]
    text: str
    effects: Mapping[str, Any]
    group: str = ""
    reaches: Literal["both builds", "chips", "a person"] = "both builds"


DRUM_STANDS = "the drum does not turn"
DRUM_BACKWARDS = "the drum turns backwards"
HALF_A_TURN = "the index comes twice a commanded turn"
TWO_TURNS = "the index comes once in two commanded turns"
ACTUATOR_STANDS = "the actuator does not move"
NO_PRESS = "the actuator does not press"
ENDS_OPEN = "an end switch reads open"
STOP_OPEN = "the emergency stop reads open"
POSITION_LOW = "the potentiometer reads 0"
CELL_DEAF = "the load cell converts and feels nothing"
CELL_WEAK = "the load cell counts half as much"
INDEX_STILL = "the index never changes"
PLACES_MOVED = "the taxels answer at other places"

_CATALOGUE = (
    # --- actuator and its bridge
    Wiring(
        "actuator swapped",
        "drum",
        "the actuator's two wires are exchanged at the bridge",
        {"actuator_polarity": -1.0},
    ),
    Wiring(
        "actuator supply missing",
        "drum",
        "the bridge has no supply",
        {"actuator_supply": 0.0},
        ACTUATOR_STANDS,
    ),
    Wiring(
        "actuator unplugged",
        "drum",
        "a wire from the bridge to the actuator is open",
        {"press_half": False, "lift_half": False},
        ACTUATOR_STANDS,
    ),
    Wiring(
        "actuator supply half",
        "drum",
        "a 12 V supply feeds an actuator of 24 V",
        {"actuator_supply": 0.5},
    ),
    Wiring(
        "bridge never presses",
        "drum",
        "the half of the bridge that presses is dead, or D6 is unplugged",
        {"press_half": False},
        NO_PRESS,
    ),
    Wiring(
        "bridge never lifts",
        "drum",
        "the half of the bridge that lifts is dead, or D7 is unplugged",
        {"lift_half": False},
    ),
    Wiring(
        "bridge enable stuck high",
        "drum",
        "the bridge's enable is connected to 5 V instead of D8",
        {"bridge_held_on": True},
        reaches="a person",
    ),
    # --- potentiometer
    Wiring(
        "potentiometer reversed",
        "drum",
        "the potentiometer's ends are exchanged",
        {"is_position_reversed": True},
    ),
    Wiring(
        "potentiometer wiper open",
        "drum",
        "the wire to A0 is open; the pull-down holds the input at 0",
        {"wiper": Wiper.OPEN},
        POSITION_LOW,
    ),
    Wiring(
        "potentiometer wiper open, no pull-down",
        "drum",
        "the wire to A0 is open and nothing holds the input",
        {"wiper": Wiper.OPEN, "pull_down": False},
    ),
    Wiring(
        "potentiometer shorted to ground",
        "drum",
        "the wire to A0 touches ground",
        {"wiper": Wiper.GROUND},
        POSITION_LOW,
    ),
    Wiring(
        "potentiometer shorted to 5 V",
        "drum",
        "the wire to A0 touches 5 V",
        {"wiper": Wiper.SUPPLY},
    ),
    Wiring(
        "potentiometer ground end open",
        "drum",
        "the wire from the potentiometer's upper end to ground is open",
        {"ground_end": False},
    ),
    Wiring(
        "potentiometer 5 V end open",
        "drum",
        "the wire from the potentiometer's lower end to 5 V is open",
        {"supply_end": False},
        POSITION_LOW,
    ),
    # --- end switches, emergency stop
    Wiring(
        "end switches swapped",
        "drum",
        "the upper switch is at D31, the lower one at D30",
        {"ends_swapped": True},
    ),
    Wiring(
        "end switches normally open",
        "drum",
        "both switches close at their end instead of opening",
        {"upper_end": Wire.INVERTED, "lower_end": Wire.INVERTED},
    ),
    Wiring(
        "upper end switch unplugged",
        "drum",
        "the wire of the upper switch is open",
        {"upper_end": Wire.OPEN},
        ENDS_OPEN,
    ),
    Wiring(
        "lower end switch unplugged",
        "drum",
        "the wire of the lower switch is open",
        {"lower_end": Wire.OPEN},
        ENDS_OPEN,
    ),
    Wiring(
        "end switches bridged",
        "drum",
        "both inputs are connected to ground: they never read an end",
        {"upper_end": Wire.LOW, "lower_end": Wire.LOW},
    ),
    Wiring(
        "E-stop bridged",
        "drum",
        "D3 is connected to ground: pressing the emergency stop changes nothing there",
        {"estop": Wire.LOW},
    ),
    Wiring(
        "E-stop normally open",
        "drum",
        "contact 1 of the emergency stop closes when it is pressed",
        {"estop": Wire.INVERTED},
        STOP_OPEN,
    ),
    Wiring(
        "E-stop unplugged",
        "drum",
        "the wire of contact 1 is open",
        {"estop": Wire.OPEN},
        STOP_OPEN,
    ),
    Wiring(
        "E-stop second contact not in the supply",
        "drum",
        "motor and actuator keep their supply while the emergency stop is pressed",
        {"stop_cuts_supply": False},
        reaches="a person",
    ),
    Wiring(
        "noise on switches",
        "drum",
        "spikes of 5 µs, twenty a second, at the pins of end switches and E-stop: no capacitors",
        {"switch_noise": True},
        reaches="chips",
    ),
    # --- load cell
    Wiring(
        "cell reversed",
        "drum",
        "A+ and A− are exchanged: pressing counts down",
        {"cell_gain": -1.0},
    ),
    Wiring(
        "cell half-bridge",
        "drum",
        "half of the cell's bridge is connected, beside two fixed resistors",
        {"cell_gain": 0.5, "cell_stray_counts": 4000.0},
        CELL_WEAK,
    ),
    Wiring(
        "amplifier at gain 64",
        "drum",
        "the amplifier amplifies half as much as the board asks for",
        {"cell_gain": 0.5},
        CELL_WEAK,
    ),
    Wiring(
        "cell unplugged",
        "drum",
        "A+ and A− hang on nothing",
        {"cell_gain": 0.0, "cell_stray_counts": 41_000.0, "cell_noise_counts": 20_000.0},
    ),
    Wiring(
        "cell excitation open",
        "drum",
        "E+ is open: the reading is steady, noisy and plausible",
        {"cell_gain": 0.0, "cell_stray_counts": 3100.0, "cell_noise_counts": 125.0},
        CELL_DEAF,
    ),
    Wiring(
        "cell inputs shorted",
        "drum",
        "A+ and A− touch each other",
        {"cell_gain": 0.0, "cell_noise_counts": 40.0},
        CELL_DEAF,
    ),
    Wiring(
        "cell on channel B",
        "drum",
        "the cell is connected to B+ and B−, the board reads channel A",
        {"cell_gain": 0.0, "cell_stray_counts": -600.0, "cell_noise_counts": 60.0},
        CELL_DEAF,
    ),
    Wiring(
        "E− not connected to ground",
        "drum",
        "a defect of some amplifier modules: E− floats, so the bridge has little excitation",
        {"cell_gain": 0.3, "cell_stray_counts": 150_000.0, "cell_noise_counts": 4000.0},
    ),
    Wiring(
        "cell at 10 samples a second",
        "drum",
        "RATE is low, as most modules ship: ten conversions a second",
        {"cell_periods": 8.0},
    ),
    Wiring(
        "single bad cell samples",
        "drum",
        "one conversion of 160 is wrong by 1,000 g",
        {"cell_spike_every": 160},
    ),
    Wiring(
        "cell clock unplugged",
        "drum",
        "SCK is open: the board reads zeros, out of step; a chip also reads far too often",
        {"cell_clock": False},
    ),
    Wiring(
        "cell data unplugged",
        "drum",
        "DOUT is open: no conversion becomes ready",
        {"cell_data": False},
    ),
    # --- stepper
    Wiring(
        "stepper coil reversed",
        "drum",
        "the two wires of one coil are exchanged",
        {"direction": Direction.REVERSED},
        DRUM_BACKWARDS,
    ),
    Wiring(
        "direction reversed",
        "drum",
        "the driver takes the direction line the other way round",
        {"direction": Direction.REVERSED},
        DRUM_BACKWARDS,
    ),
    Wiring(
        "direction stuck",
        "drum",
        "DIR is unplugged: the drum turns forwards whatever the board says",
        {"direction": Direction.STUCK},
    ),
    Wiring(
        "stepper coils crossed",
        "drum",
        "a wire of each coil is exchanged with the other's: the motor only hums",
        {"coils": False},
        DRUM_STANDS,
    ),
    Wiring(
        "stepper unplugged",
        "drum",
        "the motor's plug is out of its driver",
        {"coils": False},
        DRUM_STANDS,
    ),
    Wiring("step unplugged", "drum", "STEP is open", {"step": False}, DRUM_STANDS),
    Wiring(
        "stepper enable inverted",
        "drum",
        "the driver is on while the board switches it off, and off while it turns the drum",
        {"enable": Wire.INVERTED},
        DRUM_STANDS,
    ),
    Wiring(
        "stepper enable unplugged",
        "drum",
        "the driver's enable is open; its resistor holds it off",
        {"enable": Wire.OPEN},
        DRUM_STANDS,
    ),
    Wiring(
        "motor supply missing",
        "drum",
        "the stepper driver has no supply",
        {"motor_supply": 0.0},
        DRUM_STANDS,
    ),
    Wiring(
        "8 microsteps",
        "drum",
        "the driver makes 8 microsteps of a step, the board counts 16",
        {"step_size": 2.0},
        HALF_A_TURN,
    ),
    Wiring(
        "32 microsteps",
        "drum",
        "the driver makes 32 microsteps of a step, the board counts 16",
        {"step_size": 0.5},
        TWO_TURNS,
    ),
    Wiring(
        "belt 2:1",
        "drum",
        "the belt has half the ratio: a pulse turns the drum twice as far",
        {"step_size": 2.0},
        HALF_A_TURN,
    ),
    Wiring(
        "belt 3:1",
        "drum",
        "the belt has three quarters of the ratio",
        {"step_size": 4.0 / 3.0},
    ),
    Wiring(
        "drum of 360 mm",
        "drum",
        "the drum is a tenth thinner than the board assumes: speed and travel are a tenth less",
        {"diameter": 0.9},
    ),
    # --- index, sync
    Wiring(
        "index missing",
        "drum",
        "the index sensor is unplugged; the resistor pulls D2 up",
        {"index": Wire.OPEN},
        INDEX_STILL,
    ),
    Wiring(
        "index stuck low",
        "drum",
        "the index sensor never sees its mark",
        {"index": Wire.LOW},
        INDEX_STILL,
    ),
    Wiring(
        "index inverted",
        "drum",
        "the index sensor is low at its mark",
        {"index": Wire.INVERTED},
    ),
    Wiring(
        "index twice a turn",
        "drum",
        "the drum has a second mark opposite to the first",
        {"marks_per_turn": 2},
        HALF_A_TURN,
    ),
    Wiring(
        "index at Uno missing",
        "taxels",
        "the wire from the index sensor to D9 of the Uno is open",
        {"index_at_uno": False},
    ),
    Wiring(
        "sync wire missing",
        "taxels",
        "the wire from D24 of the Mega to D8 of the Uno is open",
        {"sync": False},
    ),
    # --- sensor
    Wiring(
        "taxel lines permuted",
        "taxels",
        "the sensor's lines 1 and 2 are exchanged",
        {"lines": (1, 0, 2)},
        PLACES_MOVED,
    ),
    Wiring(
        "taxel inputs permuted",
        "taxels",
        "read lines 1 and 2 of the top layer are exchanged",
        {"inputs": (1, 0, 2, 3, 4, 5)},
        PLACES_MOVED,
    ),
    Wiring(
        "taxel layers exchanged",
        "taxels",
        "the bottom layer's read lines are at A0 to A2, the top layer's at A3 to A5",
        {"inputs": (3, 4, 5, 0, 1, 2)},
    ),
    Wiring(
        "taxel inputs shorted",
        "taxels",
        "A0 and A1 touch each other",
        {"shorted_inputs": (0, 1)},
    ),
    Wiring(
        "taxel line open",
        "taxels",
        "the wire from D5 to the sensor's line 2 is broken",
        {"open_lines": (1,)},
    ),
    Wiring(
        "taxel input open",
        "taxels",
        "the wire from A2 to the top layer's read line 3 is broken",
        {"open_inputs": (2,)},
    ),
    Wiring(
        "taxel divider missing",
        "taxels",
        "A4 has no resistor to ground",
        {"missing_dividers": (4,)},
    ),
    # --- boards and supply
    Wiring(
        "boards swapped",
        "both",
        "the Uno is at the drum's port, the Mega at the taxels' port",
        {"ports": ("taxels", "drum")},
    ),
    Wiring(
        "two boards of one kind",
        "both",
        "a board with the drum's firmware answers at both ports",
        {"ports": ("drum", "drum")},
    ),
    Wiring(
        "supply at 4.4 V",
        "both",
        "a thin USB cable: the boards' 5 V are 4.4 V",
        {"logic_mv": 4400},
    ),
)

WIRINGS: Mapping[str, Wiring] = {wiring.name: wiring for wiring in _CATALOGUE}
"""The catalogue by name."""


def find_wiring(name: str) -> Wiring:
    """Return a wiring of the catalogue, in any case of letters and with any minus sign.

    Raises WrongUse that lists the names most like a wrong one.
    """
    by_folded = {_folded(known): wiring for known, wiring in WIRINGS.items()}
    if (known := by_folded.get(_folded(name))) is not None:
        return known
    near = get_close_matches(_folded(name), by_folded, N_NEAR, cutoff=0.0)
    names = ", ".join(f'"{by_folded[one].name}"' for one in near)
    raise WrongUse(f"there is no wiring {shorten(repr(name))}: near it are {names}")


def _folded(name: str) -> str:
    return " ".join(name.casefold().replace("−", "-").split())


def circuit_of(names: Iterable[str]) -> Circuit:
    """Return the drawing with these wirings; of two that contradict each other the later holds."""
    circuit = AS_DRAWN
    for name in names:
        circuit = replace(circuit, **find_wiring(name).effects)
    return circuit


def catalogue_table() -> str:
    """Return the catalogue as a table in Markdown."""
    rows = [
        f"| {w.name} | {w.board} | {w.text} | {w.reaches} | {w.group or '–'} |" for w in _CATALOGUE
    ]
    head = ["| wiring | board | what is connected how | shows on | alike to the sensors |"]
    return "\n".join([*head, "|---|---|---|---|---|", *rows]) + "\n"
