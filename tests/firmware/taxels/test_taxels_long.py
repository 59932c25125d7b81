"""None of a hundred thousand frames is lost or late, with edges, requests and self-tests."""

from __future__ import annotations

from rigctl.bench.chips.simavr import Input
from rigctl.boards.taxel_frames import IDENTIFY, SELF_TEST, encode_request
from tests.firmware.taxels.chip import TaxelChip

FRAMES = 100_000
SLICE_FRAMES = 20
EVERY_SLICES = 50


def test_no_frame_of_a_hundred_thousand_is_lost() -> None:
    requests = 0
    with TaxelChip() as board:
        board.x.report_samples = 0
        while board.x.cycle // 16_000 < FRAMES + 10:
            if requests < board.x.cycle // 16_000 // (SLICE_FRAMES * EVERY_SLICES):
                requests += 1
                board.chip.send(encode_request(IDENTIFY) + encode_request(SELF_TEST))
                for i, signal in enumerate((Input.SYNC, Input.INDEX, Input.SYNC, Input.INDEX)):
                    board.edge(signal, 1 - i // 2, board.x.cycle + 70_001 * (i + 1))
            board.run_slice(SLICE_FRAMES)
        board.run(200)  # until a status counts the last edges
        blocks = board.blocks
        frames = sum(len(block) for block in blocks)
        assert blocks[0].counters[0] == 0
        assert frames == blocks[-1].counters[-1] + 1 >= FRAMES
        assert not any(block.gaps for block in blocks)
        assert not any((block.flags > 3).any() for block in blocks)  # only sync and index
        status = board.statuses[-1]
        assert status.frames_dropped == status.late_slots == board.rejected == 0
        assert status.sync_rises == requests
        assert len(board.identities) == requests + 1
        assert board.x.resets == board.x.overflows == board.x.rx_overruns == 0
