"""The driver of the finger board: samples, spikes and windows as they arrive, and its settings."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from rigctl.boards.boot_silence import BootSilence, SilenceWatch
from rigctl.boards.drum_registers import MAGIC
from rigctl.boards.identity import (
    CONNECT_TIMEOUT_S,
    GIVE_IT,
    WHICH_PORT,
    PortDiagnosis,
    no_answer,
    raise_diagnosis,
    version_text,
)
from rigctl.boards.links import ByteLink, Consumers
from rigctl.encoder.force_gain import ForceGain
from rigctl.errors import BoardRebooted, CommandRefused, LinkLost, RigFault, WrongBoard, WrongUse
from rigctl.finger import board_messages
from rigctl.finger.board_messages import (
    N_TAXELS,
    NO_GAIN,
    Answer,
    FingerIdentity,
    FingerSettings,
    FingerStatus,
    Message,
    RequestType,
    Result,
    gain_crc,
)
from rigctl.finger.decoder import FingerBlock, FingerDecoder
from rigctl.values import FINGER, BoardIdentity

ANSWER_TIMEOUT_S = 0.5
"""The board answers before its next sample; the answer may queue behind samples."""
SETTINGS_ATTEMPTS = 3
"""Setting twice does no harm. Starting or stopping twice would: the board is asked once."""
MAX_READING = 1023
SLOWEST_REFERENCE_UM_PER_S, FASTEST_REFERENCE_UM_PER_S = 1_000, 10_000_000

_REFUSALS = {
    Result.WRONG_VALUE: "a value is outside its limits: see docs/reference/finger-wire.md",
    Result.SCANNING: "a scan is under way: stop it first",
    Result.NOT_WAITING: "no batch waits for it",
    Result.NO_MODEL: "its image has no classifier: build one with FINGER_MODEL",
}
_Kind = TypeVar("_Kind", bound=Message)


class _Expected(NamedTuple):
    fits: Callable[[Message], bool]
    answer: asyncio.Future[Message]


class FingerRequests:
    """Sends requests and returns the messages that fit them."""

    def __init__(self, link: ByteLink, loop: asyncio.AbstractEventLoop) -> None:
        self._link = link
        self._loop = loop
        self._expected: list[_Expected] = []

    def take(self, message: Message) -> None:
        """Pass a message of the board to those who wait for it."""
        for expected in self._expected:
            if not expected.answer.done() and expected.fits(message):
                expected.answer.set_result(message)

    def fail(self, fault: RigFault) -> None:
        """Raise ``fault`` where somebody waits: the board is gone or began anew."""
        for expected in self._expected:
            if not expected.answer.done():
                expected.answer.set_exception(fault)

    async def change(self, request: bytes, kind: RequestType, attempts: int, scan: int = 0) -> None:
        """Send a request that changes something and wait for the board's answer to it.

        Raises CommandRefused with the board's reason, LinkLost where no answer comes.
        """

        def fits(answer: Answer) -> bool:
            return answer.request is kind and answer.scan == scan

        answer = await self._ask_in_time(request, Answer, fits, attempts)
        if answer.result is not Result.OK:
            what = kind.name.lower().replace("_", " ")
            raise CommandRefused(
                f"{self._link.name}: the finger board refused to {what}: {_REFUSALS[answer.result]}"
            )

    async def read_settings(self) -> FingerSettings:
        """Return the settings. The board replies in order: older replies have come then, too."""
        return await self._ask_in_time(
            board_messages.read_settings(), FingerSettings, lambda _: True, SETTINGS_ATTEMPTS
        )

    async def wait(self, kind: type[_Kind], fits: Callable[[_Kind], bool]) -> None:
        """Wait for a message that the board sends unasked. Raises LinkLost where none comes."""
        await self._ask_in_time(b"", kind, fits, 1)

    async def ask(
        self,
        request: bytes,
        kind: type[_Kind],
        fits: Callable[[_Kind], bool] = lambda _: True,
        *,
        attempts: int,
        each_s: float,
    ) -> _Kind:
        """Send a request until a message of ``kind`` comes that fits; raises TimeoutError."""
        answer: asyncio.Future[Message] = self._loop.create_future()
        expected = _Expected(lambda message: isinstance(message, kind) and fits(message), answer)
        self._expected.append(expected)
        try:
            for _ in range(attempts):
                if request:
                    self._link.write(request)
                await asyncio.wait([answer], timeout=each_s)
                if answer.done():
                    message = answer.result()
                    assert isinstance(message, kind)
                    return message
            raise TimeoutError
        finally:
            self._expected.remove(expected)

    async def _ask_in_time(
        self, request: bytes, kind: type[_Kind], fits: Callable[[_Kind], bool], attempts: int
    ) -> _Kind:
        try:
            return await self.ask(request, kind, fits, attempts=attempts, each_s=ANSWER_TIMEOUT_S)
        except TimeoutError:
            raise LinkLost(
                f"{self._link.name}: the finger board sent no {kind.__name__} within "
                f"{attempts * ANSWER_TIMEOUT_S:g} s: check the cable, then connect it again"
            ) from None


def require_settings(
    low: Sequence[int], high: Sequence[int], reference_um_per_s: int, gain: ForceGain
) -> FingerSettings:
    """Return the settings; raises WrongUse for values that the board would refuse or clip."""
    if len(low) != N_TAXELS or len(high) != N_TAXELS:
        raise WrongUse(f"the finger has {N_TAXELS} taxels: give a range for each")
    for taxel, (lowest, highest) in enumerate(zip(low, high, strict=True), start=1):
        if not 0 <= lowest < highest <= MAX_READING:
            raise WrongUse(
                f"taxel {taxel}: the range {lowest} to {highest} is empty or outside 0 to "
                f"{MAX_READING}: repeat the normalisation"
            )
    if not SLOWEST_REFERENCE_UM_PER_S <= reference_um_per_s <= FASTEST_REFERENCE_UM_PER_S:
        raise WrongUse(
            f"the reference speed {reference_um_per_s} µm/s is outside "
            f"{SLOWEST_REFERENCE_UM_PER_S} to {FASTEST_REFERENCE_UM_PER_S}"
        )
    ends = tuple(map(int, low)), tuple(map(int, high))
    return FingerSettings(*ends, int(reference_um_per_s), gain_crc(gain))


IDENTIFY_INTERVAL_S = 0.1
LINK_TIMEOUT_S = 0.2
"""A board that sends no byte for this time counts as lost."""
MAX_U32 = 2**32 - 1
NO_SCAN = 0
"""Scans count from 1."""

OnFingerBlock = Callable[[FingerBlock, float], None]
OnMessage = Callable[[Message, float], None]
OnFault = Callable[[RigFault], None]


@dataclass(slots=True)
class FingerCounters:
    """Samples received and lost, damaged and stale frames and reboots since construction."""

    samples: int = 0
    lost: int = 0
    damaged_frames: int = 0
    stale_frames: int = 0
    reboots: int = 0


class Finger:
    """The finger board over one link.

    ``identity`` is that of the last connect, ``rebooted`` whether the board rebooted between the
    last two, ``settings`` what the board said last that it uses, ``status`` its last counters.
    """

    identity: BoardIdentity

    def __init__(
        self,
        link: ByteLink,
        loop: asyncio.AbstractEventLoop,
        diagnose_port: PortDiagnosis | None = None,
    ) -> None:
        self.link = link
        self.counters = FingerCounters()
        self.status: FingerStatus | None = None
        self.settings: FingerSettings | None = None
        self.rebooted = False
        self._loop = loop
        self._diagnose_port = diagnose_port
        self._decoder = FingerDecoder()
        self._watch = SilenceWatch(loop, LINK_TIMEOUT_S, self._fall_silent)
        self.silence = BootSilence(link, loop)
        self._listens = False
        self._reboots_before = 0
        self._requests = FingerRequests(link, loop)
        self._on_fault: list[OnFault] = []
        self._blocks: Consumers[FingerBlock, float] = Consumers(self._report_consumer)
        self._messages: Consumers[Message, float] = Consumers(self._report_consumer)

    @property
    def connected(self) -> bool:
        """True from a successful connect until the link is closed or lost."""
        return self._watch.running

    def on_block(self, callback: OnFingerBlock) -> None:
        """Call ``callback(block, arrived_s)`` for every block, in order, in the loop's thread.

        A callback that raises is reported through :meth:`on_fault` and dropped.
        """
        self._blocks.add(callback)

    def on_message(self, callback: OnMessage) -> None:
        """Call ``callback(message, arrived_s)`` for every other frame; raising is as for blocks."""
        self._messages.add(callback)

    def on_fault(self, callback: OnFault) -> None:
        """Call ``callback`` for lost links, reboots and failed callbacks."""
        self._on_fault.append(callback)

    async def connect(self) -> BoardIdentity:
        """Open the link, wait for identity, settings and sample counter, return the identity.

        Raises LinkLost where no board answers in time, WrongBoard where another board does.
        """
        self._watch.stop()
        self._decoder.resync()
        self._watch.heard_s = 0.0
        before = self.settings
        self._listens = True
        self.silence.open_link(self._receive, self._lose)
        await self.silence.wait()
        try:
            identity = _identity(self.link.name, await self._read_identity())
            settings = await self._requests.read_settings()
            await self._requests.wait(FingerStatus, lambda _: not self._decoder.waiting)
        except BaseException as failure:
            if before is None:
                await raise_diagnosis(failure, self.link, self._diagnose_port)
            self.silence.close_link()
            raise
        restarted = self.counters.reboots > self._reboots_before
        self.rebooted = restarted or before not in (None, settings)
        self._reboots_before = self.counters.reboots
        self.identity = identity
        self._decoder.connecting = False
        self._watch.start()
        return identity

    def close(self) -> None:
        """Free the port; samples until the next connect are missing in its first block."""
        self._watch.stop()
        self._requests.fail(LinkLost(f"{self.link.name}: the link was closed"))
        self.link.close()

    async def configure(
        self,
        low: Sequence[int],
        high: Sequence[int],
        reference_um_per_s: int,
        gain: ForceGain = NO_GAIN,
    ) -> FingerSettings:
        """Set range of each taxel, reference speed and gain, read them back and return them.

        ``low`` and ``high``: 9 readings each; ``gain`` counts from ``low``. Raises WrongUse for
        values that no board takes, CommandRefused during a scan, RigFault where the board uses
        something else afterwards.
        """
        wanted = require_settings(low, high, reference_um_per_s, gain)
        requests = self._requests
        ranges = board_messages.set_ranges(wanted.low, wanted.high)
        await requests.change(ranges, RequestType.SET_RANGES, SETTINGS_ATTEMPTS)
        reference = board_messages.set_reference(reference_um_per_s)
        await requests.change(reference, RequestType.SET_REFERENCE, SETTINGS_ATTEMPTS)
        # The first of the parts' answers is enough: the settings, which come last, tell of all.
        parts = board_messages.set_gain(gain)
        await requests.change(parts, RequestType.SET_GAIN, SETTINGS_ATTEMPTS)
        settings = await requests.read_settings()
        if settings != wanted:
            raise RigFault(
                f"{self.link.name}: the finger board uses {settings} after it was set to {wanted}: "
                "set it again, and check its firmware"
            )
        return settings

    async def set_mean(self, window: int, mean_hz: Sequence[float]) -> None:
        """Replace the mean features of a window, one for each taxel, of a classifier on the board.

        Raises CommandRefused during a scan and where the image has no classifier.
        """
        request = board_messages.set_mean(window, mean_hz)
        await self._requests.change(request, RequestType.SET_MEAN, SETTINGS_ATTEMPTS)

    async def start(self, scan: int) -> None:
        """Start a scan with the next sample. Raises LinkLost where the board does not confirm."""
        request = board_messages.start(_u32("scan", scan))
        await self._requests.change(request, RequestType.START, 1, scan)

    async def stop(self, scan: int) -> None:
        """Close the scan's last batch; its velocity ends the scan. Raises as :meth:`start`."""
        request = board_messages.stop(_u32("scan", scan))
        await self._requests.change(request, RequestType.STOP, 1, scan)

    async def end_scan(self) -> None:
        """End the scan that is under way, if any; its last batches may lack their velocities.

        Raises LinkLost where the board does not confirm.
        """
        # The board stops any scan, and one that has stopped at a second request.
        for _ in range(2):
            request = board_messages.stop(NO_SCAN)
            await self._requests.change(request, RequestType.STOP, SETTINGS_ATTEMPTS, NO_SCAN)

    def send_start(self, scan: int) -> None:
        """Start a scan with the next sample and return at once; the answer is a message.

        Raises as :meth:`set_velocity`.
        """
        self.link.write(board_messages.start(_u32("scan", scan)))

    def send_stop(self, scan: int) -> None:
        """Close the scan's last batch and return at once; the answer is a message.

        A second one ends a scan whose last velocities are not known. Raises as
        :meth:`set_velocity`.
        """
        self.link.write(board_messages.stop(_u32("scan", scan)))

    def set_velocity(self, scan: int, batch: int, um_per_s: int) -> None:
        """Send the mean velocity of a batch and return at once.

        The board's answer and report of the batch come through :meth:`on_message`. Raises
        WrongUse for a value that the wire cannot hold, LinkLost where the link is closed.
        """
        values = (_u32("scan", scan), _u32("batch", batch), _u32("velocity", um_per_s))
        self.link.write(board_messages.velocity(*values))

    async def _read_identity(self) -> FingerIdentity:
        left_s = self.silence.ask_until_s(CONNECT_TIMEOUT_S) - self._loop.time()
        attempts = max(1, round(left_s / IDENTIFY_INTERVAL_S))
        try:
            return await self._requests.ask(
                board_messages.identify(),
                FingerIdentity,
                attempts=attempts,
                each_s=IDENTIFY_INTERVAL_S,
            )
        except TimeoutError:
            raise no_answer(self.silence, self.link, "finger", self._watch.heard_s > 0) from None

    def _receive(self, data: bytes, at_s: float) -> None:
        self._watch.heard_s = at_s
        decoder, counters = self._decoder, self.counters
        block, received = decoder.feed(data)
        if len(block.counters) or received:
            self.silence.hear(at_s)
        if not self._listens:
            return
        counters.damaged_frames, counters.stale_frames = decoder.damaged, decoder.stale
        if decoder.reboots > counters.reboots:
            counters.reboots = decoder.reboots
            self._report_reboot()
        self._publish(block, at_s)
        for message in received:
            self._note(message)
            self._requests.take(message)
            self._messages.publish(message, at_s)

    def _report_reboot(self) -> None:
        if self.connected:
            fault = BoardRebooted(
                f"{self.link.name}: the finger board restarted with its default settings: connect "
                "it again and set it"
            )
            self._requests.fail(fault)
            self._report(fault)

    def _publish(self, block: FingerBlock, at_s: float) -> None:
        if len(block.counters):
            self.counters.samples += len(block.counters)
            self.counters.lost += block.missing
            self._blocks.publish(block, at_s)

    def _note(self, message: Message) -> None:
        if isinstance(message, FingerSettings):
            self.settings = message
        elif isinstance(message, FingerStatus):
            self.status = message

    def _report(self, fault: RigFault) -> None:
        for callback in tuple(self._on_fault):
            callback(fault)

    def _report_consumer(self, error: Exception) -> None:
        self._report(RigFault(f"{self.link.name}: a consumer of samples failed: {error!r}"))

    def _fall_silent(self) -> None:
        name = self.link.name
        self._lose(f"{name}: no finger sample for {LINK_TIMEOUT_S:g} s: check the cable")

    def _lose(self, reason: str) -> None:
        was_connected = self.connected
        self._requests.fail(LinkLost(reason))
        self._watch.stop()
        self._listens = False
        self.silence.end()
        self.silence.close_link()
        if was_connected:
            self._report(LinkLost(reason))


