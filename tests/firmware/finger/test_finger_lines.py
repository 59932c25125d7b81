"""The image under QEMU, linked over its two serial lines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from rigctl.bench.boards.taxels import TaxelFirmware
from rigctl.finger import board_messages
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.bench.qemu import FingerImage
from rigctl.finger.board_messages import BATCH_SAMPLES, BatchReport, ScanEnded, VelocitySource
from rigctl.finger.decoder import FingerDecoder
from tests.firmware.building import built
from tests.firmware.finger.scans import SETTINGS, SyntheticScan, synthetic_scan

# The readings of the taxel board that are the finger's taxels (arduino/finger/board.h).
TOP_LAYER = [0, 1, 2, 6, 7, 8, 12, 13, 14]


@pytest.fixture
def host_build() -> Iterator[FingerFirmware]:
    board = FingerFirmware()
    board.boot(0)
    yield board
    board.close()


class TwoBuilds:
    """Passes the same bytes to the host build and to the image and compares what they send."""

    def __init__(self, host_build: FingerFirmware, image: FingerImage) -> None:
        self._boards = (host_build, image)
        self.sent = b""

    def receive(self, data: bytes) -> None:
        for board in self._boards:
            board.receive(data)
        self._compare()

    def receive_taxels(self, data: bytes) -> None:
        for board in self._boards:
            board.receive_taxels(data)
        self._compare()

    def _compare(self) -> None:
        host_build, image = self._boards
        expected = host_build.take_sent()
        assert image.read(len(expected)) == expected
        self.sent += expected


def taxel_frames(scan: SyntheticScan) -> list[bytes]:
    """Return the taxel board's own frames of a scan, a batch in each piece."""
    board = TaxelFirmware()
    board.boot(0)
    board.take_sent()
    readings = np.zeros((len(scan.readings), board.lines * board.inputs), np.uint16)
    readings[:, TOP_LAYER] = scan.readings
    pieces = []
    for at in range(0, len(readings), BATCH_SAMPLES):
        board.run(readings[at : at + BATCH_SAMPLES])
        pieces.append(board.take_sent())
    board.close()
    return pieces


@pytest.mark.parametrize("number", [2, 3, 4])
def test_a_scan_over_the_lines_equals_the_host_build(
    number: int, host_build: FingerFirmware
) -> None:
    built("firmware/finger.elf")
    scan = synthetic_scan(number)
    with FingerImage() as image:
        boards = TwoBuilds(host_build, image)
        boards.receive(SETTINGS)
        boards.receive(board_messages.start(scan.number))
        for batch, piece in enumerate(taxel_frames(scan)):
            boards.receive_taxels(piece)
            if len(scan.readings) < (batch + 1) * BATCH_SAMPLES:
                boards.receive(board_messages.stop(scan.number))
            velocity = scan.velocities_um_per_s[batch]
            boards.receive(board_messages.velocity(scan.number, batch, velocity))
    block, decoded = FingerDecoder().feed(boards.sent)
    assert np.array_equal(block.readings, scan.readings)
    assert isinstance(decoded[-2], ScanEnded)
    batches = [message for message in decoded if isinstance(message, BatchReport)]
    assert {batch.source for batch in batches} == {VelocitySource.RECEIVED}
    assert [batch.velocity_um_per_s for batch in batches] == scan.velocities_um_per_s
