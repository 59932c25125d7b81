"""The driver of the taxel board: blocks of samples as they arrive, faults when they do not."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rigctl.boards.boot_silence import BootSilence, SilenceWatch
from rigctl.boards.identity import (
    CONNECT_TIMEOUT_S,
    PortDiagnosis,
    no_answer,
    raise_diagnosis,
    taxel_identity,
)
from rigctl.boards.links import ByteLink, Consumers
from rigctl.boards.taxel_frames import (
    IDENTIFY,
    SELF_TEST,
    SelfTest,
    TaxelStatus,
    encode_request,
    findings,
)
from rigctl.config.rig_config import PAPER_ARRAY, TaxelArray
from rigctl.errors import BoardRebooted, LinkLost, RigFault, WrongBoard, WrongUse
from rigctl.values import Block, BoardIdentity

if TYPE_CHECKING:
    from rigctl.boards.sensor_driver import DriverDecoder, SensorDriver
    from rigctl.boards.taxel_decoder import Decoded, FrameDecoder

IDENTIFY_INTERVAL_S = 0.1
LINK_TIMEOUT_S = 0.2
"""A board that sends no byte for this time counts as lost."""
OLD_NANO = (
    "; a Nano with the old bootloader restarts for ever after a hang: pull its cable and plug it in"
)
SELF_TEST_TIMEOUT_S = 1.0
"""A self-test takes 21 ms; its outcome may queue behind samples."""

OnBlock = Callable[[Block], None]
OnSelfTest = Callable[[SelfTest], None]
OnFault = Callable[[RigFault], None]


@dataclass(slots=True)
class TaxelCounters:
    """Samples received and lost, frames rejected or stale, and reboots since construction."""

    frames: int = 0
    lost: int = 0
    gaps: int = 0
    rejected_frames: int = 0
    rejected_bytes: int = 0
    stale_frames: int = 0
    reboots: int = 0


class Taxels:
    """The taxel board over one link.

    ``identity`` is that of the last connect, ``rebooted`` whether the board rebooted between the
    last two, ``status`` and ``self_test`` are the board's last reports. Blocks have the taxels in
    the order and the polarity of the sensor, as ``array`` describes it; the wire has them as
    wired. Without ``array``, as in a search for boards, the board of any sensor connects. A
    ``driver`` decodes the wire of another board, which has no identity, status or self-test: its
    first sample stands for them.
    """

    identity: BoardIdentity

    def __init__(
        self,
        link: ByteLink,
        loop: asyncio.AbstractEventLoop,
        diagnose_port: PortDiagnosis | None = None,
        array: TaxelArray | None = None,
        driver: SensorDriver | None = None,
    ) -> None:
        self.link = link
        self.array = array or PAPER_ARRAY
        self._wanted = array
        self.status: TaxelStatus | None = None
        self.self_test: SelfTest | None = None
        self.counters = TaxelCounters()
        self.rebooted = False
        self._loop = loop
        self._diagnose_port = diagnose_port
        self._driver = driver
        self._decoder = _decoder(self.array, driver)
        self._request = encode_request(IDENTIFY) if driver is None else driver.create.request
        self._boot_count: int | None = None
        self._identified: asyncio.Future[BoardIdentity] | None = None
        self._watch = SilenceWatch(loop, LINK_TIMEOUT_S, self._fall_silent)
        self.silence = BootSilence(link, loop, OLD_NANO)
        self._listens = False
        self._blocks: Consumers[Block] = Consumers(self._report_consumer)
        self._on_fault: list[OnFault] = []
        self._on_self_test: list[OnSelfTest] = []

    @property
    def connected(self) -> bool:
        """True from a successful connect until the link is closed or lost."""
        return self._watch.running

    def on_block(self, callback: OnBlock) -> Callable[[], None]:
        """Subscribe ``callback`` to every block, in order, in the loop's thread.

        Returns the function that unsubscribes it. A callback that raises is reported through
        :meth:`on_fault` and unsubscribed.
        """
        self._blocks.add(callback)
        return lambda: self._blocks.remove(callback)

    def on_fault(self, callback: OnFault) -> None:
        """Subscribe ``callback`` to lost links, reboots and failed callbacks."""
        self._on_fault.append(callback)

    def on_self_test(self, callback: OnSelfTest) -> None:
        """Subscribe ``callback`` to the outcome of every self-test."""
        self._on_self_test.append(callback)

    @property
    def findings(self) -> list[str]:
        """Findings of the last self-test, a sentence each; empty where it passed or is unknown."""
        if self.self_test is None:
            return []
        return findings(self.self_test, self.array.order, self.array.inputs)

    async def test(self) -> SelfTest:
        """Run a self-test of lines and sensor and return its outcome; samples keep flowing.

        Nothing should touch the sensor. Raises LinkLost where no outcome comes, WrongUse for the
        board of a driver.
        """
        if self._driver is not None:
            raise WrongUse(
                f"the {self._driver.plugin} has no self-test: leave it out, and look at the "
                "readings of the untouched sensor"
            )
        outcome: asyncio.Future[SelfTest] = self._loop.create_future()
        before = self.self_test

        def receive(test: SelfTest) -> None:
            if not outcome.done() and (before is None or test.count != before.count):
                outcome.set_result(test)

        self._on_self_test.append(receive)
        try:
            self.link.write(encode_request(SELF_TEST))
            return await asyncio.wait_for(outcome, SELF_TEST_TIMEOUT_S)
        except TimeoutError:
            raise LinkLost(
                f"{self.link.name}: the taxel board sent no outcome of its self-test within "
                f"{SELF_TEST_TIMEOUT_S:g} s: check the cable"
            ) from None
        finally:
            self._on_self_test.remove(receive)

    async def connect(self) -> BoardIdentity:
        """Open the link, wait for identity and sample counter, and return the identity.

        As to whether the port stays open where the board does not answer see
        :meth:`Drum.connect`. Raises LinkLost where no board answers in time, WrongBoard where
        another board does.
        """
        self._watch.stop()
        self._decoder.resync()
        self._identified = self._loop.create_future()
        self._listens = True
        self.silence.open_link(self._receive, self._lose)
        await self.silence.wait()
        try:
            identity = await self._read_identity()
        except BaseException as failure:
            self._identified = None
            if self._boot_count is None:
                await raise_diagnosis(failure, self.link, self._diagnose_port)
            self.silence.close_link()
            raise
        self.rebooted = self._boot_count not in (None, identity.boot_count)
        self._boot_count = identity.boot_count
        self.identity = identity
        self._watch.start()
        return identity

    def close(self) -> None:
        """Free the port; samples until the next connect are not counted as lost."""
        self._watch.stop()
        self._identified = None
        self.link.close()

    async def _read_identity(self) -> BoardIdentity:
        """Request the identity until it and a status frame have come; raises if time is up."""
        identified = self._identified
        assert identified is not None
        deadline_s = self.silence.ask_until_s(CONNECT_TIMEOUT_S)
        while not identified.done() or self._decoder.waiting:
            if self._loop.time() > deadline_s:
                raise no_answer(
                    self.silence, self.link, "taxel", identified.done() or self._watch.heard_s > 0
                )
            if not identified.done() and self._request:
                self.link.write(self._request)
            await asyncio.sleep(IDENTIFY_INTERVAL_S)
            if identified.done():
                identified.result()
        return identified.result()

    def _receive(self, data: bytes, at_s: float) -> None:
        self._watch.heard_s = at_s
        try:
            decoded = self._decoder.feed(data, at_s)
        except LinkLost as failure:
            self._lose(str(failure))
            return
        if decoded.blocks or decoded.statuses:
            self.silence.hear(at_s)
        if not self._listens:
            return
        self._count(decoded)
        if decoded.statuses:
            self.status = decoded.statuses[-1]
        for test in decoded.self_tests:
            self.self_test = test
            for callback in tuple(self._on_self_test):
                callback(test)
        if self._identified is not None and not self._identified.done():
            self._identify(self._identified, decoded)
        if decoded.reboots and self.connected:
            name = self.link.name
            self._report(
                BoardRebooted(f"{name}: the taxel board restarted: its counters began again")
            )
        for block in decoded.blocks:
            self._blocks.publish(block if self.array.pressure_raises else self._inverted(block))

    def _identify(self, identified: asyncio.Future[BoardIdentity], decoded: Decoded) -> None:
        """Tell who waits for it; what stands for that of a driver's board comes with a sample."""
        if self._driver is not None and decoded.blocks:
            identified.set_result(self._driver.identity)
        elif decoded.identities:
            reported = decoded.identities[-1]
            try:
                identified.set_result(taxel_identity(self.link.name, reported, self._wanted))
            except WrongBoard as refusal:
                identified.set_exception(refusal)

    def _inverted(self, block: Block) -> Block:
        """Return the block of a sensor that reads lower when pressed with the usual polarity."""
        return replace(block, samples=np.uint16(self.array.full_scale) - block.samples)

    def _count(self, decoded: Decoded) -> None:
        counters = self.counters
        for block in decoded.blocks:
            counters.frames += len(block)
            counters.gaps += len(block.gaps)
            counters.lost += sum(gap.count for gap in block.gaps) if block.gaps else 0
        counters.rejected_frames += decoded.rejected_frames
        counters.rejected_bytes += decoded.rejected_bytes
        counters.stale_frames += decoded.stale_frames
        counters.reboots += decoded.reboots

    def _report_consumer(self, error: Exception) -> None:
        self._report(RigFault(f"{self.link.name}: a consumer of samples failed: {error!r}"))

    def _report(self, fault: RigFault) -> None:
        for callback in tuple(self._on_fault):
            callback(fault)

    def _lose(self, reason: str) -> None:
        self.silence.end()
        if self._identified is not None and not self._identified.done():
            self._identified.set_exception(LinkLost(reason))
            return
        self._watch.stop()
        self._listens = False
        self.silence.close_link()
        self._report(LinkLost(reason))

    def _fall_silent(self) -> None:
        name = self.link.name
        self._lose(f"{name}: no taxel sample for {LINK_TIMEOUT_S:g} s: check the cable")


def _decoder(array: TaxelArray, driver: SensorDriver | None) -> FrameDecoder | DriverDecoder:
    """Return what decodes the stream."""
    # Numba takes long to load: only who decodes waits, not a window that opens.
    if driver is None:
        from rigctl.boards.taxel_decoder import FrameDecoder

        return FrameDecoder(array.count, array.order)
    from rigctl.boards.sensor_driver import DriverDecoder

    return DriverDecoder(driver, array.order)
