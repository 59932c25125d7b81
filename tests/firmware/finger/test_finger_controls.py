"""The comparisons with the encoder fail on firmware that is broken on purpose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.encoder.force_gain import ForceScaling
from rigctl.finger import board_messages
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.decoder import FingerDecoder
from tests.firmware.broken import BROKEN
from tests.firmware.building import host_library
from tests.firmware.finger.scans import (
    GAINS,
    differing_trains,
    differing_windows,
    synthetic_scan,
    through_host_build,
)

SCANS = [synthetic_scan(number) for number in range(20)]


@pytest.fixture
def sent_by(tmp_path: Path) -> dict[str, bytes]:
    """Bytes that the good board and each broken one send."""
    sent = {}
    for name in ("", *BROKEN["finger"]):
        path = host_library("finger", name, tmp_path / f"{name}.so") if name else None
        board = FingerFirmware(path)
        sent[name] = through_host_build(SCANS, board)
        board.close()
    return sent


def test_state_in_single_precision_gives_other_spikes(sent_by: dict[str, bytes]) -> None:
    assert differing_trains(sent_by[""], SCANS) == 0
    assert differing_trains(sent_by["state-in-float"], SCANS) > 0


def test_distance_in_single_precision_gives_other_windows(sent_by: dict[str, bytes]) -> None:
    assert differing_windows(sent_by[""], SCANS) == 0
    assert differing_windows(sent_by["distance-in-float"], SCANS) > 0
    spikes = [FingerDecoder().feed(sent_by[name])[0].spikes for name in ("", "distance-in-float")]
    assert np.array_equal(*spikes)


def test_a_gain_that_is_not_interpolated_gives_other_spikes(tmp_path: Path) -> None:
    gain = GAINS[ForceScaling.DIVIDED]
    broken = host_library("finger", "gain-not-interpolated", tmp_path / "finger.so")
    for path, differs in ((None, False), (broken, True)):
        board = FingerFirmware(path)
        sent = through_host_build(SCANS[:5], board, board_messages.set_gain(gain))
        board.close()
        assert (differing_trains(sent, SCANS[:5], gain) > 0) is differs
