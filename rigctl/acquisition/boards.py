"""Both boards under one roof: connected, watched, shown, and joined again when they were lost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np

from rigctl.acquisition.drum.motion import DrumMotion
from rigctl.acquisition.drum.poller import RECONNECT_PERIOD_S, DrumPoller
from rigctl.acquisition.event_bus import EventBus
from rigctl.acquisition.health.boards import DRUM, TAXELS, BoardHealth
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.rig_interface import RigInterface
from rigctl.acquisition.taxels.pipeline import SamplePipeline
from rigctl.encoding.encoder import Encoder
from rigctl.encoding.normalisation import Normalisation, RunningRange
from rigctl.encoding.parameters import preset
from rigctl.errors import BoardRebooted, LinkLost, RigFault
from rigctl.values import Block, BoardIdentity, DrumState
from rigctl.wire.drum.codes import reset_cause_text
from rigctl.wire.drum.states import FAULT_TEXT, STATE_TEXT, Fault, State
from rigctl.wire.taxels.self_test import SelfTest

Spawn = Callable[[Coroutine[Any, Any, None]], object]

LEAST_RANGE_COUNTS = 128
"""A running range is at least so wide: well above the converter's noise, well below a touch."""


class Boards:
    """The drum with its watch and moves, the taxels with their pump, encoder and live data.

    ``on_taxels(connected)`` is told when the taxel board is lost or back, ``on_failure`` when
    samples cannot be handled any more. ``gather``: samples that the pump handles at a time.
    """

    def __init__(
        self,
        bench: RigInterface,
        live: LiveWriter,
        news: EventBus,
        may_beat: Callable[[], bool],
        on_taxels: Callable[[bool], None],
        on_failure: Callable[[RigFault], None],
        gather: int,
    ) -> None:
        self.taxels = bench.taxels
        self.taxels_connected = False
        self.identities: dict[str, BoardIdentity] = {}
        self.watch = DrumPoller(bench.drum, bench.loop, may_beat, self._drum_lost, self._drum_back)
        self.motion = DrumMotion(self.watch, bench.config)
        self.health = BoardHealth(self.watch, bench.taxels, self.identities)
        self.encoder = _encoder(bench)
        self.pump = SamplePipeline(self.encoder, live, time_stands=bench.simulated, gather=gather)
        self._bench = bench
        self._live = live
        self._news = news
        self._on_taxels = on_taxels
        self._on_failure = on_failure
        self._spawn: Spawn | None = None
        self._told = (-1, 0)
        self._told_test = (0, 0)
        self._stop_following: Callable[[], None] | None = None

    async def connect(self, spawn: Spawn) -> None:
        """Ask both boards who they are, then let samples flow and the heart beat.

        ``spawn`` has work done in the background. Raises LinkLost or WrongBoard.
        """
        taxels = self._bench.taxels
        self._spawn = spawn
        self.identities[DRUM] = await self.watch.connect()
        self.identities[TAXELS] = await taxels.connect()
        self.taxels_connected = True
        taxels.on_block(self.pump.take)
        taxels.on_fault(self._taxels_failed)
        taxels.on_self_test(self._taxels_tested)
        self.watch.watch(self._look)
        if self._bench.config.taxels.low:
            self.set_range(self.encoder.normalisation)
        else:
            self._follow_range()
        spawn(self.watch.run())
        await self._configure()
        spawn(self.health.follow())
        for identity in self.identities.values():
            self._tell(identity, "connected")
        if not self._bench.config.signals.sync:
            self._news.tell("log", "no sync wire is fitted: the drum's clock cuts the trials")
        if taxels.self_test is not None:
            self._taxels_tested(taxels.self_test)

    def close(self) -> None:
        """Let go of both ports."""
        self._bench.drum.close()
        self._bench.taxels.close()

    def set_range(self, normalisation: Normalisation) -> None:
        """Encode with these ranges from the next sample on."""
        self.encoder.normalisation = normalisation
        self._live.set_range(normalisation.low, normalisation.high)

    async def calibrate_range(self, seconds: float) -> Normalisation:
        """Watch the taxels for so long, then take what was seen as their range."""
        seen = RunningRange(self._bench.config.taxels.count)
        unwatch = self.pump.watch(lambda block: _widen(seen, block))
        try:
            await asyncio.sleep(seconds)
        finally:
            unwatch()
        if self._stop_following is not None:
            self._stop_following()
            self._stop_following = None
        self.set_range(seen.normalisation)
        return seen.normalisation

    def _follow_range(self) -> None:
        """Without a calibration the range is what was seen so far.

        The encoder counts readings outside its range anyway: only when it did can it widen.
        """
        running = RunningRange(self._bench.config.taxels.count, LEAST_RANGE_COUNTS)
        clipped = -1

        def widen(block: Block) -> None:
            nonlocal clipped
            before, clipped = clipped, int(self.encoder.clipped_counts.sum())
            if clipped != before and running.update(block.samples):
                self.set_range(running.normalisation)

        self._stop_following = self.pump.watch(widen)
        self._news.tell("log", "no taxel calibration: the encoder uses the range seen so far")

    def _look(self, state: DrumState) -> None:
        """Every poll: show it, and say what changed."""
        self._show(state)
        before, self._told = self._told, (state.state, state.fault)
        if state.fault and state.fault != before[1]:
            self._news.tell("fault", FAULT_TEXT[Fault(state.fault)], fault=state.fault)
        if state.state != before[0]:
            self._news.tell("state", STATE_TEXT[State(state.state)], state=state.state)

    def _show(self, state: DrumState) -> None:
        late_s = state.at_s - state.board_time_us / 1e6
        settings = self.motion.settings
        self._live.add_drum(
            np.array([sample.board_time_us / 1e6 + late_s for sample in state.loadcell]),
            np.array([sample.force_g for sample in state.loadcell]),
            settings.get("force_set", 0.0),
            state.speed_mm_s,
            settings.get("speed_set", 0.0),
            state.state,
        )

    def _drum_lost(self, reason: str) -> None:
        self._news.tell("link", reason, board=DRUM)

    def _drum_back(self, identity: BoardIdentity, rebooted: bool) -> None:
        self.identities[DRUM] = identity
        self.motion.forget()  # whoever was on the line meanwhile may have set anything
        self._tell(identity, "rebooted and is back" if rebooted else "is back")
        assert self._spawn is not None
        self._spawn(self._configure_again())

    async def _configure(self) -> None:
        if left := await self.motion.configure():
            self._news.tell("check", left)

    async def _configure_again(self) -> None:
        try:
            await self._configure()
        except RigFault as fault:
            self._news.tell("link", str(fault), board=DRUM)

    def _taxels_tested(self, test: SelfTest) -> None:
        """Say what a self-test found, once: the board repeats it whenever it introduces itself."""
        told = (self.identities[TAXELS].boot_count, test.count)
        if told == self._told_test:
            return
        self._told_test = told
        found = self.taxels.findings
        text = "; ".join(found) if found else "nothing found"
        self._news.tell("check" if found else "board", f"taxels' self-test: {text}", found=found)

    def _taxels_failed(self, fault: RigFault) -> None:
        if isinstance(fault, BoardRebooted):
            self._news.tell("link", str(fault), board=TAXELS)
        elif not isinstance(fault, LinkLost):
            self._news.tell("fault", str(fault))
            self._on_failure(fault)
        elif self.taxels_connected:
            self.taxels_connected = False
            self._news.tell("link", str(fault), board=TAXELS)
            self._on_taxels(False)
            assert self._spawn is not None
            self._spawn(self._reconnect_taxels())

    async def _reconnect_taxels(self) -> None:
        before = self.identities[TAXELS].boot_count
        while not self.taxels_connected:
            await asyncio.sleep(RECONNECT_PERIOD_S)
            try:
                self.identities[TAXELS] = await self._bench.taxels.connect()
            except RigFault:
                continue
            self.taxels_connected = True
        rebooted = self.identities[TAXELS].boot_count != before
        self._tell(self.identities[TAXELS], "rebooted and is back" if rebooted else "is back")
        self._on_taxels(True)

    def _tell(self, board: BoardIdentity, what: str) -> None:
        self._news.tell(
            "board",
            f"{board.board} {what}: firmware {board.firmware_version}, build {board.build_hash}, "
            f"boot {board.boot_count} by {reset_cause_text(board.reset_cause)}",
            board=board.board,
            boot_count=board.boot_count,
        )


def _encoder(bench: RigInterface) -> Encoder:
    """The live encoder, compiled before anything moves."""
    taxels = bench.config.taxels
    if taxels.low:
        low, high = np.array(taxels.low, np.uint16), np.array(taxels.high, np.uint16)
        normalisation = Normalisation(low, high)
    else:
        normalisation = Normalisation.full_scale(taxels.count)
    encoder = Encoder(normalisation, preset(bench.config.encoder.preset))
    encoder.warm_up()
    return encoder


def _widen(seen: RunningRange, block: Block) -> None:
    seen.update(block.samples)
