"""The virtual taxel board: a frame a millisecond by its own clock, status, identity, requests."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigctl.wire import taxels as wire
from rigctl.wire.taxel_test import Coverage, SelfTest
from rigctl.world.bench import Bench
from rigctl.world.plant import RING_MS
from rigctl.world.simulation import SimulatedLink
from rigctl.world.skin import FULL_COUNTS, SLOT_US

FRAME_US = 1000
FLUSH_US = 20_000
"""The cable hands over what came in this time: the latency timer of common USB adapters."""

SEND_US = 700
"""From the end of a frame's samples to the last byte of the frame."""

BOOT_US = 5_000
FIRMWARE_VERSION = 1
BUILD_HASH = 0x56495254
SUPPLY_MV = 5000
FREE_STACK_BYTES = 1024
TEST_US = 21_000
"""A self-test takes a step a frame, 21 in all."""
SILENT_BELOW, FULL_ABOVE = 4, 1015
POWER_ON, EXTERNAL = 1, 2


class VirtualTaxels:
    """The taxel board from power-up on. Times are world microseconds."""

    def __init__(self, bench: Bench, link: SimulatedLink) -> None:
        self._bench = bench
        self._link = link
        self._frame_us = FRAME_US / (1.0 + bench.parameters.taxel_clock_ppm * 1e-6)
        self._frames_ever = 0
        self._boots = 0
        self._input = b""
        self._boot(0, POWER_ON)
        link.attach(self._receive)

    def _boot(self, at_us: int, cause: int) -> None:
        self._boots += 1
        self._cause = cause
        self._origin_us = at_us + BOOT_US
        self._counter = 0
        self._test: SelfTest | None = None
        self._test_due_us: float | None = self._origin_us + TEST_US
        self._rises: list[int] = []
        self._marks: list[int] = []
        self._levels: list[tuple[int, int]] = [(at_us, self._bench.sync_level)]
        self._rises_before = self._marks_before = 0
        self._answers = [self._identity()]
        self.next_us = (at_us // FLUSH_US + 1) * FLUSH_US

    def reset(self, now_us: int) -> None:
        """The reset button: counters start anew."""
        self._boot(now_us, EXTERNAL)

    def sync_edge(self, level: int, at_us: int) -> None:
        """The drum board drives the sync line."""
        self._levels.append((at_us, level))
        if level:
            self._rises.append(at_us)

    def index_mark(self, at_us: int) -> None:
        """An index mark began."""
        self._marks.append(at_us)

    def pass_time(self, now_us: int) -> None:
        """Hand over what came since the last time."""
        self.next_us = now_us + FLUSH_US
        self._bench.skin.advance()
        self._finish_test(now_us)
        data = b"".join(self._answers)
        self._answers.clear()
        done = int((now_us - SEND_US - self._origin_us) / self._frame_us)
        while self._counter < done:
            until = min(done, (self._counter // wire.STATUS_EVERY + 1) * wire.STATUS_EVERY)
            data += self._frames(until - self._counter)
            if self._counter % wire.STATUS_EVERY == 0:
                data += wire.encode_status(self._status())
        if data:
            self._link.deliver(data, now_us * 1e-6)

    def _frames(self, count: int) -> bytes:
        counters = np.arange(self._counter, self._counter + count, dtype=np.int64)
        starts: NDArray[np.float64] = self._origin_us + counters.astype(np.float64) * self._frame_us
        slot_us = SLOT_US * self._frame_us / FRAME_US
        samples = self._bench.skin.read(self._frames_ever, starts, slot_us)
        flags, edges = self._edges(starts + self._frame_us)
        self._counter += count
        self._frames_ever += count
        return wire.encode_data(counters, samples, flags, edges)

    def _edges(self, ends_us: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Flags and edge counts of frames that are closed at these times."""
        if not self._rises and not self._marks and len(self._levels) == 1:
            return self._steady(ends_us.size)
        rises = np.searchsorted(np.array(self._rises), ends_us, "right") + self._rises_before
        marks = np.searchsorted(np.array(self._marks), ends_us, "right") + self._marks_before
        times = np.array([at_us for at_us, _ in self._levels])
        levels = np.array([level for _, level in self._levels])
        last = np.maximum(np.searchsorted(times, ends_us, "right") - 1, 0)
        began = np.diff(marks, prepend=self._marks_before) > 0
        flags = levels[last] * wire.Flag.SYNC + began * wire.Flag.INDEX
        edges = rises % 4 + (marks % 4) * 4
        self._forget(int(rises[-1]), int(marks[-1]), int(last[-1]))
        return flags.astype(np.uint8), edges.astype(np.uint8)

    def _steady(self, count: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Flags and edge counts while nothing happens on the lines."""
        flag = self._levels[0][1] * int(wire.Flag.SYNC)
        edge = self._rises_before % 4 + self._marks_before % 4 * 4
        return _repeated(flag, count), _repeated(edge, count)

    def _forget(self, rises: int, marks: int, level: int) -> None:
        del self._rises[: rises - self._rises_before]
        del self._marks[: marks - self._marks_before]
        del self._levels[:level]
        self._rises_before, self._marks_before = rises, marks

    def _receive(self, data: bytes) -> None:
        *chunks, self._input = (self._input + data).split(b"\0")
        for chunk in chunks:
            body = wire.unframe(chunk)
            if body == bytes([wire.IDENTIFY]):
                self._answers.append(self._identity())
                if self._test is not None:
                    self._answers.append(wire.encode_self_test(self._test))
            elif body == bytes([wire.SELF_TEST]):
                self._test_due_us = max(self._now_us(), self._origin_us) + TEST_US

    def _now_us(self) -> int:
        return self.next_us - FLUSH_US

    def _finish_test(self, now_us: int) -> None:
        """The wiring of a virtual board has no faults; its taxels may."""
        if self._test_due_us is None or now_us < self._test_due_us:
            return
        self._test_due_us = None
        counts = self._bench.skin.levels[self._bench.skin.time_ms % RING_MS] * FULL_COUNTS
        before = self._test.count if self._test else 0
        self._test = SelfTest(
            before % 255 + 1,
            int(Coverage.LINES | Coverage.OPEN_INPUTS | Coverage.SHORT_INPUTS | Coverage.TAXELS),
            silent=_mask(counts < SILENT_BELOW),
            full=_mask(counts > FULL_ABOVE),
        )
        self._answers.append(wire.encode_self_test(self._test))

    def _test_bits(self) -> int:
        done = wire.SelfTestBit.DONE if self._test else 0
        found = wire.SelfTestBit.FOUND if self._test and not self._test.passed else 0
        return done | found | (wire.SelfTestBit.RUNNING if self._test_due_us is not None else 0)

    def _identity(self) -> bytes:
        return wire.encode_identity(
            wire.TaxelIdentity(FIRMWARE_VERSION, BUILD_HASH, self._boots, self._cause)
        )

    def _status(self) -> wire.TaxelStatus:
        return wire.TaxelStatus(
            sample_counter=self._counter,
            frames_dropped=0,
            late_slots=0,
            longest_isr_cycles=0,
            supply_mv=SUPPLY_MV,
            reset_cause=self._cause,
            boot_count=self._boots,
            free_stack_bytes=FREE_STACK_BYTES,
            idle_permille=1000,
            sync_rises=self._rises_before,
            self_test_bits=self._test_bits(),
        )


def _mask(bad: NDArray[np.bool_]) -> int:
    """Bit *i* for reading *i*."""
    return sum(1 << int(reading) for reading in np.flatnonzero(bad))


@lru_cache(maxsize=1024)
def _repeated(value: int, count: int) -> NDArray[np.uint8]:
    """The same byte so many times; nobody writes to it."""
    return np.full(count, value, np.uint8)
