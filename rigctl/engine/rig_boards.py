"""Both boards of a rig: connection, polls, live data, and reconnection after a loss."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from rigctl.boards.drum_codes import reset_cause_text
from rigctl.boards.drum_states import FAULT_TEXT, STATE_TEXT, Fault, State
from rigctl.boards.links import ByteLink
from rigctl.boards.taxel_frames import SelfTest
from rigctl.config.rig_config import ADC_MAX, TaxelArray
from rigctl.encoder.encoder import Encoder
from rigctl.encoder.force_gain import ForceScaling
from rigctl.encoder.normalisation import Normalisation, RunningRange
from rigctl.encoder.parameters import preset
from rigctl.encoder.reading import Reading, input_of_each
from rigctl.engine.contact import contact_sentence, is_left_in_contact
from rigctl.engine.event_bus import EventBus
from rigctl.engine.health import DRUM, TAXELS, BoardHealth
from rigctl.engine.live_file import LiveWriter
from rigctl.engine.motion import DrumMotion
from rigctl.engine.pipeline import Batching, SamplePipeline
from rigctl.engine.poller import RECONNECT_PERIOD_S, DrumPoller
from rigctl.engine.rig import Rig
from rigctl.engine.setup.boards import installed_build
from rigctl.errors import BoardRebooted, LinkLost, RigFault
from rigctl.session.sensor_passport import gain_source
from rigctl.values import Block, BoardIdentity, DrumState

RELEASE_S = 10.0
"""So long after the last touch by hand the sensor is at rest again."""


class FollowedRange:
    """Widens the range with each block; ``set_range`` gets each new one.

    The encoder counts readings outside its range anyway: the range can grow only then.
    """

    def __init__(
        self, taxels: TaxelArray, encoder: Encoder, set_range: Callable[[Normalisation], None]
    ) -> None:
        reading = encoder.parameters.reading
        least = reading.least_range * (taxels.full_scale + 1) // (ADC_MAX + 1)
        self._running = RunningRange(taxels.count, least, reading, taxels.full_scale)
        self._encoder = encoder
        self._set_range = set_range
        self._clipped = -1
        self._is_held = False
        self._resumes_s = 0.0
        self._seen_s = 0.0

    def add(self, block: Block) -> None:
        """Widen the range to a block's readings, unless a person touches the sensor."""
        before, self._clipped = self._clipped, int(self._encoder.clipped_counts.sum())
        self._seen_s = block.arrived_s
        if self._is_held or block.arrived_s < self._resumes_s:
            return
        if self._clipped != before and self._running.update(self._encoder.readings(block.samples)):
            self._set_range(self._running.normalisation)

    def hold(self) -> None:
        """Keep the range as it is: a person touches the sensor, harder than any texture."""
        self._is_held = True

    def release(self) -> None:
        """Go on once the last touch is over."""
        if self._is_held:
            self._is_held = False
            self._resumes_s = self._seen_s + RELEASE_S


Spawn = Callable[[Coroutine[Any, Any, None]], object]

_BOARD_NAMES = {DRUM: "drum board", TAXELS: "taxel board"}
SWITCHED_OFF = (State.BOOT, State.SELFTEST, State.IDLE, State.FAULT_OFF)


