"""The drum's safety states: state machine, outputs of each state, texts of states and faults.

These tables are the only definition: ``python -m rigctl.boards.codegen`` generates
``arduino/drum/drum_states.h`` and the reference page, and a test tries every state with every
event. The outputs depend on the state alone (:data:`OUTPUTS`).
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class State(IntEnum):
    """State of the drum controller, the value of register ``state``."""

    BOOT = 0
    SELFTEST = 1
    IDLE = 2
    ARMED = 3
    POSITION = 4
    APPROACH = 5
    HOLD = 6
    RUN = 7
    RETRACT = 8
    FAULT_LIFT = 9
    FAULT_OFF = 10
    NUDGE = 11


STATE_TEXT: dict[State, str] = {
    State.BOOT: "starting",
    State.SELFTEST: "testing itself",
    State.IDLE: "off",
    State.ARMED: "armed, lifted",
    State.POSITION: "moving, lifted",
    State.APPROACH: "pressing down",
    State.HOLD: "in contact, holding the force",
    State.RUN: "in contact, turning",
    State.RETRACT: "lifting off",
    State.FAULT_LIFT: "fault: lifting off",
    State.FAULT_OFF: "fault: switched off",
    State.NUDGE: "moving the actuator a little",
}


class StateEvent(IntEnum):
    """An event of the state machine: a command, a completion or a fault."""

    BOOTED = 0
    SELFTEST_PASSED = 1
    SELFTEST_FAILED = 2
    ARM = 3
    DISARM = 4
    MOVE = 5
    APPROACH = 6
    RUN = 7
    RETRACT = 8
    STOP = 9
    CLEAR = 10
    MOVE_DONE = 11
    FORCE_SETTLED = 12
    TRAVEL_DONE = 13
    LIFTED = 14
    TIMED_FAULT = 15
    OFF_FAULT = 16
    LIFT_TIME_OVER = 17
    NUDGE = 18
    NUDGED = 19


class Fault(IntEnum):
    """Why the drum stopped itself; register ``fault`` latches the first, ``fault_bits`` lists all.

    HEARTBEAT, which a run may clear by itself, gives way to any later fault. Bit *n* of
    ``fault_bits`` is fault *n*; bit 0 is unused.
    """

    NONE = 0
    ESTOP = 1
    OVER_FORCE = 2
    LOADCELL_SILENT = 3
    LOADCELL_SATURATED = 4
    LOADCELL_FROZEN = 5
    LOADCELL_DESYNC = 6
    HEARTBEAT = 7
    NO_CONTACT = 8
    ACTUATOR_END = 9
    STEP_COUNT = 10
    HANG = 11
    SELFTEST = 12
    FORCE_UNREACHED = 13
    ACTUATOR_REVERSED = 14
    ACTUATOR_STUCK = 15
    POSITION_WIRE = 16
    FORCE_MISSING = 17
    FORCE_UNEXPLAINED = 18
    TOO_DEEP = 19
    FORCE_UNSTEADY = 20
    LOADCELL_RATE = 21
    LOADCELL_NOISE = 22


FAULT_TEXT: dict[Fault, str] = {
    Fault.NONE: "no fault",
    Fault.ESTOP: "emergency stop pressed or its wire broken: release it, then clear the fault",
    Fault.OVER_FORCE: "force above the limit: check the sensor and the plate, then clear the fault",
    Fault.LOADCELL_SILENT: "load cell sends nothing: check the amplifier's wires and supply",
    Fault.LOADCELL_SATURATED: "load cell at the end of its range: unload it or check its bridge",
    Fault.LOADCELL_FROZEN: "load cell repeats one value: check the amplifier",
    Fault.LOADCELL_DESYNC: "load cell amplifier lost step: check its clock wire for noise",
    Fault.HEARTBEAT: "the computer stopped calling: check the cable, then clear the fault",
    Fault.NO_CONTACT: "no contact within the set travel or time: check the plate and the sensor",
    Fault.ACTUATOR_END: "actuator reached its end: check the mechanics and the travel limit",
    Fault.STEP_COUNT: "index mark and counted steps disagree: the drum slipped or was held",
    Fault.HANG: "the controller hung and its watchdog restarted it: report this with the session",
    Fault.SELFTEST: "self-test failed: see the fault bits, check the wiring, restart the board",
    Fault.FORCE_UNREACHED: "the force did not settle in time: check the plate, or lower the force",
    Fault.ACTUATOR_REVERSED: (
        "the actuator moves against its duty: swap its two wires (or the potentiometer's outer two)"
    ),
    Fault.ACTUATOR_STUCK: (
        "the actuator does not follow its duty: check its supply, its wires, and that nothing jams"
    ),
    Fault.POSITION_WIRE: (
        "the potentiometer reads beyond its resistors, or far from the top where the upper end "
        "switch says top: a wire of one of the two is broken or shorted"
    ),
    Fault.FORCE_MISSING: (
        "the drum is pressed deeper and the load cell does not feel it: check the cell's four wires"
    ),
    Fault.FORCE_UNEXPLAINED: (
        "the reading of the load cell changed without motion: check its wires and what touches it"
    ),
    Fault.TOO_DEEP: (
        "the drum went 1 mm below its last contact: check load cell, sensor and plate; for another "
        "plate, drum or sensor run rigctl calibrate tare --anyway, disarm, and press on the load "
        "cell with a finger"
    ),
    Fault.FORCE_UNSTEADY: (
        "the force swings about its set-point: run rigctl calibrate force, or change the actuator"
    ),
    Fault.LOADCELL_RATE: (
        "the load cell's amplifier does not sample at the rate of rig.toml: connect its RATE pin "
        "to its supply for 80 samples a second, or set rate_hz = 10 in [loadcell]"
    ),
    Fault.LOADCELL_NOISE: (
        "the load cell's readings are too noisy or too quiet for a cell: keep off it; check its "
        "four wires, and that the amplifier's E- is connected to GND"
    ),
}

LIFT_FAULTS = frozenset(
    {
        Fault.OVER_FORCE,
        Fault.LOADCELL_SILENT,
        Fault.LOADCELL_SATURATED,
        Fault.LOADCELL_FROZEN,
        Fault.LOADCELL_DESYNC,
        Fault.HEARTBEAT,
        Fault.NO_CONTACT,
        Fault.STEP_COUNT,
        Fault.FORCE_UNREACHED,
        Fault.POSITION_WIRE,
        Fault.FORCE_MISSING,
        Fault.FORCE_UNEXPLAINED,
        Fault.TOO_DEEP,
        Fault.FORCE_UNSTEADY,
        Fault.LOADCELL_RATE,
        Fault.LOADCELL_NOISE,
    }
)
"""Faults after which the drum is lifted until contact is gone, and then switched off.

