"""The taxel board: blocks of samples as they arrive, and a sentence when they do not."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rigctl.config.rig_config import ADC_MAX, TaxelArray
from rigctl.devices.identity import WhosThere, explain, taxel_identity
from rigctl.devices.links.byte_link import BoardRebooted, ByteLink
from rigctl.errors import LinkLost, RigFault, WrongBoard
from rigctl.values import Block, BoardIdentity
from rigctl.wire.taxels.frames import (
    IDENTIFY,
    SELF_TEST,
    Decoded,
    FrameDecoder,
    TaxelIdentity,
    TaxelStatus,
    encode_request,
)
from rigctl.wire.taxels.self_test import SelfTest, findings

ANSWER_S = 4.0
"""A board that was reset by opening its port answers within this time, bootloader included."""
ASK_AGAIN_S = 0.1
SILENCE_S = 0.2
"""Without a byte for so long the board counts as lost."""
CHECK_S = 0.05

TEST_S = 1.0
"""A self-test takes 21 ms; its outcome may wait behind samples."""

OnBlock = Callable[[Block], None]
OnTest = Callable[[SelfTest], None]
OnFault = Callable[[RigFault], None]


@dataclass(slots=True)
class TaxelCounters:
    """What came and what did not, since this object was made."""

    frames: int = 0
    lost: int = 0
    gaps: int = 0
    rejected_frames: int = 0
    rejected_bytes: int = 0
    reboots: int = 0


class Taxels:
    """The taxel board over one link.

    ``identity`` is that of the last connect, ``rebooted`` whether the board started anew between
    the last two, ``status`` and ``self_test`` what the board last said about itself,
    ``last_block_at_s`` the loop time of the newest samples. Blocks come as the sensor has its
    taxels, in the order and polarity that ``array`` tells; on the wire they stand as wired.
    """

    identity: BoardIdentity

    def __init__(
        self,
        link: ByteLink,
        loop: asyncio.AbstractEventLoop,
        whos_there: WhosThere | None = None,
        array: TaxelArray | None = None,
    ) -> None:
        self.link = link
        self.array = array or TaxelArray()
        self.status: TaxelStatus | None = None
        self.self_test: SelfTest | None = None
        self.counters = TaxelCounters()
        self.rebooted = False
        self.last_block_at_s: float | None = None
        self._loop = loop
        self._whos_there = whos_there
        self._decoder = FrameDecoder()
        self._boot_count: int | None = None
        self._answer: asyncio.Future[TaxelIdentity] | None = None
        self._watch: asyncio.TimerHandle | None = None
        self._heard_s = 0.0
        self._on_block: list[OnBlock] = []
        self._on_fault: list[OnFault] = []
        self._on_test: list[OnTest] = []
        self._order = np.array(self.array.order, np.intp)

    @property
    def connected(self) -> bool:
        """True from a successful connect until the link is closed or lost."""
        return self._watch is not None

    def on_block(self, consumer: OnBlock) -> None:
        """Have ``consumer`` called with every block, in order, in the loop's thread.

        A consumer that raises is reported through :meth:`on_fault` and gets no more blocks.
        """
        self._on_block.append(consumer)

    def on_fault(self, consumer: OnFault) -> None:
        """Have ``consumer`` called when the board is lost or restarts, or a consumer fails."""
        self._on_fault.append(consumer)

    def on_self_test(self, consumer: OnTest) -> None:
        """Have ``consumer`` called with the outcome of every self-test that the board tells."""
        self._on_test.append(consumer)

    @property
    def findings(self) -> list[str]:
        """What the last self-test found, a sentence each; empty where all is well or unknown."""
        return findings(self.self_test, self.array.order) if self.self_test else []

    async def test(self) -> SelfTest:
        """Have the board test its lines and the sensor, while samples flow on.

        Nothing should touch the sensor. Raises LinkLost where no outcome comes.
        """
        outcome: asyncio.Future[SelfTest] = self._loop.create_future()
        before = self.self_test

        def take(test: SelfTest) -> None:
            if not outcome.done() and (before is None or test.count != before.count):
                outcome.set_result(test)

        self._on_test.append(take)
        try:
            self.link.write(encode_request(SELF_TEST))
            return await asyncio.wait_for(outcome, TEST_S)
        except TimeoutError:
            raise LinkLost(
                f"{self.link.name}: the taxel board told no outcome of its self-test within "
                f"{TEST_S:g} s: check the cable"
            ) from None
        finally:
            self._on_test.remove(take)

    async def connect(self) -> BoardIdentity:
        """Open the link, ask who is there, and wait until the sample counter is known.

        Raises LinkLost where nobody answers in time, WrongBoard where somebody else does.
        """
        self.close()
        self._decoder.resync()
        self._answer = self._loop.create_future()
        self.link.open(self._received, self._lost)
        try:
            identity = taxel_identity(self.link.name, await self._first_answer())
        except BaseException as failure:
            self.close()
            await explain(failure, self._whos_there if self._boot_count is None else None)
            raise
        self.rebooted = self._boot_count not in (None, identity.boot_count)
        self._boot_count = identity.boot_count
        self.identity = identity
        self._heard_s = self._loop.time()
        self._expect(self._heard_s + CHECK_S)
        return identity

    def close(self) -> None:
        """Free the port; what arrives later is not counted as lost until the next connect."""
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        self._answer = None
        self.link.close()

    async def _first_answer(self) -> TaxelIdentity:
        answer = self._answer
        assert answer is not None
        deadline_s = self._loop.time() + ANSWER_S
        while not answer.done() or self._decoder.waiting:
            if self._loop.time() > deadline_s:
                raise self._nobody(answer)
            if not answer.done():
                self.link.write(encode_request(IDENTIFY))
            await asyncio.sleep(ASK_AGAIN_S)
            if answer.done():
                answer.result()
        return answer.result()

    def _nobody(self, answer: asyncio.Future[TaxelIdentity]) -> RigFault:
        name = self.link.name
        if answer.done() or self._heard_s:
            return WrongBoard(
                f"{name}: bytes came, but no whole answer of a taxel board within {ANSWER_S:g} s: "
                "another board or baud rate? rigctl ports shows what hangs where"
            )
        return LinkLost(
            f"{name}: no taxel board answered within {ANSWER_S:g} s: check cable and supply; "
            "rigctl ports shows what hangs where"
        )

    def _received(self, data: bytes, at_s: float) -> None:
        self._heard_s = at_s
        decoded = self._decoder.feed(data, at_s)
        self._count(decoded)
        if decoded.statuses:
            self.status = decoded.statuses[-1]
        for test in decoded.self_tests:
            self.self_test = test
            for consumer in tuple(self._on_test):
                consumer(test)
        if decoded.identities:
            self._introduced(decoded.identities[-1])
        if decoded.reboots and self._watch is not None:
            self._restarted()
        for block in decoded.blocks:
            self.last_block_at_s = block.arrived_s
            self._deliver(self._placed(block))

    def _placed(self, block: Block) -> Block:
        """The block as the sensor has its taxels: in its order, pressure upwards."""
        samples = np.ascontiguousarray(block.samples[:, self._order])
        return replace(block, samples=samples if self.array.pressure_raises else ADC_MAX - samples)

    def _count(self, decoded: Decoded) -> None:
        counters = self.counters
        for block in decoded.blocks:
            counters.frames += len(block)
            counters.gaps += len(block.gaps)
            counters.lost += sum(gap.count for gap in block.gaps) if block.gaps else 0
        counters.rejected_frames += decoded.rejected_frames
        counters.rejected_bytes += decoded.rejected_bytes
        counters.reboots += decoded.reboots

    def _introduced(self, identity: TaxelIdentity) -> None:
        if self._answer is not None and not self._answer.done():
            self._answer.set_result(identity)

    def _restarted(self) -> None:
        self._report(
            BoardRebooted(
                f"{self.link.name}: the taxel board restarted by itself: its counters begin anew"
            )
        )

    def _deliver(self, block: Block) -> None:
        for consumer in tuple(self._on_block):
            try:
                consumer(block)
            except Exception as error:  # noqa: BLE001 - becomes a visible fault, reading goes on
                self._on_block.remove(consumer)
                self._report(RigFault(f"{self.link.name}: a consumer of samples failed: {error!r}"))

    def _report(self, fault: RigFault) -> None:
        for consumer in tuple(self._on_fault):
            consumer(fault)

    def _lost(self, reason: str) -> None:
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(LinkLost(reason))
            return
        self.close()
        self._report(LinkLost(reason))

    def _expect(self, at_s: float) -> None:
        self._watch = self._loop.call_at(at_s, self._check, at_s)

    def _check(self, due_s: float) -> None:
        """Report silence; a loop that was itself late has first to read what waits."""
        now_s = self._loop.time()
        if now_s - self._heard_s > SILENCE_S and now_s - due_s < CHECK_S:
            self._lost(f"{self.link.name}: no taxel sample for {SILENCE_S:g} s: check the cable")
        elif self._watch is not None:
            self._expect(now_s + CHECK_S)
