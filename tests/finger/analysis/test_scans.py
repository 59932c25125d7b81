"""Scans as arrays: both kinds of features, the evidence so far, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.encoder.encoder import Encoder
from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import WrongUse
from rigctl.finger.analysis.scans import (
    FingerDataSet,
    ScanRecording,
    encode_readings,
    mean_reading,
    scan_set,
)
from rigctl.finger.scaled_time import original_features, scale_windows, speed_scaled_features
from rigctl.finger.values import ScanKind, Stage
from tests.finger.analysis.made_scans import RANGES, made_recordings, made_scans

RECORDINGS = made_recordings({Stage.TRAIN: 1}, 5)
SCANS = scan_set("five", RECORDINGS, RANGES, simulated=True)


def test_features_are_those_of_each_scan_alone() -> None:
    for row, one in enumerate(RECORDINGS):
        windows = scale_windows(one.spikes, one.velocities_um_per_s)
        scaled = SCANS.features(ScanKind.SPEED_SCALED)[row]
        assert np.array_equal(scaled, speed_scaled_features(windows))
        original = SCANS.features(ScanKind.ORIGINAL)[row]
        assert np.array_equal(original, original_features(one.spikes))
        assert SCANS.real_ms[row].sum() <= len(one.spikes)


def test_original_evidence_slides_over_the_last_twenty_windows() -> None:
    row = int(SCANS.n_time_windows.argmax())
    one, n = RECORDINGS[row], int(SCANS.n_time_windows[row])
    assert n > 22
    for k in (3, 20, 22, n, n + 5):
        expected = original_features(one.spikes[: 100 * min(k, n)]).reshape(9, 20).T
        assert np.array_equal(SCANS.evidence(ScanKind.ORIGINAL, k)[row], expected)


def test_scaled_evidence_is_the_first_windows() -> None:
    seen = SCANS.evidence(ScanKind.SPEED_SCALED, 7)
    assert np.array_equal(seen[:, :7], SCANS.windows[:, :7]) and not seen[:, 7:].any()


def test_selected_scans_keep_their_labels_together() -> None:
    slow = SCANS.of_profiles(["slow"])
    assert len(slow) == 5 and set(slow.profile.tolist()) == {"slow"}
    assert slow.labels(("L", "A")).tolist() == [1, -1, -1, 0, -1]
    rows = np.flatnonzero(SCANS.profile == "slow")
    assert np.array_equal(slow.windows, SCANS.windows[rows])


def test_readings_are_encoded_like_the_host_does() -> None:
    readings = RECORDINGS[0].readings
    ranges = Normalisation.from_samples([readings], "test")
    expected = Encoder(ranges).encode(readings)[:, :9]
    assert np.array_equal(encode_readings(readings, ranges), expected)
    assert np.all((mean_reading(readings, ranges) > 0) & (mean_reading(readings, ranges) < 1))


def test_a_missing_stage_is_named() -> None:
    new = made_scans({Stage.RUN: 1}, 3)
    with pytest.raises(WrongUse, match="session 3 has no complete trials of the stage calibrate"):
        FingerDataSet.from_sessions("one", SCANS, new)


def test_sessions_with_other_textures_are_no_pair() -> None:
    recordings = made_recordings({Stage.CALIBRATE: 1, Stage.RUN: 1}, 4, textures=("A", "B"))
    new = scan_set("two plates", recordings, RANGES, simulated=True)
    with pytest.raises(WrongUse, match="two plates has the textures A, B"):
        FingerDataSet.from_sessions("one", SCANS, new)


def test_a_texture_that_a_stage_lacks_is_left_out_alone() -> None:
    later = made_recordings({Stage.CALIBRATE: 1, Stage.RUN: 1}, 4)
    lacking = [one for one in later if (one.stage, one.texture) != (Stage.CALIBRATE, "N")]
    new = scan_set("four plates", lacking, RANGES, simulated=True)
    found = FingerDataSet.from_sessions("set 1", SCANS, new)
    assert found.textures == found.tested.textures == ("A", "B", "D", "L")
    assert found.remarks == ("set 1: textures left out, which a stage lacks: N",)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"spikes": RECORDINGS[0].spikes[:-1]}, "trial 1: readings"),
        ({"velocities_um_per_s": RECORDINGS[0].velocities_um_per_s[1:]}, "as many velocities"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(
    change: dict[str, np.ndarray[tuple[int], np.dtype[np.int64]]], message: str
) -> None:
    broken: ScanRecording = RECORDINGS[0]._replace(**change)
    with pytest.raises(WrongUse, match=message):
        scan_set("broken", [broken], RANGES, simulated=True)
    with pytest.raises(WrongUse, match="no complete trials"):
        scan_set("empty", [], RANGES, simulated=True)
