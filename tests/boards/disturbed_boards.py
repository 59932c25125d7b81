"""Both boards that stream samples, disturbed on the wire, against the truth.

Every sample holds the number of its boot and its whole counter, so that what comes out of a
decoder shows what was sent.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.drum_registers import BOARD_TAXELS, MAGIC
from rigctl.boards.taxel_decoder import FrameDecoder
from rigctl.boards.taxel_frames import (
    WIRE_VERSION,
    TaxelIdentity,
    TaxelStatus,
    frame,
    frame_bytes,
)
from rigctl.finger.board_messages import BOARD_FINGER, DATA_TYPE
from rigctl.finger.decoder import FingerDecoder
from tests.boards import taxel_encoder
from tests.boards.disturbance import Disturbance, cut

FRAME_BYTES = frame_bytes(18)
EVERY = 100
"""Samples from one status to the next."""
QUIET = 2 * EVERY + 3
"""Frames with which a decoder joins."""
FIRST_BOOT = 65_533
"""Boot counts wrap, too."""


@dataclass(slots=True)
class Judgement:
    """What a decoder made of ``sent_bytes``, against the truth.

    ``lost`` are the samples between the first and the last of each boot that did not come out,
    ``counted`` those that the decoder reported. ``at_reboots``: samples lost around reboots, which
    are reported with them. ``intact``: samples whose frame arrived whole and not late.
    """

    name: str
    sent_bytes: int = 0
    frames: int = 0
    samples: int = 0
    intact: int = 0
    wrong_samples: int = 0
    wrong_counters: int = 0
    lost: int = 0
    counted: int = 0
    at_reboots: int = 0
    reboots: int = 0
    reboots_told: int = 0

    @property
    def holds(self) -> bool:
        """Return whether nothing is wrong and each loss and reboot is counted."""
        right = not (self.wrong_samples or self.wrong_counters)
        return right and self.lost == self.counted and self.reboots == self.reboots_told

    def __str__(self) -> str:
        return (
            f"{self.name:44}{self.sent_bytes:>11,}{self.frames:>9,}{self.samples:>9,}"
            f"{self.wrong_samples:>7,}{self.wrong_counters:>9,}{self.counted:>8,}/{self.lost:<8,}"
            f"{self.reboots_told:>3}/{self.reboots:<3}{self.at_reboots:>7,}"
        )


HEADING = (
    f"{'decoder, mixture':44}{'bytes':>11}{'frames':>9}{'samples':>9}{'wrong':>7}"
    f"{'counters':>9}{'losses':>8}/{'true':<8}{'re':>3}/{'true':<3}{'there':>6}"
)


def boots(n: int, length: int, first: int, rng: np.random.Generator) -> Iterator[range]:
    """Return the counters of each boot, ``n`` samples in all; the first began long before."""
    yield range(first, first + min(n, length))
    n -= length
    while n > 0:
        count = min(n, int(rng.integers(length // 2, length)))
        yield range(count)
        n -= count


def content(boot: int, counters: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return 8 numbers of 10 bits for each counter: the counter, the boot and a mixture of both."""
    mixed = (counters * 2_654_435_761 + boot * 40_503) & 0xFFFFFFFF
    parts = [counters >> shift & 1023 for shift in (0, 10, 20, 30)]
    parts += [counters * 0 + boot, *(mixed >> shift & 1023 for shift in (2, 12, 22))]
    return np.stack(parts, axis=1)


def judge(
    judgement: Judgement,
    numbers: NDArray[np.int64],
    counters: NDArray[np.int64],
    boot_told: NDArray[np.int64],
    sent: list[range],
) -> None:
    """Compare rows that came out, ``numbers`` int64 (n, 8), with what was sent in each boot."""
    true = sum(numbers[:, i] << 10 * i for i in range(4)) + np.zeros(len(numbers), np.int64)
    judgement.samples = len(numbers)
    for boot, range_sent in enumerate(sent):
        own = numbers[:, 4] == boot
        inside = (true[own] >= range_sent.start) & (true[own] < range_sent.stop)
        right = (numbers[own] == content(boot, true[own])).all(axis=1) & inside
        judgement.wrong_samples += int(np.sum(~right))
        wrong = (counters[own] != true[own]) | (boot_told[own] != boot)
        repeated = own.sum() - len(np.unique(true[own]))
        judgement.wrong_counters += int(np.sum(wrong)) + int(repeated)
        if own.any():
            span = int(true[own].max() - true[own].min()) + 1
            judgement.lost += span - int(own.sum())
            judgement.at_reboots += len(range_sent) - span
    judgement.wrong_samples += int(np.sum(numbers[:, 4] >= len(sent)))


def count_intact(arrived: list[bytes], sent: dict[bytes, int]) -> int:
    """Return how many data frames arrived whole and ahead of all before; ``sent``: their places."""
    newest, intact = -1, 0
    for place in (sent.get(data, -1) for data in arrived):
        if place > newest:
            newest, intact = place, intact + 1
    return intact


