"""Safety checks of an image of the drum controller.

The suite runs each check twice: it must pass on the flashed image, and fail on an image that is
broken in the checked point (:data:`CONTROLS`), which shows that the check detects the defect.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.chips.simavr import Input, Output
from rigctl.boards.drum_codes import Command, ResetCause
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import Fault, State
from tests.firmware.drum.support.chip import MS, DrumChip

IMAGE = "firmware/drum.elf"
HANGS = "firmware/drum-hangs.elf"
"""The image, except that one move target hangs its main loop."""
ESTOP_LIMIT = 1600
"""Cycles in 100 µs."""
MOVING_STATES = (State.ARMED, State.POSITION, State.APPROACH, State.HOLD, State.RUN)
SET_FORCE_G = 500


def hang_main_loop(drum: DrumChip) -> None:
    """Write the move target that hangs the main loop of :data:`HANGS`."""
    drum.exchange(struct.pack(">BHHBi", 16, BY_NAME["move_target"].address, 2, 4, -32_000), 2)


def enter_from_idle(drum: DrumChip, state: State) -> None:
    """Go from IDLE to one of :data:`MOVING_STATES`."""
    drum.arm()
    if state is State.POSITION:
        drum.set("move_target", drum.get("steps") + 40_000)
        assert drum.command(Command.MOVE) == 0
        drum.poll_for(300)
    elif state is State.APPROACH:
        assert drum.command(Command.APPROACH) == 0
        drum.poll_for(300)
    elif state in (State.HOLD, State.RUN):
        drum.hold(SET_FORCE_G)
        if state is State.RUN:
            assert drum.command(Command.RUN) == 0
            drum.poll_for(600)
    assert drum.state is state


def open_emergency_stop(drum: DrumChip, after_cycles: int) -> int:
    """Open the emergency stop and check that all goes off in time; return the delay, cycles."""
    drum.clear_edges()
    at = drum.pin(Input.ESTOP, 1, after_cycles)
    drum.run(3)
    delays = []
    for signal, off in ((Output.ENABLE, 1), (Output.BRIDGE, 0)):
        edges = drum.edges(signal)
        assert edges[0, 1] == off
        delays.append(int(edges[0, 0]) - at)
    assert min(delays) > 0 and max(delays) <= ESTOP_LIMIT
    assert not np.any(drum.steps() > at + ESTOP_LIMIT)
    assert drum.x.drive == 0
    return max(delays)


def the_emergency_stop_acts_within_100_us(image: str) -> None:
    """The drum is ARMED, where an image that handles the stop in the tick is too late."""
    with DrumChip(image) as drum:
        enter_from_idle(drum, State.ARMED)
        open_emergency_stop(drum, 5000)


def a_hung_loop_is_reset_within_100_ms(image: str) -> None:
    """Afterwards the board reports the hang and is in FAULT_OFF."""
    with DrumChip(image) as drum:
        drum.arm()
        boots = drum.get("boot_count")
        hang_main_loop(drum)
        hung_at, resets = int(drum.x.cycle), drum.x.resets
        while drum.x.resets == resets and drum.x.cycle < hung_at + 200 * MS:
            drum.run(1)
        assert drum.x.cycle - hung_at <= 100 * MS
        drum.run(150)
        assert drum.get("reset_cause") >> ResetCause.WATCHDOG & 1
        assert drum.get("boot_count") == boots + 1
        assert drum.get("fault") == Fault.HANG
        assert drum.state is State.FAULT_OFF
        assert drum.command(Command.CLEAR) == 0


def a_lost_heartbeat_lifts_and_switches_off(image: str) -> None:
    """After 250 ms the drum ramps down and lifts; within a second everything is off."""
    with DrumChip(image) as drum:
        enter_from_idle(drum, State.RUN)
        drum.beat()
        begun = int(drum.x.cycle) // MS
        drum.clear_edges()
        drum.run(240)
        assert drum.x.drive > -0.9
        drum.run(20)
        assert drum.x.drive < -0.9
        drum.run(840)
        closed = drum.edges(Output.BRIDGE)
        assert closed[-1, 1] == 0
        assert closed[-1, 0] // MS - begun <= 1000
        assert drum.steps()[-1] // MS - begun <= 700
        assert drum.force_g == 0
        assert drum.get("fault") == Fault.HEARTBEAT


def the_set_force_is_reached_and_held(image: str) -> None:
    """The force is within ±2 % a second after touch, stays there, and overshoots less than 5 %."""
    with DrumChip(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        drum.poll_for(2000)
        forces = np.array(drum.forces[int(np.argmax(np.array(drum.forces) > 0)) :])
        settled = np.convolve(forces, np.ones(200) / 200, "valid")[1000 - 200 :]
        assert np.abs(settled / SET_FORCE_G - 1).max() <= 0.02
        assert forces.max() <= 1.05 * SET_FORCE_G


SPIKE_CYCLES = 160
"""10 µs: the longest that the firmware takes for a spike."""
SWITCH_WIRES = (Input.ESTOP, Input.END_UP, Input.END_DOWN, Input.MARK)
SPIKES_A_MS = 5
"""On each wire, at least two spikes' length apart."""


def spikes_on_the_switch_wires_do_nothing(image: str) -> None:
    """All four wires have spikes of 10 µs at random times, four thousand on each."""
    with DrumChip(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        marks = drum.get("index_count")
        spike_switch_wires(drum, 800)
        assert drum.state is State.HOLD
        assert drum.get("index_count") == marks


def spike_switch_wires(drum: DrumChip, milliseconds: int) -> None:
    """Run with a heartbeat and spikes of :data:`SPIKE_CYCLES` on all switch wires."""
    random = np.random.default_rng(8)
    for number in range(milliseconds):
        changes = []
        for wire in SWITCH_WIRES:
            for at in _spikes_of_a_ms(random):
                changes += [(int(at), wire, 1), (int(at) + SPIKE_CYCLES, wire, 0)]
        for at, wire, level in sorted(changes):
            drum.pin(wire, level, at)
        drum.run(1)
        if number % 20 == 0:
            drum.beat()


def _spikes_of_a_ms(random: np.random.Generator) -> NDArray[np.int64]:
    room = MS // SPIKES_A_MS
    begins: NDArray[np.int64] = random.integers(0, room - 3 * SPIKE_CYCLES, SPIKES_A_MS)
    return np.arange(SPIKES_A_MS) * room + begins


Check = Callable[[str], None]
CONTROLS: tuple[tuple[str, str, Check], ...] = (
    ("no-estop", "no E-stop interrupt, only the tick", the_emergency_stop_acts_within_100_us),
    ("unwatched", "the loop hangs without a watchdog", a_hung_loop_is_reset_within_100_ms),
    ("deaf", "heartbeat ignored", a_lost_heartbeat_lifts_and_switches_off),
    ("swapped", "actuator's sign swapped", the_set_force_is_reached_and_held),
    ("gain-10", "loop gain times ten", the_set_force_is_reached_and_held),
    ("one-look", "one look at a wire decides", spikes_on_the_switch_wires_do_nothing),
)
"""Broken image, what is broken in it, and the check that must fail on it."""
