"""The drum board as a scientist names it: poll, set, command, stop.

One poll is one exchange: it beats the heart and reads the whole state. Everything else on the
line waits its turn, except :meth:`Drum.stop`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rigctl.devices.drum_refusals import refused_command, refused_settings
from rigctl.devices.identity import WhosThere, drum_identity, explain
from rigctl.devices.links.byte_link import BoardRebooted, ByteLink
from rigctl.devices.loadcell_ring import read_ring
from rigctl.devices.modbus_client import DRAIN_S, SILENCE_S, ModbusClient, Refused
from rigctl.errors import BoardFault, CommandRefused, LinkLost, RigFault, WrongBoard
from rigctl.values import BoardIdentity, DrumState
from rigctl.wire.drum import register_table
from rigctl.wire.drum.codes import Command, CommandResult
from rigctl.wire.drum.poll import PollDecoder, Raw
from rigctl.wire.drum.registers import BlockLayout, Write, plan_writes, reads_for
from rigctl.wire.drum.states import FAULT_TEXT, Fault, State
from rigctl.wire.drum.tare_table import PLACE_NAMES, place_table

ANSWER_S = 4.0
"""A board that was reset by opening its port answers within this time, bootloader included."""
BOARD_TIME_JUMP_US, BOARD_TIME_SHARE = 1_000_000, 0.01
"""A board clock that runs further away from ours, in sum, has started anew."""
WAIT_POLL_S = 0.02

_IDENTITY = BlockLayout(*register_table.IDENTITY_BLOCK, entries=register_table.IDENTITY)
_SETTINGS = BlockLayout(*register_table.SETTINGS_BLOCK, entries=register_table.SETTINGS)
_HEARTBEAT = register_table.BY_NAME["heartbeat"].address
_COMMAND = register_table.BY_NAME["command"].address

OnState = Callable[[DrumState], None]


class Drum:
    """The drum board over one link. Every coroutine raises LinkLost when the board falls silent.

    ``identity`` is that of the last connect, ``rebooted`` whether the board started anew between
    the last two, ``settings`` what was last read back, by name in engineering units.
    """

    identity: BoardIdentity

    def __init__(
        self,
        link: ByteLink,
        loop: asyncio.AbstractEventLoop,
        whos_there: WhosThere | None = None,
    ) -> None:
        self.link = link
        self.line = ModbusClient(link, loop)
        self.rebooted = False
        self.settings: dict[str, float] = {}
        self._loop = loop
        self._whos_there = whos_there
        self._decoder = PollDecoder()
        self._connected = False
        # States are decoded in the order in which they were read.
        self._polling = asyncio.Lock()
        self._boot_count: int | None = None
        self._beat = 0
        self._sequence = 0
        self._tare_sequence: int | None = None
        self._consumers: list[OnState] = []

    @property
    def connected(self) -> bool:
        """True from a successful connect until the link is closed or lost."""
        return self._connected and self.link.is_open

    @property
    def retries(self) -> int:
        """Polls that were asked again because request or reply was lost or damaged."""
        return self.line.retries

    @property
    def state(self) -> DrumState | None:
        """The newest state polled since the last connect."""
        return self._decoder.last

    def on_state(self, consumer: OnState) -> None:
        """Have ``consumer`` called with every state polled, whoever polls."""
        self._consumers.append(consumer)

    async def connect(self) -> BoardIdentity:
        """Open the link, ask who is there, read the settings.

        Raises LinkLost where nobody answers in time, WrongBoard where somebody else does.
        """
        self._connected = False
        await self.line.open()
        try:
            identity = drum_identity(self.link.name, await self._first_answer())
            await self._take_settings(identity.details["steps_per_turn"])
        except BaseException as failure:
            self.line.close()
            await explain(failure, self._whos_there if self._boot_count is None else None)
            raise
        self._connected = True
        self.rebooted = self._boot_count not in (None, identity.boot_count)
        self._boot_count = identity.boot_count
        self.identity = identity
        return identity

    async def poll(self, beat: bool = True) -> DrumState:
        """One exchange: beat the heart if asked to, read the state and new load-cell samples.

        Raises BoardRebooted where the board's clock shows that it started anew.
        """
        async with self._polling:
            words = await (
                self._poll_beating() if beat else self.line.read(*register_table.POLL_BLOCK)
            )
            raw, at_s = self._decoder.read(words), self.line.received_at_s
            self._check_clock(raw, at_s)
            ring = await read_ring(self.line, self._decoder.missing(raw))
            await self._after_tare(raw)
            state = self._decoder.decode(raw, at_s, ring)
        for consumer in self._consumers:
            consumer(state)
        return state

    async def set(self, **values: float) -> dict[str, float]:
        """Write settings by name in engineering units; the values really set, read back.

        Raises WrongUse before anything is sent where a value is out of bounds, CommandRefused
        where the board says no.
        """
        done: dict[str, float] = {}
        for write in plan_writes(values):
            done |= await self._set(write)
        self._remember(done)
        return done

    async def get(self, *names: str) -> dict[str, float]:
        """Registers by name in engineering units."""
        values: dict[str, float] = {}
        for layout in reads_for(names):
            values |= layout.values(await self.line.read(layout.address, layout.count))
        self._remember(values)
        return values

    async def command(self, command: Command, wait: bool = False) -> None:
        """Give a command; with ``wait`` poll, beating, until the board has done it.

        Raises CommandRefused where the state does not allow it, BoardFault where the board
        latched a fault on the way.
        """
        sequence = self._next_sequence()
        if command in (Command.TARE, Command.TARE_TURN, Command.TARE_ANYWAY):
            self._tare_sequence = sequence
        try:
            await self.line.write(_COMMAND, (command, sequence), once=True)
        except Refused as refused:
            raise await self._refusal(command, refused) from refused
        while wait and not self._is_done(command, sequence, await self.poll()):
            await asyncio.sleep(WAIT_POLL_S)

    async def stop(self) -> None:
        """Stop and lift at once; the reply in flight is abandoned, nothing else goes first."""
        await self.line.urgent_write(_COMMAND, (Command.STOP, self._next_sequence()))

    def close(self) -> None:
        """Free the port. The board lifts by itself when the beat stays away."""
        self.line.close()

    async def _first_answer(self) -> dict[str, tuple[int, ...]]:
        """The identity block, asked for until somebody answers or the time is over."""
        deadline_s = self._loop.time() + ANSWER_S
        while True:
            try:
                return _IDENTITY.raw(await self.line.read(*register_table.IDENTITY_BLOCK))
            except Refused as refused:
                raise WrongBoard(
                    f"{self.link.name}: a Modbus device answered that is no rigctl board: "
                    "rigctl ports shows what hangs where"
                ) from refused
            except LinkLost:
                if not self.link.is_open:
                    raise
                if self._loop.time() > deadline_s:
                    raise self._nobody() from None

    def _nobody(self) -> RigFault:
        name, seconds = self.link.name, f"within {ANSWER_S:g} s"
        if self.line.bytes_received:
            return WrongBoard(
                f"{name}: bytes came, but no drum board answered {seconds}: "
                "another board or baud rate? rigctl ports shows what hangs where"
            )
        return LinkLost(
            f"{name}: no drum board answered {seconds}: check cable and supply; "
            "rigctl ports shows what hangs where"
        )

    async def _take_settings(self, steps_per_turn: int) -> None:
        raw = _SETTINGS.raw(await self.line.read(*register_table.SETTINGS_BLOCK))
        self._sequence = raw["command_sequence"][0]
        self._beat = raw["heartbeat"][0]
        self._tare_sequence = None
        self._decoder = PollDecoder()
        self._remember({e.name: raw[e.name][0] * e.scale for e in _SETTINGS.entries})
        self._decoder.steps_per_turn = steps_per_turn

    async def _poll_beating(self) -> list[int]:
        """A poll whose reply shows the beat it was sent with; others are older replies."""
        self._beat = (self._beat + 1) % 65536
        give_up_s = self._loop.time() + SILENCE_S
        while True:
            words = await self.line.read_write(
                *register_table.POLL_BLOCK, _HEARTBEAT, (self._beat,), hurried=True
            )
            if words[_SEEN] == self._beat:
                return words
            if self._loop.time() > give_up_s:
                raise LinkLost(f"{self.link.name}: the drum board does not see the heartbeat")
            self.line.stale += 1
            await asyncio.sleep(DRAIN_S)

    def _check_clock(self, raw: Raw, at_s: float) -> None:
        """Raise where the board's clock did not run with ours since the last poll."""
        last = self._decoder.last
        if last is None:
            return
        wire_us = raw["board_time_us"][0]
        expected_us = (at_s - last.at_s) * 1e6
        # Nearest way round the 32-bit clock between what it shows and what it should show.
        early_us = (wire_us - last.board_time_us - expected_us + 2**31) % 2**32 - 2**31
        if abs(early_us) > BOARD_TIME_JUMP_US + BOARD_TIME_SHARE * expected_us:
            self._connected = False
            raise BoardRebooted(f"{self.link.name}: the drum board restarted by itself: connect it")

    async def _set(self, write: Write) -> dict[str, float]:
        layout = BlockLayout(write.address, len(write.words))
        try:
            words = await self.line.read_write(
                write.address, len(write.words), write.address, write.words
            )
        except Refused as refused:
            why = refused_settings(write.names, refused.code)
            raise CommandRefused(f"{refused}: {why}") from refused
        return layout.values(words)

    def _remember(self, values: dict[str, float]) -> None:
        self.settings |= values
        self._decoder.tare_counts = round(self.settings.get("tare_counts", 0))
        self._decoder.scale_ug_per_count = round(self.settings.get("scale_ug_per_count", 0))
        self._decoder.tare_table = place_table(self.settings)

    async def _after_tare(self, raw: Raw) -> None:
        """A tare that is done changed what raw counts mean: read it."""
        done = raw["command_result"][0] != CommandResult.RUNNING
        if done and raw["command_acknowledged"][0] == self._tare_sequence:
            self._tare_sequence = None
            await self.get("tare_counts", "scale_ug_per_count", *PLACE_NAMES)

    def _next_sequence(self) -> int:
        self._sequence = (self._sequence + 1) % 65536
        return self._sequence

    async def _refusal(self, command: Command, refused: Refused) -> CommandRefused:
        values = await self.get("state", "fault", "status_bits")
        state, fault = State(int(values["state"])), Fault(int(values["fault"]))
        why = refused_command(command, state, fault, int(values["status_bits"]))
        return CommandRefused(f"{self.link.name}: {why}")

    def _is_done(self, command: Command, sequence: int, state: DrumState) -> bool:
        if state.fault:
            raise BoardFault(
                f"{self.link.name}: {command.name} ended in a fault: "
                f"{FAULT_TEXT[Fault(state.fault)]}"
            )
        if _acknowledged(state) != sequence:
            raise CommandRefused(f"{self.link.name}: {command.name} was overtaken by another")
        if _result(state) is CommandResult.FAILED:
            raise CommandRefused(f"{self.link.name}: {command.name} was broken off")
        return _result(state) is CommandResult.DONE


_SEEN = register_table.BY_NAME["heartbeat_seen"].address - register_table.POLL_BLOCK[0]


def _acknowledged(state: DrumState) -> int:
    return int(state.values["command_acknowledged"])


def _result(state: DrumState) -> CommandResult:
    return CommandResult(int(state.values["command_result"]))