def taxel_frames(boot: int, counters: range) -> Iterator[bytes]:
    """Return the taxel board's frames: identity, data, a status after every 100 samples."""
    count = (FIRST_BOOT + boot) % 65_536
    identity = (MAGIC, WIRE_VERSION, BOARD_TAXELS, 0x0102, 0xDEADBEEF, 18, 1000, count, 2, 800, 20)
    yield taxel_encoder.encode_identity(TaxelIdentity(*identity))
    whole = np.arange(counters.start, counters.stop)
    samples = np.zeros((len(whole), 18), np.uint16)
    samples[:, :8] = content(boot, whole)
    flags = np.zeros(len(whole), np.uint8)
    data = taxel_encoder.encode_data(whole, samples, flags, flags)
    for i, counter in enumerate(counters):
        if counter % EVERY == 0:
            status = TaxelStatus(counter, 0, 1, 320, 5012, 2, count, 900, 480, 3, 8)
            yield taxel_encoder.encode_status(status)
        yield data[i * FRAME_BYTES : (i + 1) * FRAME_BYTES]


def finger_frames(boot: int, counters: range) -> Iterator[bytes]:
    """Return the finger board's frames: identity, data, a status with every 100th sample."""
    yield frame(struct.pack("<BHBBHIBHB", 0x30, MAGIC, 1, BOARD_FINGER, 0x0102, 7, 9, 1000, 100))
    whole = np.arange(counters.start, counters.stop)
    bits = content(boot, whole)[:, :, None] >> np.arange(10) & 1
    packed = np.packbits(bits.reshape(len(whole), -1).astype(np.uint8), axis=1, bitorder="little")
    for counter, row in zip(counters, packed, strict=True):
        low = (counter & 0xFFFF).to_bytes(2, "little")
        yield frame(bytes([DATA_TYPE]) + low + b"\0" + row.tobytes() + bytes(5))
        if counter % EVERY == EVERY - 1:
            yield frame(struct.pack("<BB7I", 0x32, 1, counter + 1, 0, 0, 0, 0, 0, 0))


def run_taxels(how: Disturbance, n_bytes: int, seed: int, boot_length: int) -> Judgement:
    """Decode about ``n_bytes`` of the taxel board's traffic and judge the samples."""
    rng = np.random.default_rng(seed)
    sent = list(boots(n_bytes // FRAME_BYTES, boot_length, 5_000_000, rng))
    frames = [data for boot, counters in enumerate(sent) for data in taxel_frames(boot, counters)]
    arrived = _joined(frames, how, rng)
    judgement = Judgement(f"taxels, {how.name}", reboots=len(sent) - 1)
    decoder = FrameDecoder(18)
    decoder.resync()
    decoded = [decoder.feed(piece, 0.0) for piece in cut(_noted(judgement, arrived), rng)]
    judgement.intact = count_intact(
        arrived, {data: i for i, data in enumerate(frames) if len(data) == FRAME_BYTES}
    )
    judgement.reboots_told = sum(part.reboots for part in decoded)
    blocks, boot = [], 0
    for part in decoded:
        # Of a slice with reboots, the block says which it is of: a boot may have sent no sample.
        blocks += [(b, int(b.samples[0, 4]) if part.reboots else boot) for b in part.blocks]
        boot += part.reboots
    judgement.counted = sum(gap.count for block, _ in blocks for gap in block.gaps)
    judge(
        judgement,
        np.concatenate([block.samples[:, :8] for block, _ in blocks]).astype(np.int64),
        np.concatenate([block.counters for block, _ in blocks]),
        np.concatenate([np.full(len(block), boot) for block, boot in blocks]),
        sent,
    )
    return judgement


def run_finger(how: Disturbance, n_bytes: int, seed: int, boot_length: int) -> Judgement:
    """Decode about ``n_bytes`` of the finger board's traffic and judge the samples."""
    rng = np.random.default_rng(seed)
    sent = list(boots(n_bytes // 26, boot_length, 5_000_000, rng))
    frames = [data for boot, counters in enumerate(sent) for data in finger_frames(boot, counters)]
    arrived = _joined(frames, how, rng)
    judgement = Judgement(f"finger, {how.name}", reboots=len(sent) - 1)
    decoder = FingerDecoder()
    decoder.resync()
    wire = _noted(judgement, arrived)
    joined = sum(map(len, arrived[:QUIET]))
    pieces = [(decoder.feed(wire[:joined])[0], 0)]
    decoder.connecting = False
    for piece in cut(wire[joined:], rng):
        block, _ = decoder.feed(piece)
        pieces.append((block, decoder.reboots))
    judgement.intact = count_intact(
        arrived, {data: i for i, data in enumerate(frames) if len(data) == 25}
    )
    judgement.reboots_told = decoder.reboots
    judgement.counted = sum(block.missing for block, _ in pieces)
    bits = np.concatenate([block.readings for block, _ in pieces]).astype(np.int64)
    judge(
        judgement,
        bits[:, :8],
        np.concatenate([block.counters for block, _ in pieces]),
        np.concatenate([np.full(len(block.counters), boot) for block, boot in pieces]),
        sent,
    )
    return judgement


def _joined(frames: list[bytes], how: Disturbance, rng: np.random.Generator) -> list[bytes]:
    """Disturb all but the first frames, with which a decoder joins, and the last."""
    return frames[:QUIET] + how.apply(frames[QUIET:-1], rng) + frames[-1:]


def _noted(judgement: Judgement, arrived: list[bytes]) -> bytes:
    judgement.frames = len(arrived)
    wire = b"".join(arrived)
    judgement.sent_bytes = len(wire)
    return wire