All others (E-stop, hang, self-test, what the actuator does) switch everything off immediately.
"""


class Outputs(NamedTuple):
    """What the drivers may do in a state; everything not allowed here is held off."""

    stepper_enabled: bool
    stepper_may_step: bool
    actuator: str  # "off", "hold", "approach", "force_loop", "lift", "nudge"


OUTPUTS: dict[State, Outputs] = {
    State.BOOT: Outputs(False, False, "off"),
    State.SELFTEST: Outputs(False, False, "off"),
    State.IDLE: Outputs(False, False, "off"),
    State.ARMED: Outputs(True, False, "hold"),
    State.POSITION: Outputs(True, True, "hold"),
    State.APPROACH: Outputs(True, False, "approach"),
    State.HOLD: Outputs(True, False, "force_loop"),
    State.RUN: Outputs(True, True, "force_loop"),
    State.RETRACT: Outputs(True, True, "lift"),
    State.FAULT_LIFT: Outputs(True, True, "lift"),
    State.FAULT_OFF: Outputs(False, False, "off"),
    State.NUDGE: Outputs(False, False, "nudge"),
}
"""RETRACT and FAULT_LIFT may step only to ramp down a drum that still turns.

ARM leads through RETRACT: after a boot or a fault it is unknown whether the drum still rests on
the sensor.
"""

_TRANSITIONS: dict[State, dict[StateEvent, State]] = {
    State.BOOT: {StateEvent.BOOTED: State.SELFTEST},
    State.SELFTEST: {
        StateEvent.SELFTEST_PASSED: State.IDLE,
        StateEvent.SELFTEST_FAILED: State.FAULT_OFF,
    },
    State.IDLE: {
        StateEvent.ARM: State.RETRACT,
        StateEvent.NUDGE: State.NUDGE,
        StateEvent.STOP: State.IDLE,
        StateEvent.DISARM: State.IDLE,
    },
    State.ARMED: {
        StateEvent.DISARM: State.IDLE,
        StateEvent.MOVE: State.POSITION,
        StateEvent.APPROACH: State.APPROACH,
        StateEvent.RETRACT: State.RETRACT,
        StateEvent.STOP: State.ARMED,
    },
    State.POSITION: {StateEvent.MOVE_DONE: State.ARMED, StateEvent.STOP: State.RETRACT},
    State.APPROACH: {
        StateEvent.FORCE_SETTLED: State.HOLD,
        StateEvent.RETRACT: State.RETRACT,
        StateEvent.STOP: State.RETRACT,
    },
    State.HOLD: {
        StateEvent.RUN: State.RUN,
        StateEvent.RETRACT: State.RETRACT,
        StateEvent.STOP: State.RETRACT,
    },
    State.RUN: {
        StateEvent.TRAVEL_DONE: State.HOLD,
        StateEvent.RETRACT: State.RETRACT,
        StateEvent.STOP: State.RETRACT,
    },
    State.RETRACT: {StateEvent.LIFTED: State.ARMED, StateEvent.STOP: State.RETRACT},
    State.FAULT_LIFT: {
        StateEvent.LIFT_TIME_OVER: State.FAULT_OFF,
        StateEvent.STOP: State.FAULT_LIFT,
    },
    State.FAULT_OFF: {StateEvent.CLEAR: State.IDLE, StateEvent.STOP: State.FAULT_OFF},
    State.NUDGE: {
        StateEvent.NUDGED: State.IDLE,
        StateEvent.DISARM: State.IDLE,
        StateEvent.STOP: State.IDLE,
    },
}


def next_state(state: State, event: StateEvent) -> State | None:
    """Return the state after ``event`` in ``state``, None where the event is refused.

    A refused command gets Modbus exception 4 and changes nothing; a refused completion is
    ignored. OFF_FAULT always leads to FAULT_OFF. TIMED_FAULT leads to FAULT_LIFT from every
    state that may press and to FAULT_OFF from IDLE, BOOT and SELFTEST, which drive nothing, and
    from NUDGE, which does not know yet where up is; in FAULT_OFF and FAULT_LIFT it changes nothing.
    """
    if event is StateEvent.OFF_FAULT:
        return State.FAULT_OFF
    if event is StateEvent.TIMED_FAULT:
        return _after_timed_fault(state)
    return _TRANSITIONS[state].get(event)


def _after_timed_fault(state: State) -> State:
    if state in (State.FAULT_LIFT, State.FAULT_OFF):
        return state
    return State.FAULT_OFF if OUTPUTS[state].actuator in ("off", "nudge") else State.FAULT_LIFT