class RigBoards:
    """The drum with its poller and motion; the taxels with their pipeline, encoder and live data.

    ``on_link()`` is called when a board is lost or back, ``on_failure`` when samples cannot be
    processed any more. ``spawn`` starts a task.
    """

    def __init__(
        self,
        rig: Rig,
        live_writer: LiveWriter,
        event_bus: EventBus,
        spawn: Spawn,
        allows_heartbeat: Callable[[], bool],
        on_link: Callable[[], None],
        on_failure: Callable[[RigFault], None],
        batching: Batching,
    ) -> None:
        self.taxels = rig.taxels
        self.taxels_connected = False
        self.identities: dict[str, BoardIdentity] = {}
        self.drum_poller = DrumPoller(
            rig.drum, rig.loop, allows_heartbeat, self._drum_lost, self._drum_reconnected
        )
        self.motion = DrumMotion(self.drum_poller, rig.config, rig.commissions)
        self.board_health = BoardHealth(self.drum_poller, rig.taxels, self.identities)
        self.encoder = _compiled_encoder(rig)
        self.pipeline = SamplePipeline(
            self.encoder,
            live_writer,
            waits_for_disk=rig.simulated,
            batching=batching,
            full_scale=rig.config.taxels.full_scale,
        )
        self._rig = rig
        self._live_writer = live_writer
        self._event_bus = event_bus
        self._spawn = spawn
        self._on_link = on_link
        self._on_failure = on_failure
        self._published_state = (-1, 0)
        self._published_contact = (-1, False)
        self._published_test = (0, 0)
        self.followed_range = FollowedRange(rig.config.taxels, self.encoder, self.set_range)
        self._stop_following_range: Callable[[], None] = lambda: None
        self._is_calibrated = bool(rig.config.taxels.low) and not _takes_conductance(rig)
        self.has_taxel_range = self._is_calibrated
        """Whether each taxel's range is calibrated or was measured."""

    @property
    def connected(self) -> bool:
        """Whether both boards are there."""
        return self.taxels_connected and self.drum_poller.connected

    async def connect(self) -> None:
        """Connect both boards, then start samples and heartbeat. Raises LinkLost or WrongBoard."""
        taxels = self._rig.taxels
        self._rig.drum.silence.on_begin = partial(self._publish_silence, DRUM)
        taxels.silence.on_begin = partial(self._publish_silence, TAXELS)
        self.identities[DRUM] = await self.drum_poller.connect()
        self.identities[TAXELS] = await taxels.connect()
        self.taxels_connected = True
        taxels.on_block(self.pipeline.add_block)
        taxels.on_fault(self._taxels_failed)
        taxels.on_self_test(self._publish_self_test)
        self.drum_poller.subscribe(self._show_drum)
        if self._is_calibrated:
            self.set_range(self.encoder.normalisation)
        else:
            self._follow_range()
        self._spawn(self.drum_poller.run())
        await self._configure()
        self._spawn(self.board_health.run())
        for identity in self.identities.values():
            self._publish_board(identity, "connected")
        if not self._rig.config.signals.sync:
            text = "no sync wire is fitted: the drum's clock cuts the trials"
            self._event_bus.publish("log", text)
        if taxels.self_test is not None:
            self._publish_self_test(taxels.self_test)

    def set_range(self, normalisation: Normalisation) -> None:
        """Encode with these ranges from the next sample on."""
        self.encoder.normalisation = normalisation
        self._live_writer.set_range(normalisation.low, normalisation.high)

    async def observe_range(self, work: Awaitable[object]) -> Normalisation:
        """Return the range of all readings while the work is done."""
        encoder = self.encoder
        taxels, reading = self._rig.config.taxels, encoder.parameters.reading
        observed = RunningRange(taxels.count, reading=reading, highest=taxels.full_scale)
        unsubscribe = self.pipeline.subscribe(
            lambda block: observed.update(encoder.readings(block.samples))
        )
        try:
            await work
        finally:
            unsubscribe()
        return observed.normalisation

    def use_range(self, normalisation: Normalisation) -> None:
        """Encode with a measured range, whatever is read from now on."""
        self._stop_following_range()
        self._stop_following_range = lambda: None
        self.has_taxel_range = True
        self.set_range(normalisation)

    def _publish_silence(self, board: str, text: str) -> None:
        """Say what is waited for: at the first connect for the log, after a loss for everybody."""
        self._event_bus.publish("link" if board in self.identities else "log", text, board=board)

    def _follow_range(self) -> None:
        """Without a calibration, encode with the range of all readings so far."""
        self._stop_following_range = self.pipeline.subscribe(self.followed_range.add)
        text = "no taxel calibration: the encoder uses the range of all readings so far"
        self._event_bus.publish("log", text)

    def _show_drum(self, state: DrumState) -> None:
        """Add a poll to the live data and publish what changed."""
        delay_s = state.at_s - state.board_time_us / 1e6
        settings = self.motion.settings
        self._live_writer.add_drum(
            np.array([sample.board_time_us / 1e6 + delay_s for sample in state.loadcell]),
            force_g=np.array([sample.force_g for sample in state.loadcell]),
            force_set_g=settings.get("force_set", 0.0),
            speed_mm_s=state.speed_mm_s,
            speed_set_mm_s=settings.get("speed_set", 0.0),
            state=state.state,
        )
        before, self._published_state = self._published_state, (state.state, state.fault)
        if state.fault and state.fault != before[1]:
            self._event_bus.publish("fault", FAULT_TEXT[Fault(state.fault)], fault=state.fault)
        if state.state != before[0]:
            self._event_bus.publish("state", STATE_TEXT[State(state.state)], state=state.state)
        if state.state not in SWITCHED_OFF:
            self.followed_range.release()  # nobody has a hand on the sensor
        self._publish_contact(state)

    def _publish_contact(self, drum: DrumState) -> None:
        """Publish that a drum that was switched off still presses, in each state once."""
        before = self._published_contact
        self._published_contact = (drum.state, is_left_in_contact(drum))
        if self._published_contact[1] and self._published_contact != before:
            self._event_bus.publish("contact", contact_sentence(drum))

    def _drum_lost(self, reason: str) -> None:
        self._event_bus.publish("link", reason, board=DRUM)
        self._on_link()

    def _drum_reconnected(self, identity: BoardIdentity, rebooted: bool) -> None:
        self.identities[DRUM] = identity
        self.motion.reset()  # another program may have changed any setting meanwhile
        self._publish_return(identity, rebooted)
        self._on_link()
        self._spawn(self._configure_again())

    async def _configure(self) -> None:
        if refusal := await self.motion.configure():
            self._event_bus.publish("check", refusal)

    async def _configure_again(self) -> None:
        try:
            await self._configure()
        except RigFault as fault:
            self._event_bus.publish("link", str(fault), board=DRUM)

    def _publish_self_test(self, test: SelfTest) -> None:
        """Publish a self-test once: the board repeats it after each requested identity."""
        test_id = (self.identities[TAXELS].boot_count, test.count)
        if test_id == self._published_test:
            return
        self._published_test = test_id
        found = self.taxels.findings
        text = f"self-test of the taxels: {'; '.join(found) or 'no findings'}"
        self._event_bus.publish("check" if found else "board", text, found=found)

    def _taxels_failed(self, fault: RigFault) -> None:
        if isinstance(fault, BoardRebooted):
            self._event_bus.publish("link", str(fault), board=TAXELS)
        elif not isinstance(fault, LinkLost):
            self._event_bus.publish("fault", str(fault))
            self._on_failure(fault)
        elif self.taxels_connected:
            self.taxels_connected = False
            self._event_bus.publish("link", str(fault), board=TAXELS)
            self._on_link()
            self._spawn(self._reconnect_taxels())

    async def _reconnect_taxels(self) -> None:
        while not self.taxels_connected:
            await asyncio.sleep(RECONNECT_PERIOD_S)
            try:
                self.identities[TAXELS] = await self._rig.taxels.connect()
            except RigFault:
                continue
            self.taxels_connected = True
        self._publish_return(self.identities[TAXELS], self.taxels.rebooted)
        self._on_link()

    def _publish_return(self, board: BoardIdentity, rebooted: bool) -> None:
        what = "rebooted and is back" if rebooted else "is back"
        self._publish_board(board, f"{what} at {self._link_of(board).name}")

    def _link_of(self, board: BoardIdentity) -> ByteLink:
        return self._rig.drum.link if board.board == DRUM else self._rig.taxels.link

    def _publish_board(self, board: BoardIdentity, what: str) -> None:
        link = self._link_of(board)
        is_ours = link.resets_board and board.build_hash
        ours = installed_build(board.board) if is_ours else ""
        is_other = ours not in ("", board.build_hash)
        cure = f"; this installation brings build {ours}: rigctl flash {board.board}"
        self._event_bus.publish(
            "board",
            f"{_BOARD_NAMES[board.board]} {what}: {_about(board)}{cure if is_other else ''}",
            board=board.board,
            boot_count=board.boot_count,
            **({"flash_at": link.name} if is_other else {}),
        )


