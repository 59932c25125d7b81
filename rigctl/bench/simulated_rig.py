"""Common interface of simulated rigs: two cables, a clock, fault injection and ground truth.

Virtual boards and simulated chips both implement :class:`SimulatedRig`. Everything runs in the
caller's thread: time passes only inside :meth:`SimulatedRig.advance`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Literal, Protocol

import numpy as np
from msgspec import Meta

from rigctl.bench.circuit import (
    AS_DRAWN,
    Circuit,
    TestPoints,
    Wire,
    wire_level,
    wire_of,
)
from rigctl.bench.ground_truth import GroundTruth
from rigctl.bench.touch import N_PLACES, NO_TOUCH, Touch
from rigctl.bench.wirings import circuit_of, find_wiring
from rigctl.boards.drum_codes import Signal
from rigctl.errors import LinkLost

DRUM = "drum"
TAXELS = "taxels"
TO_HOST = "to_host"
TO_BOARD = "to_board"
Board = Literal["drum", "taxels"]
Direction = Literal["to_host", "to_board"]
Rate = Annotated[float, Meta(ge=0, le=1)]
"""A share of bytes."""
StandStill = Annotated[float, Meta(ge=0, le=3600)]
"""Seconds."""
Push = Annotated[float, Meta(ge=-100_000, le=100_000)]
Places = Annotated[Collection[Annotated[int, Meta(ge=0, lt=N_PLACES)]], Meta(max_length=N_PLACES)]
Wires = Annotated[Collection[Signal], Meta(max_length=len(Signal))]
WiringName = Annotated[str, Meta(max_length=80)]


class LoadcellFault(IntEnum):
    """Fault of the load-cell amplifier, with the numbers of ``enum sim_loadcell_mode``."""

    NONE = 0
    SILENT = 1
    FROZEN = 2
    SATURATED = 3


@dataclass(slots=True)
class Disturbances:
    """Disturbances that are active on the bench; mechanics and boards read them.

    ``absent`` and ``inverted``: optional wires that the rig does not have, or has with the opposite
    polarity. ``circuit``: how the bench is connected. ``held_ends``: the upper and the lower end
    switch, by a hand.
    """

    estop_pressed: bool = False
    motor_jammed: bool = False
    push_g: float = 0.0
    loadcell: LoadcellFault = LoadcellFault.NONE
    touch: Touch = NO_TOUCH
    absent: frozenset[Signal] = frozenset()
    inverted: frozenset[Signal] = frozenset()
    circuit: Circuit = AS_DRAWN
    held_ends: tuple[bool, bool] = (False, False)

    @property
    def has_supply(self) -> bool:
        """Whether motor and actuator have their supplies; a rig without a stop cannot cut them."""
        is_cut = self.estop_pressed and Signal.ESTOP not in self.absent
        return not (is_cut and self.circuit.stop_cuts_supply)

    @property
    def motor_turns(self) -> bool:
        """Whether the drum follows the board's pulses."""
        return self.has_supply and not self.motor_jammed and self.circuit.motor_turns

    def estop_level(self) -> bool:
        """Return the level at the board's end of the emergency stop's wire; high is open."""
        wire = wire_of(self.circuit.estop, Signal.ESTOP, self.absent, self.inverted)
        return wire_level(wire, self.estop_pressed)

    def index_wire(self) -> Wire:
        """Return the wire between index sensor and drum board."""
        if Signal.INDEX in self.absent:
            return Wire.LOW
        return wire_of(self.circuit.index, Signal.INDEX, self.absent, self.inverted)


