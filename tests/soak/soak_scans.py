"""Compare 500 scans of the moving finger. ``make scans`` runs it; it is not part of the suite."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from rigctl.finger.bench.firmware import FingerFirmware
from tests.finger.harness import ONE_SCAN, open_finger_harness, open_finger_session
from tests.firmware.building import built
from tests.firmware.finger.scans import (
    PROFILES,
    differing_trains,
    differing_windows,
    synthetic_scan,
    through_host_build,
    through_image,
)

RecordProperty = Callable[[str, object], None]
SCANS, AT_ONCE = 500, 50


def test_image_host_build_and_encoder_agree_in_500_scans(
    record_property: RecordProperty,
) -> None:
    built("firmware/finger.elf")
    longest, trains, windows = 0, 0, 0
    for first in range(0, SCANS, AT_ONCE):
        scans = [synthetic_scan(number, seed=17) for number in range(first, first + AT_ONCE)]
        board = FingerFirmware()
        sent = through_host_build(scans, board)
        board.close()
        image, count = through_image(scans)
        assert image == sent
        longest = max(longest, count.longest)
        trains += differing_trains(sent, scans)
        windows += differing_windows(sent, scans)
    record_property(
        "shown",
        f"{SCANS} scans of {len(PROFILES)} velocity profiles: {trains} of {9 * SCANS} spike trains "
        f"and {windows} windows differ; the longest sample takes {longest} instructions",
    )
    assert trains == windows == 0


def test_the_experiment_on_the_image_records_what_the_host_build_records(
    tmp_path: Path, record_property: RecordProperty
) -> None:
    built("firmware/finger.elf")
    spikes = {}
    for kind in ("virtual", "firmware"):
        with open_finger_harness(tmp_path / kind, kind=kind) as harness:
            harness.record(harness.request(protocol=ONE_SCAN))
            with open_finger_session(harness.session) as session:
                spikes[kind] = [session.spikes(i) for i in session.committed()]
    for host_build, image in zip(spikes["virtual"], spikes["firmware"], strict=True):
        assert np.array_equal(host_build, image)
    scans = len(spikes["firmware"])
    record_property("shown", f"{scans} scans of the experiment on the image equal the host build's")