def _about(board: BoardIdentity) -> str:
    """Return what the board says of itself; of one that says nothing, what reads it."""
    if not board.build_hash:
        return f"read by {board.firmware_version}"
    return (
        f"firmware {board.firmware_version}, build {board.build_hash}, "
        f"boot {board.boot_count} by {reset_cause_text(board.reset_cause)}"
    )


def _takes_conductance(rig: Rig) -> bool:
    """Return whether the encoder takes conductances, for which a calibration in counts is none."""
    return rig.config.encoder.reading == Reading.CONDUCTANCE


def _compiled_encoder(rig: Rig) -> Encoder:
    """Return the live encoder, compiled before anything moves."""
    taxels, config = rig.config.taxels, rig.config.encoder
    parameters = replace(preset(config.preset), reading=Reading(config.reading))
    inputs: tuple[int, ...] = ()
    if _takes_conductance(rig):
        inputs = input_of_each(taxels.order, taxels.inputs, "[taxels] wiring in rig.toml")
        normalisation = Normalisation.full_scale(taxels.count, reading=Reading.CONDUCTANCE)
    elif taxels.low:
        low, high = np.array(taxels.low, np.uint16), np.array(taxels.high, np.uint16)
        normalisation = Normalisation(low, high)
    else:
        normalisation = Normalisation.full_scale(taxels.count, taxels.full_scale)
    scaling = ForceScaling(config.force_scaling)
    gain_of = gain_source(scaling, rig.passport, parameters.reading)
    encoder = Encoder(normalisation, parameters, inputs=inputs, gain_of=gain_of)
    encoder.warm_up()
    return encoder
