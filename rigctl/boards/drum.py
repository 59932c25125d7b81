"""The driver of the drum board: poll, set, command, stop.

One poll is one exchange: it writes the heartbeat and reads the whole state. All other requests
queue for the line, except :meth:`Drum.stop`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from itertools import groupby

from rigctl.boards import drum_registers
from rigctl.boards.boot_silence import BootSilence
from rigctl.boards.drum_codes import Command, CommandResult, Guard, Status
from rigctl.boards.drum_poll import PLACE_NAMES, PollDecoder, RawPoll, RingSample, tare_table
from rigctl.boards.drum_registers import (
    BY_NAME,
    BlockLayout,
    RegisterWrite,
    plan_reads,
    plan_writes,
)
from rigctl.boards.drum_states import FAULT_TEXT, Fault, State, StateEvent, next_state
from rigctl.boards.identity import (
    CONNECT_TIMEOUT_S,
    WHICH_PORT,
    PortDiagnosis,
    drum_identity,
    no_answer,
    raise_diagnosis,
)
from rigctl.boards.links import ByteLink
from rigctl.boards.modbus_client import DRAIN_S, LINK_TIMEOUT_S, ModbusClient, RequestRefused
from rigctl.errors import BoardRebooted, CommandRefused, LinkLost, WrongBoard
from rigctl.values import BoardIdentity, DrumState

_planned_reads = cache(plan_reads)
"""Kept, as the same registers are read again and again."""

REFUSED_IN_STATE = 4
"""Modbus exception of a command or a change that the present state refuses."""

_WIRING = frozenset({"optional_signals", "signal_polarity"})
_NEEDS_LIFT = frozenset(
    {
        Command.TARE,
        Command.TARE_TURN,
        Command.APPROACH,
        Command.APPROACH_SETUP,
        Command.DEFAULTS,
    }
)
_APPROACHES = (Command.APPROACH, Command.APPROACH_SETUP)
_RESTING = (State.IDLE, State.ARMED)
_EVENTS = {
    Command.ARM: StateEvent.ARM,
    Command.DISARM: StateEvent.DISARM,
    Command.MOVE: StateEvent.MOVE,
    Command.HOME: StateEvent.MOVE,
    Command.TARE_TURN: StateEvent.MOVE,
    Command.APPROACH: StateEvent.APPROACH,
    Command.APPROACH_SETUP: StateEvent.APPROACH,
    Command.NUDGE: StateEvent.NUDGE,
    Command.RUN: StateEvent.RUN,
    Command.RETRACT: StateEvent.RETRACT,
    Command.CLEAR: StateEvent.CLEAR,
}
"""The event of the state machine that a command stands for."""


def command_refusal_text(command: Command, state: State, fault: Fault, status_bits: int) -> str:
    """Return which command was refused in which state and, where the status shows it, why."""
    reason = _reason(command, state, fault, status_bits)
    return f"the drum refused {command.name} in state {state.name}" + (reason and f" ({reason})")


def amplifier_text(fault_bits: int, rate_hz: float) -> str:
    """Return why the load cell forbids to arm, with its measured rate, empty where it does not."""
    text = ""
    if fault_bits >> Fault.LOADCELL_RATE & 1:
        text += f": {rate_hz:.3g} samples a second: {FAULT_TEXT[Fault.LOADCELL_RATE]}"
    if fault_bits >> Fault.LOADCELL_NOISE & 1:
        text += f": {FAULT_TEXT[Fault.LOADCELL_NOISE]}"
    return text


def _reason(command: Command, state: State, fault: Fault, status_bits: int) -> str:
    if fault is not Fault.NONE:
        return FAULT_TEXT[fault] + _restart_text(command, fault, status_bits)
    if state in _RESTING and (reason := _resting_reason(command, state, status_bits)):
        return reason
    if command is Command.RUN and state is State.HOLD:
        return "the run-in is too short for this speed: lower the speed or lengthen the run-in"
    return _state_reason(command, state)


def _restart_text(command: Command, fault: Fault, status_bits: int) -> str:
    """Return what clears the fault of a drum that pressed in the setup and could not lift."""
    is_commissioned = status_bits >> Status.COMMISSIONED & 1
    may_press = status_bits >> Status.CONTACT_MAY_STAND & 1
    if command is not Command.CLEAR or fault is Fault.ESTOP or is_commissioned or not may_press:
        return ""
    return "; the drum did not lift: mend that, turn it up by hand, then restart the drum board"


def _resting_reason(command: Command, state: State, status_bits: int) -> str:
    """Return why a command was refused though the drum stands still, lifted or switched off."""
    if command in _NEEDS_LIFT and status_bits >> Status.CONTACT_MAY_STAND & 1:
        return "it may rest on something: arm it or retract, so that it lifts"
    if command in _APPROACHES and state is State.ARMED:
        if command is Command.APPROACH and not status_bits >> Status.COMMISSIONED & 1:
            return "it is not commissioned for these settings: run rigctl setup"
        if not status_bits >> Status.CELL_TRUSTED & 1:
            return (
                "its load cell has felt nothing since it was switched on or tared for another "
                "drum: disarm, press on the load cell with a finger for a second, and let it go"
            )
        tared = status_bits >> Status.TARED & 1
        return "the force is too near a limit" if tared else "the load cell is not tared: tare it"
    if command is Command.TARE:
        return (
            "the reading is far from the last zero: check what weighs on the drum; "
            "for another drum use rigctl calibrate tare --anyway"
        )
    return ""


def _state_reason(command: Command, state: State) -> str:
    """Return in which states a command is possible, where this is none of them."""
    if command in _EVENTS:
        possible = [s for s in State if next_state(s, _EVENTS[command]) is not None]
    elif command in (Command.TARE, Command.TARE_ANYWAY, Command.SAVE, Command.COMMISSION):
        possible = list(_RESTING)
    else:
        return ""
    if state in possible:
        return ""
    where = f"it is possible in {' or '.join(s.name for s in possible)} only"
    return f"{where}: arm the drum first" if possible == [State.ARMED] else where


def settings_refusal_text(names: Iterable[str], code: int) -> str:
    """Return which settings were not set and, where the state refuses them, when they can be."""
    refused = tuple(names)
    text = f"{', '.join(refused)} not set"
    guarded = any(BY_NAME[name].guard is not Guard.NONE for name in refused)
    if code != REFUSED_IN_STATE or not guarded:
        return text
    text += ": lift the drum to ARMED or IDLE and release the emergency stop first"
    if _WIRING.isdisjoint(refused):
        return text
    return f"{text}; one that closes when it is pressed, press instead (arduino/drum/board.h)"


CLOCK_TOLERANCE_US, CLOCK_TOLERANCE_SHARE = 1_000_000, 0.01
"""The board rebooted where its clock deviates from the loop's by more than the sum of both."""
RING_PART = 16
"""Load-cell samples of one read: 32 registers, a part of the ring without its wrap."""

