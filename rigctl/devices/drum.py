"""The driver of the drum board: poll, set, command, stop.

One poll is one exchange: it writes the heartbeat and reads the whole state. All other requests
queue for the line, except :meth:`Drum.stop`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

from rigctl.devices.boot_silence import BootSilence
from rigctl.devices.drum_refusals import (
    amplifier_text,
    command_refusal_text,
    settings_refusal_text,
)
from rigctl.devices.identity import (
    CONNECT_TIMEOUT_S,
    WHICH_PORT,
    PortDiagnosis,
    drum_identity,
    no_answer,
    raise_diagnosis,
)
from rigctl.devices.links.byte_link import ByteLink
from rigctl.devices.modbus_client import DRAIN_S, LINK_TIMEOUT_S, ModbusClient, RequestRefused
from rigctl.errors import BoardRebooted, CommandRefused, LinkLost, WrongBoard
from rigctl.values import BoardIdentity, DrumState
from rigctl.wire.drum import register_table
from rigctl.wire.drum.codes import Command, CommandResult
from rigctl.wire.drum.poll import PollDecoder, RawPoll, RingSample
from rigctl.wire.drum.registers import BlockLayout, RegisterWrite, plan_reads, plan_writes
from rigctl.wire.drum.states import Fault, State
from rigctl.wire.drum.tare_table import PLACE_NAMES, tare_table

CLOCK_TOLERANCE_US, CLOCK_TOLERANCE_SHARE = 1_000_000, 0.01
"""The board rebooted where its clock deviates from the loop's by more than the sum of both."""
RING_PART = 16
"""Load-cell samples of one read: 32 registers, a part of the ring without its wrap."""

_IDENTITY = BlockLayout(*register_table.IDENTITY_BLOCK, entries=register_table.IDENTITY)
_SETTINGS = BlockLayout(*register_table.SETTINGS_BLOCK, entries=register_table.SETTINGS)
_HEARTBEAT = register_table.BY_NAME["heartbeat"].address
_HEARTBEAT_SEEN = register_table.BY_NAME["heartbeat_seen"].address - register_table.POLL_BLOCK[0]
_COMMAND = register_table.BY_NAME["command"].address


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
        for layout in plan_reads(names):
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
                return _IDENTITY.unpack(await self.modbus.read(*register_table.IDENTITY_BLOCK))
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
        raw = _SETTINGS.unpack(await self.modbus.read(*register_table.SETTINGS_BLOCK))
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
                words = await self.modbus.read(*register_table.POLL_BLOCK)
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
                *register_table.POLL_BLOCK, _HEARTBEAT, (self._heartbeat,), retry_early=True
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
        ring = register_table.BY_NAME[name]
        address = ring.address + ring.words * (sequences[0] % register_table.RING_DEPTH)
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
