"""The finger board and the tracker: connection, live data, and reconnection after a loss."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any

from rigctl.boards.links import Consumers
from rigctl.encoder.force_gain import ForceGain
from rigctl.encoder.normalisation import Normalisation
from rigctl.engine.event_bus import EventBus
from rigctl.engine.health import RateMeter
from rigctl.errors import BoardRebooted, LinkLost, RigFault
from rigctl.finger.board_messages import N_TAXELS, NO_GAIN, FingerStatus, Message
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.live_file import FingerLiveWriter
from rigctl.finger.rig import FingerRig
from rigctl.finger.slide_detector import ContactMeter
from rigctl.finger.trackers.plate_frame import PlatePosition
from rigctl.finger.trackers.velocity import VelocityEstimator
from rigctl.values import BoardIdentity, Position

LOSS_S = 0.5
"""A tracker without its reference for longer finds it again with another offset: published for the
VIVE by Niehorster et al. 2017, see docs/reference/virtual-finger.md."""


class TrackingLoss:
    """Follows the validity of positions; what came before the first valid one is no loss."""

    def __init__(self) -> None:
        self._valid_s: float | None = None
        self._invalid_s: float | None = None

    def add(self, position: Position) -> float | None:
        """Return the length of a loss in seconds with the first valid position after it."""
        since_s = self._invalid_s
        if not position.valid:
            if since_s is None and self._valid_s is not None:
                self._invalid_s = position.at_s
            return None
        self._valid_s, self._invalid_s = position.at_s, None
        lost_s = 0.0 if since_s is None else position.at_s - since_s
        return lost_s if lost_s > LOSS_S else None


BOARD, TRACKER = "finger", "tracker"
RECONNECT_PERIOD_S = 1.0
RATE_WINDOW_S = 1.0
Spawn = Callable[[Coroutine[Any, Any, None]], object]
OnBlock = Callable[[FingerBlock, float], None]
OnMessage = Callable[[Message, float], None]
OnPosition = Callable[[Position, PlatePosition], None]


class FingerDevices:
    """Both devices of a rig, what they last said, and who wants to hear it.

    ``on_link(device, connected)`` is called when one of them is lost or back.
    """

    def __init__(
        self,
        rig: FingerRig,
        live_writer: FingerLiveWriter,
        event_bus: EventBus,
        spawn: Spawn,
        on_link: Callable[[str, bool], None],
        on_failure: Callable[[RigFault], None],
    ) -> None:
        self.estimator = VelocityEstimator(rig.frame)
        self.contact = ContactMeter()
        self._tracking_loss = TrackingLoss()
        self.identity: BoardIdentity | None = None
        self.board_status: FingerStatus | None = None
        self.connected = {BOARD: False, TRACKER: False}
        self.block_s: float | None = None
        self.position_s: float | None = None
        self.lost_samples = 0
        self.lost_s: float | None = None
        self.restarts = 0
        """How often the board was lost or restarted: a scan across that is broken."""
        self.samples = RateMeter(RATE_WINDOW_S)
        self.normalisation = Normalisation.full_scale(N_TAXELS)
        self.reference_um_per_s = 0
        self._gain = NO_GAIN
        self._sample_count = 0
        self._rig = rig
        self._live_writer = live_writer
        self._event_bus = event_bus
        self._spawn = spawn
        self._on_link = on_link
        self._on_failure = on_failure
        self._blocks: Consumers[FingerBlock, float] = Consumers(self._consumer_failed)
        self._messages: Consumers[Message, float] = Consumers(self._consumer_failed)
        self._positions: Consumers[Position, PlatePosition] = Consumers(self._consumer_failed)

    async def connect(self) -> None:
        """Connect board and tracker. Raises LinkLost, WrongBoard or RigFault."""
        finger = self._rig.finger
        finger.silence.on_begin = partial(self._event_bus.publish, "log")
        finger.on_block(self._take_block)
        finger.on_message(self._take_message)
        finger.on_fault(self._finger_failed)
        self.identity = await finger.connect()
        self._set_connected(BOARD, True)
        self._event_bus.publish("board", _board_text(self.identity, "connected"))
        self._rig.tracker.open(self._take_position, self._tracker_lost)
        self._set_connected(TRACKER, True)

    async def configure(
        self, normalisation: Normalisation, reference_um_per_s: int, gain: ForceGain
    ) -> None:
        """Set ranges, reference speed and gain; the board's answer must be the same.

        A scan that nobody follows any more ends first: the board would refuse its settings.
        """
        self.normalisation, self.reference_um_per_s = normalisation, reference_um_per_s
        self._gain = gain
        low, high = (tuple(map(int, ends)) for ends in (normalisation.low, normalisation.high))
        await self._rig.finger.end_scan()
        await self._rig.finger.configure(low, high, reference_um_per_s, gain)
        self._live_writer.set_range(normalisation.low, normalisation.high)

    def subscribe(
        self, on_block: OnBlock, on_message: OnMessage, on_position: OnPosition
    ) -> Callable[[], None]:
        """Call these with everything that arrives; return the function that unsubscribes them.

        One that raises is dropped, and its run fails.
        """
        self._blocks.add(on_block)
        self._messages.add(on_message)
        self._positions.add(on_position)

        def unsubscribe() -> None:
            self._blocks.remove(on_block)
            self._messages.remove(on_message)
            self._positions.remove(on_position)

        return unsubscribe

    def _take_block(self, block: FingerBlock, arrived_s: float) -> None:
        self.block_s = arrived_s
        if block.missing:
            self.lost_samples += block.missing
            self.lost_s = arrived_s
        self._sample_count += len(block.counters)
        self.samples.update(arrived_s, self._sample_count)
        self.contact.add(block.readings)
        self._live_writer.add_block(block, arrived_s)
        self._blocks.publish(block, arrived_s)

    def _take_message(self, message: Message, arrived_s: float) -> None:
        if isinstance(message, FingerStatus):
            self.board_status = message
        self._messages.publish(message, arrived_s)

    def _take_position(self, position: Position) -> None:
        self.position_s = self._rig.loop.time()
        self.estimator.add(position)
        plate = self.estimator.latest
        assert plate is not None
        self._live_writer.add_position(plate)
        self._note_loss(position)
        self._positions.publish(position, plate)

    def _note_loss(self, position: Position) -> None:
        """Tell the operator once, when the tracker is back, that its frame may have shifted."""
        lost_s = self._tracking_loss.add(position)
        if lost_s is not None:
            text = (
                f"the tracker was lost for {lost_s:.1f} s, and its frame may have shifted by "
                "millimetres: touch the plate's corners again with `rigctl realtime frame`"
            )
            self._event_bus.publish("link", text, board=TRACKER)

    def _consumer_failed(self, error: Exception) -> None:
        self._on_failure(RigFault(f"a consumer of the finger's data failed: {error!r}"))

    def _finger_failed(self, fault: RigFault) -> None:
        self._event_bus.publish("link", str(fault), board=BOARD)
        if not isinstance(fault, LinkLost):
            self._on_failure(fault)
            return
        self.restarts += 1
        if self.connected[BOARD]:
            self._set_connected(BOARD, False)
            self._spawn(self._restore_finger(isinstance(fault, BoardRebooted)))

    async def _restore_finger(self, answers: bool) -> None:
        """Connect the board again, unless it has only rebooted, and give it its settings."""
        told = ""
        while not self.connected[BOARD]:
            try:
                if not answers:
                    await asyncio.sleep(RECONNECT_PERIOD_S)
                    self.identity = await self._rig.finger.connect()
                await self._restore_settings()
            except RigFault as fault:
                answers = False
                if not isinstance(fault, LinkLost) and str(fault) != told:
                    told = str(fault)
                    self._event_bus.publish("link", told, board=BOARD)
                continue
            assert self.identity is not None
            self._event_bus.publish("board", _board_text(self.identity, "is back"))
            self._set_connected(BOARD, True)

    async def _restore_settings(self) -> None:
        if self.reference_um_per_s:
            await self.configure(self.normalisation, self.reference_um_per_s, self._gain)

    def _tracker_lost(self, reason: str) -> None:
        self._event_bus.publish("link", reason, board=TRACKER)
        self._set_connected(TRACKER, False)
        self._spawn(self._restore_tracker())

    async def _restore_tracker(self) -> None:
        while not self.connected[TRACKER]:
            await asyncio.sleep(RECONNECT_PERIOD_S)
            try:
                self._rig.tracker.open(self._take_position, self._tracker_lost)
            except RigFault:
                continue
            self._event_bus.publish("board", f"tracker {self._rig.tracker.name} is back")
            self._set_connected(TRACKER, True)

    def _set_connected(self, device: str, connected: bool) -> None:
        self.connected[device] = connected
        self._on_link(device, connected)


def _board_text(board: BoardIdentity, what: str) -> str:
    return f"{board.board} {what}: firmware {board.firmware_version}, build {board.build_hash}"