_IDENTITY = BlockLayout(*drum_registers.IDENTITY_BLOCK, entries=drum_registers.IDENTITY)
_SETTINGS = BlockLayout(*drum_registers.SETTINGS_BLOCK, entries=drum_registers.SETTINGS)
_HEARTBEAT = drum_registers.BY_NAME["heartbeat"].address
_HEARTBEAT_SEEN = drum_registers.BY_NAME["heartbeat_seen"].address - drum_registers.POLL_BLOCK[0]
_COMMAND = drum_registers.BY_NAME["command"].address


class Drum:
    """The drum board over one link. Every coroutine raises LinkLost when the board falls silent.

    ``identity`` is that of the last connect, ``rebooted`` whether the board rebooted between the
    last two, ``settings`` the values last read, by name in engineering units.
    """

    identity: BoardIdentity

    def __init__(
        self,
        link: ByteLink,
        loop: asyncio.AbstractEventLoop,
        diagnose_port: PortDiagnosis | None = None,
    ) -> None:
        self.link = link
        self.modbus = ModbusClient(link, loop)
        self.rebooted = False
        self.settings: dict[str, float] = {}
        self._loop = loop
        self._diagnose_port = diagnose_port
        self._decoder = PollDecoder()
        self._connected = False
        # States are decoded in the order in which they were read.
        self._poll_lock = asyncio.Lock()
        self._boot_count: int | None = None
        self._heartbeat = 0
        self._sequence = 0
        self._tare_sequence: int | None = None

    @property
    def connected(self) -> bool:
        """True from a successful connect until the link is closed or lost."""
        return self._connected and self.link.is_open

    @property
    def state(self) -> DrumState | None:
        """The newest state polled since the last connect."""
        return self._decoder.last

    async def connect(self) -> BoardIdentity:
        """Open the link, read identity and settings, and return the identity.

        A port stays open where the board does not answer, if opening it again would reset the
        board. Raises LinkLost where no board answers in time, WrongBoard where another does.
        """
        self._connected = False
        self.modbus.open()
        await self.silence.wait()
        try:
            identity = drum_identity(self.link.name, await self._read_identity())
            await self._read_settings(identity.details["steps_per_turn"])
        except BaseException as failure:
            if self._boot_count is None:
                await raise_diagnosis(failure, self.link, self._diagnose_port)
            self.silence.close_link()
            raise
        self._connected = True
        self.rebooted = self._boot_count not in (None, identity.boot_count)
        self._boot_count = identity.boot_count
        self.identity = identity
        return identity

    @property
    def silence(self) -> BootSilence:
        """When the board may be asked."""
        return self.modbus.silence

    async def poll(self, heartbeat: bool = True) -> DrumState:
        """Return the state with the new load-cell samples; ``heartbeat`` writes one.

        Raises BoardRebooted where the board's clock shows a reboot.
        """
        async with self._poll_lock:
            raw, at_s = await self._read_poll(heartbeat)
            ring = await self._read_ring(self._decoder.missing(raw), heartbeat)
            await self._read_new_tare(raw)
            return self._decoder.decode(raw, at_s, ring)

    async def set(self, **values: float) -> dict[str, float]:
        """Write settings in engineering units and return the values read back, by name.

        Raises WrongUse before anything is sent where a value is out of bounds, CommandRefused
        where the board refuses.
        """
        written: dict[str, float] = {}
        for write in plan_writes(values):
            written |= await self._write_settings(write)
        self._update_settings(written)
        return written

    async def get(self, *names: str) -> dict[str, float]:
        """Read registers and return their values in engineering units, by name."""
        values: dict[str, float] = {}
        for layout in _planned_reads(names):
            values |= layout.values(await self.modbus.read(layout.address, layout.count))
        self._update_settings(values)
        return values

    async def command(self, command: Command) -> None:
        """Send a command. Raises CommandRefused where the state does not allow it."""
        sequence = self._next_sequence()
        if command in (Command.TARE, Command.TARE_TURN, Command.TARE_ANYWAY):
            self._tare_sequence = sequence
        try:
            await self.modbus.write(_COMMAND, (command, sequence), resume_after_stop=False)
        except RequestRefused as refused:
            raise await self._refusal(command) from refused

    async def stop(self) -> None:
        """Stop and lift immediately: abandon the reply in flight, preempt all other requests."""
        await self.modbus.urgent_write(_COMMAND, (Command.STOP, self._next_sequence()))

    def close(self) -> None:
        """Free the port; without a heartbeat the board lifts."""
        self.modbus.close()

    async def _read_identity(self) -> dict[str, tuple[int, ...]]:
        """Repeat the read of the identity block until a board answers or time is up."""
        deadline_s = self.silence.ask_until_s(CONNECT_TIMEOUT_S)
        while True:
            try:
                return _IDENTITY.unpack(await self.modbus.read(*drum_registers.IDENTITY_BLOCK))
            except RequestRefused as refused:
                raise WrongBoard(
                    f"{self.link.name}: the Modbus device there is not a rigctl board: {WHICH_PORT}"
                ) from refused
            except LinkLost:
                if not self.link.is_open:
                    raise
                if self._loop.time() > deadline_s:
                    raise no_answer(
                        self.silence, self.link, "drum", self.modbus.bytes_received > 0
                    ) from None

    async def _read_settings(self, steps_per_turn: int) -> None:
        raw = _SETTINGS.unpack(await self.modbus.read(*drum_registers.SETTINGS_BLOCK))
        self._sequence = raw["command_sequence"][0]
        self._heartbeat = raw["heartbeat"][0]
        self._tare_sequence = None
        self._decoder = PollDecoder(steps_per_turn=steps_per_turn)
        self._update_settings({e.name: raw[e.name][0] * e.scale for e in _SETTINGS.entries})

    async def _read_poll(self, heartbeat: bool) -> tuple[RawPoll, float]:
        """Return a poll block that is not behind the last one, and when it arrived."""
        deadline_s = self._loop.time() + LINK_TIMEOUT_S
        while True:
            if heartbeat:
                words = await self._poll_with_heartbeat()
            else:
                words = await self.modbus.read(*drum_registers.POLL_BLOCK)
            raw, at_s = PollDecoder.layout.unpack(words), self.modbus.received_at_s
            self._check_clock(raw, at_s)
            if not self._decoder.is_behind(raw):
                return raw, at_s
            if self._loop.time() > deadline_s:
                raise LinkLost(
                    f"{self.link.name}: the drum board's clock runs back: check its supply"
                )
            self.modbus.stale += 1
            await asyncio.sleep(DRAIN_S)

    async def _poll_with_heartbeat(self) -> list[int]:
        """Return a poll block that shows the heartbeat just written; others are stale."""
        self._heartbeat = (self._heartbeat + 1) % 65536
        deadline_s = self._loop.time() + LINK_TIMEOUT_S
        while True:
            words = await self.modbus.read_write(
                *drum_registers.POLL_BLOCK, _HEARTBEAT, (self._heartbeat,), retry_early=True
            )
            if words[_HEARTBEAT_SEEN] == self._heartbeat:
                return words
            if self._loop.time() > deadline_s:
                raise LinkLost(f"{self.link.name}: the drum board does not see the heartbeat")
            self.modbus.stale += 1
            await asyncio.sleep(DRAIN_S)

    async def _read_ring(self, sequences: range, heartbeat: bool) -> dict[int, RingSample]:
        """Return samples of the board's ring by sequence number.

        A newer sample may have overwritten one meanwhile; its time shows it. With ``heartbeat``
        each request writes one: on a noisy line the reads may take longer than the board waits.
        """
        samples: dict[int, RingSample] = {}
        for _, part in groupby(sequences, lambda sequence: sequence // RING_PART):
            numbers = tuple(part)
            raw = await self._read_ring_part("ring_raw", numbers, heartbeat)
            times_us = await self._read_ring_part("ring_time_us", numbers, heartbeat)
            samples |= zip(numbers, zip(raw, times_us, strict=True), strict=True)
        return samples

    async def _read_ring_part(
        self, name: str, sequences: Sequence[int], heartbeat: bool
    ) -> tuple[int, ...]:
        ring = drum_registers.BY_NAME[name]
        address = ring.address + ring.words * (sequences[0] % drum_registers.RING_DEPTH)
        part = replace(ring, address=address, count=len(sequences))
        layout = BlockLayout(address, part.end - address, [part])
        block = layout.address, layout.count
        if not heartbeat:
            return layout.unpack(await self.modbus.read(*block))[name]
        self._heartbeat = (self._heartbeat + 1) % 65536
        words = await self.modbus.read_write(*block, _HEARTBEAT, (self._heartbeat,))
        return layout.unpack(words)[name]

    def _check_clock(self, raw: RawPoll, at_s: float) -> None:
        """Raise BoardRebooted where the board's clock deviates from the loop's since last poll."""
        last = self._decoder.last
        if last is None:
            return
        expected_us = (at_s - last.at_s) * 1e6
        # The difference is wrapped to half a turn of the 32-bit clock either way.
        ahead_us = raw["board_time_us"][0] - last.board_time_us - expected_us
        ahead_us = (ahead_us + 2**31) % 2**32 - 2**31
        if abs(ahead_us) > CLOCK_TOLERANCE_US + CLOCK_TOLERANCE_SHARE * expected_us:
            self._connected = False
            raise BoardRebooted(f"{self.link.name}: the drum board restarted: connect it again")

    async def _write_settings(self, write: RegisterWrite) -> dict[str, float]:
        count = len(write.words)
        try:
            words = await self.modbus.read_write(write.address, count, write.address, write.words)
        except RequestRefused as refused:
            reason = settings_refusal_text(write.names, refused.code)
            raise CommandRefused(f"{refused}: {reason}") from refused
        return BlockLayout(write.address, count).values(words)

    def _update_settings(self, values: dict[str, float]) -> None:
        self.settings |= values
        self._decoder.tare_counts = round(self.settings.get("tare_counts", 0))
        self._decoder.scale_ug_per_count = round(self.settings.get("scale_ug_per_count", 0))
        self._decoder.tare_table = tare_table(self.settings)

    async def _read_new_tare(self, raw: RawPoll) -> None:
        """Read the tare after a tare command has ended: it changes what raw counts mean."""
        ended = raw["command_result"][0] != CommandResult.RUNNING
        if ended and raw["command_acknowledged"][0] == self._tare_sequence:
            self._tare_sequence = None
            await self.get("tare_counts", "scale_ug_per_count", *PLACE_NAMES)

    def _next_sequence(self) -> int:
        self._sequence = (self._sequence + 1) % 65536
        return self._sequence

    async def _refusal(self, command: Command) -> CommandRefused:
        values = await self.get("state", "fault", "status_bits", "fault_bits", "loadcell_rate")
        state, fault = State(int(values["state"])), Fault(int(values["fault"]))
        reason = command_refusal_text(command, state, fault, int(values["status_bits"]))
        if command in (Command.ARM, Command.NUDGE) and state is State.IDLE:
            reason += amplifier_text(int(values["fault_bits"]), values["loadcell_rate"])
        return CommandRefused(f"{self.link.name}: {reason}")