class LineNoise:
    """Drops bytes and flips bits at set rates, reproducibly for a seed and the same bytes."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.Generator(np.random.Philox(seed))
        self.drop_rate = 0.0
        self.corrupt_rate = 0.0

    def apply(self, data: bytes) -> bytes:
        """Return the bytes that arrive at the other end."""
        if self.drop_rate == 0.0 and self.corrupt_rate == 0.0:
            return data
        values = np.frombuffer(data, np.uint8).copy()
        hit = self._random.random(values.size) < self.corrupt_rate
        values[hit] ^= np.uint8(1) << self._random.integers(0, 8, values.size, np.uint8)[hit]
        return values[self._random.random(values.size) >= self.drop_rate].tobytes()


class SimulatedLink:
    """One board's cable. The host opens, writes and closes; the simulation delivers.

    It implements the byte link of the devices. All calls come from the event loop's thread.
    A board with a bootloader ``resets_board`` when the link is opened.
    """

    def __init__(self, name: str, seed: int = 0) -> None:
        self.name = name
        self.resets_board = False
        self.is_open = False
        self.plugged = True
        self.stalled = False
        self.noise = {TO_HOST: LineNoise(2 * seed), TO_BOARD: LineNoise(2 * seed + 1)}
        self._on_bytes: Callable[[bytes, float], None] | None = None
        self._on_lost: Callable[[str], None] | None = None
        self._board: Callable[[bytes], None] | None = None
        self._reached = self
        self._ports: Collection[SimulatedLink] = (self,)
        self._on_open: Callable[[], None] = lambda: None

    def open(
        self, on_bytes: Callable[[bytes, float], None], on_lost: Callable[[str], None]
    ) -> None:
        """Start receiving: ``on_bytes(data, at_s)`` in simulated seconds, ``on_lost(reason)`` once.

        Raises LinkLost if the cable is unplugged, or open for others.
        """
        if not self.plugged:
            raise LinkLost(f"{self.name}: no such port: plug the board in")
        if self.is_open and on_bytes != self._on_bytes:
            raise LinkLost(f"{self.name}: the port is in use: close the other program")
        if not self.is_open:
            self._on_bytes, self._on_lost, self.is_open = on_bytes, on_lost, True
            self._on_open()

    def write(self, data: bytes) -> None:
        """Send bytes to the board. Raises LinkLost if the link is not open."""
        if not self.is_open:
            raise LinkLost(f"{self.name}: the port is closed: connect the board again")
        arrived = self.noise[TO_BOARD].apply(bytes(data))
        board = self._reached._board
        if board is not None and arrived and not self.stalled:
            board(arrived)

    def close(self) -> None:
        """Stop receiving; a second call does nothing."""
        self._on_bytes = self._on_lost = None
        self.is_open = False

    def attach(self, board: Callable[[bytes], None]) -> None:
        """Board side: call ``board(data)`` for each write of the host."""
        self._board = board

    def reset_on_open(self, reset: Callable[[], None]) -> None:
        """Board side: call ``reset`` when the host opens the port, as its line DTR does."""
        self.resets_board, self._on_open = True, reset

    def deliver(self, data: bytes, at_s: float) -> None:
        """Board side: deliver bytes, the last of which arrives at ``at_s``; lost if closed."""
        for port in self._ports:
            port._receive(data, at_s)

    def reach(self, board: SimulatedLink, ports: Collection[SimulatedLink]) -> None:
        """Plug the cable into the board of a link; ``ports`` are those of our own board."""
        self._reached, self._ports = board, ports

    def _receive(self, data: bytes, at_s: float) -> None:
        if self.stalled:
            return
        arrived = self.noise[TO_HOST].apply(data)
        if self._on_bytes is not None and arrived:
            self._on_bytes(arrived, at_s)

    def unplug(self) -> None:
        """Unplug the cable: close the link and report the loss to the host."""
        on_lost = self._on_lost
        self.plugged = False
        self.close()
        if on_lost is not None:
            on_lost(f"{self.name}: the port vanished: plug the board in again")

    def replug(self) -> None:
        """Plug the cable in; the host must open the link again."""
        self.plugged = True


class FaultInjection:
    """Injects faults into virtual boards and simulated chips alike.

    The annotations bound what clients of an engine may send.
    ``board`` is ``"drum"`` or ``"taxels"``. ``on_change`` is called after the bench's disturbances
    change, ``reset`` with the name of the board whose reset button is pressed, ``stall`` with the
    seconds for which only the world goes on.
    """

    def __init__(
        self,
        links: Mapping[str, SimulatedLink],
        disturbances: Disturbances,
        on_change: Callable[[], None],
        reset: Callable[[str], None],
        stall: Callable[[float], None],
    ) -> None:
        self._links = links
        self._disturbances = disturbances
        self._on_change = on_change
        self._reset = reset
        self._stall = stall
        self._wirings: tuple[str, ...] = ()

    @property
    def wirings(self) -> tuple[str, ...]:
        """Return the names of the wrong wirings that are on, in their order."""
        return self._wirings

    def wire(self, name: WiringName, on: bool = True) -> None:
        """Switch a wrong wiring of the catalogue on or off.

        Raises WrongUse that lists the names most like an unknown one.
        """
        known = find_wiring(name).name
        others = tuple(one for one in self._wirings if one != known)
        self._wirings = (*others, known) if on else others
        self._disturbances.circuit = circuit_of(self._wirings)
        self._connect_ports(self._disturbances.circuit.ports)
        self._on_change()

    def unplug(self, board: Board) -> None:
        """Unplug a board's cable; the board itself keeps running."""
        self._links[board].unplug()

    def replug(self, board: Board) -> None:
        """Plug the cable in."""
        self._links[board].replug()

    def stall(self, board: Board, on: bool = True) -> None:
        """Silence a cable in both directions without closing the port."""
        self._links[board].stalled = on

    def drop_bytes(self, board: Board, direction: Direction, rate: Rate) -> None:
        """Drop this share of bytes; ``direction`` is ``"to_host"`` or ``"to_board"``."""
        self._links[board].noise[direction].drop_rate = rate

    def corrupt_bytes(self, board: Board, direction: Direction, rate: Rate) -> None:
        """Flip one bit in this share of bytes."""
        self._links[board].noise[direction].corrupt_rate = rate

    def reset(self, board: Board) -> None:
        """Press a board's reset button."""
        self._reset(board)

    def stall_computer(self, stall_s: StandStill) -> None:
        """Let the computer do nothing for a time, as when it sleeps, while the boards go on."""
        self._stall(stall_s)

    def press_estop(self) -> None:
        """Open the emergency-stop contact."""
        self._disturbances.estop_pressed = True
        self._on_change()

    def release_estop(self) -> None:
        """Close the emergency-stop contact."""
        self._disturbances.estop_pressed = False
        self._on_change()

    def loadcell_silent(self, on: bool = True) -> None:
        """Stop the amplifier's conversions."""
        self._set_loadcell(LoadcellFault.SILENT, on)

    def loadcell_frozen(self, on: bool = True) -> None:
        """Make the amplifier repeat its last value."""
        self._set_loadcell(LoadcellFault.FROZEN, on)

    def loadcell_saturated(self, on: bool = True) -> None:
        """Hold the amplifier at the end of its range."""
        self._set_loadcell(LoadcellFault.SATURATED, on)

    def jam_motor(self, on: bool = True) -> None:
        """Jam the drum: the motor loses steps and the surface does not move."""
        self._disturbances.motor_jammed = on
        self._on_change()

    def push(self, force_g: Push) -> None:
        """Press on the load cell with an extra force; 0 releases it."""
        self._disturbances.push_g = force_g
        self._on_change()

    def hold_ends(self, upper: bool = False, lower: bool = False) -> None:
        """Hold end switches by hand, wherever the actuator is; neither releases both."""
        self._disturbances.held_ends = upper, lower
        self._on_change()

    def touch_sensor(self, places: Places = (), unplugged: bool = False) -> None:
        """Press these places by hand; ``unplugged``: without the bottom layer's read lines."""
        self._disturbances.touch = Touch(frozenset(places), unplugged)
        self._on_change()

    def rewire(self, absent: Wires = (), inverted: Wires = ()) -> None:
        """Fit all optional wires of the drum board except ``absent``, with some inverted."""
        self._disturbances.absent = frozenset(absent)
        self._disturbances.inverted = frozenset(inverted)
        self._on_change()

    def _connect_ports(self, boards: tuple[str, str]) -> None:
        """Plug the cables of the drum's and the taxels' port into these boards."""
        reached = dict(zip((DRUM, TAXELS), boards, strict=True))
        for name, link in self._links.items():
            ports = [self._links[port] for port, board in reached.items() if board == name]
            link.reach(self._links[reached[name]], ports)

    def _set_loadcell(self, fault: LoadcellFault, on: bool) -> None:
        self._disturbances.loadcell = fault if on else LoadcellFault.NONE
        self._on_change()


class SimulatedRig(Protocol):
    """A simulated bench, two boards and their cables.

    ``time_us`` is simulated time. ``slice_us`` is the longest advance after which the host should
    run its own tasks; it is shorter while a reply is about to arrive.
    """

    time_us: int
    drum: SimulatedLink
    taxels: SimulatedLink
    faults: FaultInjection

    @property
    def truth(self) -> GroundTruth:
        """Ground truth up to the present time."""

    @property
    def test_points(self) -> TestPoints:
        """What a meter shows on the bench."""

    @property
    def slice_us(self) -> int:
        """Longest useful advance from now, microseconds, at least 1."""

    @property
    def plate(self) -> str:
        """Texture of the mounted plate, ``"A"``–``"P"``."""

    def advance(self, until_us: int) -> None:
        """Simulate bench and boards up to a time; deterministic for a seed."""

    def set_plate(self, texture: str) -> None:
        """Mount the plate of texture ``"A"``–``"P"``. Raises WrongUse for another name."""

    def skip_mountings(self, count: int) -> None:
        """Count mountings of an earlier sitting, so that the next one does not repeat the first."""

    def close(self) -> None:
        """Free the boards and close the links."""