def _u32(what: str, value: int) -> int:
    if not 0 <= value <= MAX_U32:
        raise WrongUse(f"{what} {value} is outside 0 to {MAX_U32}")
    return value


def _identity(name: str, reported: FingerIdentity) -> BoardIdentity:
    """Return the finger board's identity; raises WrongBoard for another board or wire version."""
    version = version_text(reported.firmware_version)
    if reported.magic != MAGIC or reported.board_id != board_messages.BOARD_FINGER:
        raise WrongBoard(f"{name}: the board there is not a finger board: {WHICH_PORT}")
    if not reported.is_finger or reported.batch_samples != board_messages.BATCH_SAMPLES:
        raise WrongBoard(
            f"{name}: the finger board's firmware {version} speaks wire version "
            f"{reported.wire_version} with {reported.n_taxels} taxels in batches of "
            f"{reported.batch_samples}, this program version {board_messages.WIRE_VERSION} with "
            f"{N_TAXELS} in batches of {board_messages.BATCH_SAMPLES}: "
            f"{GIVE_IT} `rigctl flash finger`"
        )
    return BoardIdentity(
        board=FINGER,
        firmware_version=version,
        build_hash=f"{reported.build_hash:08x}",
        wire_version=reported.wire_version,
        boot_count=0,
        reset_cause=0,
        details={n: getattr(reported, n) for n in ("rate_hz", "batch_samples")},
    )
