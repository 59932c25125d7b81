"""Sessions of the finger to data sets and a report, and what is left out or refused."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from rigctl.cli import main
from rigctl.encoder.force_gain import ForceScaling, divided
from rigctl.encoder.reading import Reading
from rigctl.errors import SessionError, WrongUse
from rigctl.finger import board_messages
from rigctl.finger.analysis.scans import (
    FingerDataSet,
    FingerEncoding,
    encode_readings,
    read_data_sets,
    read_scans,
    scan_set,
    training_info,
)
from rigctl.finger.analysis.settings import FingerAnalysisSettings
from rigctl.finger.analysis.tasks import DrawSettings, deployed_accuracy, run_finger_tasks
from rigctl.finger.published import DEPLOYED
from rigctl.finger.recorder import FingerRecorder
from rigctl.finger.values import ScanKind, Stage
from rigctl.session.sensor_passport import SensorPassport, TaxelResponse
from rigctl.values import Event
from tests.finger.analysis.made_scans import RANGES, made_recordings
from tests.finger.analysis.made_sessions import HEADER, PROTOCOL, with_ranges, write_session

FORCES_G = (100.0, 400.0, 1000.0)
COUNTED = SensorPassport(
    *("finger 1", "2030-01-01T00:00:00Z", "", True, Reading.COUNTS),
    FORCES_G,
    (0.02,) * 3,
    tuple(TaxelResponse(tuple(k * g**0.7 for g in FORCES_G), 100.0) for k in range(3, 12)),
)
FIRST = made_recordings({Stage.NORMALISE: 1, Stage.TRAIN: 2}, 2, contrast=0.015)
NEW = made_recordings({Stage.CALIBRATE: 1, Stage.RUN: 2}, 3, contrast=0.015)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A training session, and a new one with a torn and a rejected scan."""
    folder = tmp_path_factory.mktemp("finger")
    first = write_session(folder / "first", FIRST)
    return first, write_session(folder / "new", NEW, lost=(30,), rejected=(31,))


def test_a_session_gives_the_scans_that_were_recorded(sessions: tuple[Path, Path]) -> None:
    read = read_scans(sessions[0])
    trained = [one for one in FIRST if one.stage is Stage.TRAIN]
    expected = scan_set(str(sessions[0]), trained, RANGES, simulated=True)
    for field in fields(expected):
        ours, theirs = getattr(read.scans, field.name), getattr(expected, field.name)
        assert field.name == "gained" or np.array_equal(ours, theirs), field.name
    assert read.encoding.sensor == "finger 1" and read.encoding.reference_um_per_s == 100_000
    assert isinstance(read.encoding, FingerEncoding) and read.remarks == ()
    assert read.latencies["features"].shape == (75,)


def test_torn_and_rejected_scans_are_left_out_and_named(sessions: tuple[Path, Path]) -> None:
    read = read_scans(sessions[1])
    assert len(read.recordings) == len(NEW) - 2
    assert read.remarks == (
        f"{sessions[1]}: 1 scans with lost samples or batches were left out: 30",
    )


def test_every_gain_is_on_the_readings_whatever_gain_the_board_had(tmp_path: Path) -> None:
    trained = [one for one in FIRST if one.stage is Stage.TRAIN][:4]
    header = replace(HEADER, passport=COUNTED.to_values(), encoder_scaling=ForceScaling.DIVIDED)
    scans = read_scans(write_session(tmp_path / "one", trained, header)).scans
    assert scans.kinds == tuple(ScanKind)
    gains = {
        ScanKind.SPEED_SCALED: board_messages.NO_GAIN,
        ScanKind.SPEED_SCALED_DIVIDED: divided(RANGES),
        ScanKind.SPEED_SCALED_CALIBRATED: COUNTED.gain(RANGES),
    }
    for kind, gain in gains.items():
        spikes = [encode_readings(gain.apply(one.readings), RANGES) for one in trained]
        pairs = zip(trained, spikes, strict=True)
        again = [one._replace(spikes=raster) for one, raster in pairs]
        expected = scan_set("", again, RANGES, simulated=True)
        in_real_time = next(
            other
            for other in ScanKind
            if other.force_scaling == kind.force_scaling and not other.is_speed_scaled
        )
        for plain, found in ((ScanKind.SPEED_SCALED, kind), (ScanKind.ORIGINAL, in_real_time)):
            np.testing.assert_array_equal(scans.features(found), expected.features(plain))
            evidence = scans.evidence(found, 7), expected.evidence(plain, 7)
            np.testing.assert_array_equal(*evidence)
    few = scans.select(np.array([2, 0]))
    for kind in ScanKind:
        np.testing.assert_array_equal(few.features(kind), scans.features(kind)[[2, 0]])


def test_a_set_without_passports_has_no_calibrated_scans(
    sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    header = replace(HEADER, passport=COUNTED.to_values())
    carries = write_session(tmp_path / "first", FIRST, header)
    found = read_data_sets([carries, sessions[1]])
    assert found.data_sets[0].kinds == tuple(ScanKind)[:4]
    assert any(f"no passport of its sensor: {sessions[1]}" in text for text in found.remarks)
    with pytest.raises(WrongUse, match="has no Calibrated scans"):
        found.data_sets[0].tested.features(ScanKind.CALIBRATED)
    other = msgspec.structs.replace(COUNTED, reading=Reading.CONDUCTANCE)
    header = replace(HEADER, passport=other.to_values())
    read = read_scans(write_session(tmp_path / "conductance", FIRST, header))
    assert read.passport is None and "is of the conductance of 9 taxels" in read.remarks[0]


def test_training_info_names_the_session_by_its_content(sessions: tuple[Path, Path]) -> None:
    info = training_info(read_scans(sessions[0]), "2030-01-01T00:00:00Z")
    assert info.trials == 50 and info.simulated
    assert info.inputs[0]["path"] == str(sessions[0]) and len(info.inputs[0]["content"]) == 64


def test_the_command_writes_a_report(
    sessions: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "report"
    words = ["analyse", "--experiment", "realtime", *map(str, sessions), "--out", str(out)]
    assert main([*words, "--iterations", "2", "--no-cache"]) == 0
    printed = capsys.readouterr()
    values = json.loads((out / "results.json").read_text("utf-8"))
    assert values["settings"]["draws"] == 2 and len(values["data_sets"]) == 1
    assert values["data_sets"][0] == {
        "name": "set 1", "sessions": list(map(str, sessions)),
        "textures": ["A", "B", "D", "L", "N"], "trained": 50, "calibrated": 25, "tested": 48,
    }  # fmt: skip
    assert len(values["force_invariance"]) == 10, "four scalings and none, for both kinds"
    assert values["latencies"]["features"]["n"] == 150
    assert "Simulated: Fig. S5 real-time classifier, 25 components: Original" in printed.out
    assert f"report: {out / 'report.html'}" in printed.out
    assert "reading sessions: 0 of 2" in printed.err
    assert main(words) == 2, "the folder exists"


def test_sessions_are_paired_in_their_order(sessions: tuple[Path, Path], tmp_path: Path) -> None:
    others = [write_session(tmp_path / "second", FIRST), write_session(tmp_path / "later", NEW)]
    both = [sessions[0], *others, sessions[1]]
    pairs = [(one.training.session, one.tested.session) for one in read_data_sets(both).data_sets]
    assert pairs == [(str(sessions[0]), str(others[1])), (str(others[0]), str(sessions[1]))]


def test_a_calibration_of_its_own_belongs_to_the_run_after_it(
    sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    calibration, run = (
        write_session(tmp_path / stage, [one for one in NEW if one.stage is stage])
        for stage in (Stage.CALIBRATE, Stage.RUN)
    )
    (joined,) = read_data_sets([sessions[0], calibration, run]).data_sets
    (whole,) = read_data_sets(sessions).data_sets
    assert np.array_equal(joined.calibration.windows, whole.calibration.windows)
    assert len(joined.tested) == len([one for one in NEW if one.stage is Stage.RUN])
    with pytest.raises(WrongUse, match="name the calibration of each run"):
        read_data_sets([sessions[0], run])


def test_a_set_without_untrained_profiles_has_a_report_without_figure_4c(
    sessions: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trained = [one for one in NEW if one.profile in ("slow", "medium")]
    new = write_session(tmp_path / "two-profiles", trained)
    words = ["analyse", "--experiment", "realtime", str(sessions[0]), str(new)]
    assert main([*words, "--out", str(tmp_path / "r"), "--iterations", "2"]) == 0
    remark = "Figure 4C is left out: it tests the velocity profiles others than slow, medium"
    assert f"note: {remark}" in capsys.readouterr().out
    assert remark in (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
    names = {path.stem for path in (tmp_path / "r").iterdir()}
    assert "fig4c" not in names and {"fig4b", "figs5"} < names


def test_windows_and_reference_speed_are_those_of_the_analysis_file(
    sessions: tuple[Path, Path],
) -> None:
    settings = FingerAnalysisSettings(windows=30, reference_speed_mm_s=50.0)
    (found,) = read_data_sets(sessions, settings=settings).data_sets
    (paper,) = read_data_sets(sessions).data_sets
    assert found.tested.windows.shape[1] == 30 and paper.tested.windows.shape[1] == 20
    assert (found.tested.window_mm, paper.tested.window_mm) == (5.0, 10.0)
    # Two windows of 5 mm are one of 10 mm, but for the sample in which one ends.
    pairs = found.tested.real_ms[:, :30].reshape(-1, 15, 2).sum(axis=2)
    assert np.abs(pairs - paper.tested.real_ms[:, :15]).max() <= 1


def test_other_ranges_are_encoded_anew_with_those_of_training(
    sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    moved = write_session(tmp_path / "moved", NEW, with_ranges(100, 900))
    found = read_data_sets([sessions[0], moved])
    assert any("encoded anew" in remark for remark in found.remarks)
    tested = found.data_sets[0].tested
    one = next(one for one in NEW if one.stage is Stage.RUN)
    again = one._replace(spikes=encode_readings(one.readings, RANGES))
    expected = scan_set("one", [again], RANGES, simulated=True)
    assert np.array_equal(tested.windows[0], expected.windows[0])
    assert np.array_equal(tested.reading[0], expected.reading[0])


def test_one_session_with_all_stages_is_no_new_one(tmp_path: Path) -> None:
    whole = [*FIRST, *(one._replace(trial_id=one.trial_id + 100) for one in NEW)]
    path = write_session(tmp_path / "whole", whole)
    found = read_data_sets([path])
    assert any("trained and tested in one session" in remark for remark in found.remarks)


def test_sessions_that_do_not_match_are_refused(
    sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    first, new = sessions
    other = write_session(tmp_path / "sensor", NEW, replace(HEADER, sensor="finger 2"))
    with pytest.raises(WrongUse, match="sensor 'finger 2'"):
        read_data_sets([first, other])
    faster = write_session(tmp_path / "faster", NEW, replace(HEADER, reference_um_per_s=120_000))
    with pytest.raises(WrongUse, match="reference speed of 120 mm/s"):
        read_data_sets([first, faster])
    with pytest.raises(WrongUse, match="1 of the sessions have trials of the stage train and 0"):
        read_data_sets([first])
    with pytest.raises(WrongUse, match="is given twice"):
        read_data_sets([first, new, first])
    calibrated = [one for one in NEW if one.stage is Stage.CALIBRATE]
    with pytest.raises(
        WrongUse, match="1 of the sessions have scans of the stage calibrate only and 0 of run"
    ):
        read_data_sets([first, write_session(tmp_path / "calibrated", calibrated)])
    normalised = [one for one in FIRST if one.stage is Stage.NORMALISE]
    with pytest.raises(WrongUse, match="no complete scan to train"):
        read_scans(write_session(tmp_path / "normalised", normalised))
    with pytest.raises(SessionError):
        read_scans(tmp_path)


@pytest.mark.parametrize(
    "option", [["--task", "textures"], ["--sensitivity"], ["--k-max", "50"], ["--set", "a=1"]]
)
def test_options_of_the_drum_are_refused(
    option: list[str],
    sessions: tuple[Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["analyse", "--experiment", "realtime", *map(str, sessions)]
    assert main([*words, "--out", str(tmp_path / "out"), *option]) == 2
    assert f"{option[0]} belongs to the drum's analysis" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_both_readings_of_a_gap_are_offered_and_a_note_says_what_they_change(
    sessions: tuple[Path, Path],
) -> None:
    split, whole = (
        read_data_sets(sessions, settings=FingerAnalysisSettings(gaps=gaps))
        for gaps in ("split", "whole")
    )
    steady, changing = (
        [name in kind for name in split.data_sets[0].tested.profile.tolist()]
        for kind in (("slow", "medium", "fast"), ("slow-to-fast", "fast-to-slow"))
    )
    ours, theirs = (one.data_sets[0].tested.windows for one in (split, whole))
    assert (ours != theirs)[changing].any(axis=(1, 2)).all()
    assert np.array_equal(ours[steady], theirs[steady])
    (note,) = [text for text in split.remarks if "finger.gaps" in text]
    n = sum(len(read_scans(path).recordings) for path in sessions)
    beyond, of = int(note.split()[0]), int(note.split()[2])
    assert of == n and f"; {n - beyond} end inside a window" in note
    assert 0 < float(note.split("puts ")[1].split("%")[0]) < 50


def test_the_length_of_a_window_is_a_setting(sessions: tuple[Path, Path]) -> None:
    usual, fine = (
        read_data_sets(sessions, settings=FingerAnalysisSettings(windows=n, window_ms=ms))
        for n, ms in ((20, 100), (40, 50))
    )
    one, other = usual.data_sets[0].training, fine.data_sets[0].training
    assert (one.window_mm, other.window_mm, other.windows.shape[1]) == (10.0, 5.0, 40)
    whole = one.windows * one.real_ms[..., None]
    halves = other.windows * other.real_ms[..., None]
    np.testing.assert_allclose(halves[:, ::2] + halves[:, 1::2], whole, atol=1e-6)
    assert np.array_equal(other.n_time_windows // 2, one.n_time_windows)


def run_named_by(folder: Path, seed: int, kind: str) -> Path:
    """Write a run whose scans a model of one representation named."""
    recordings = made_recordings({Stage.RUN: 2}, seed, contrast=0.015)
    path = write_session(folder / f"run-{seed}", recordings)
    rows = [Event(0.0, "model", f"a model of {kind}", {"representation": kind})]
    with FingerRecorder(path, replace(HEADER, stages=("run",)), PROTOCOL, "", resume=True) as file:
        file.begin_part("resume")
        for row in rows:
            file.add_event(row)
    return path


def test_several_runs_after_one_calibration_are_tested_as_the_paper_did(
    sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    calibration = write_session(
        tmp_path / "calibration", made_recordings({Stage.CALIBRATE: 1}, 3, contrast=0.015)
    )
    runs = [
        run_named_by(tmp_path, 20 + number, kind)
        for number, kind in enumerate(("Speed Scaled", "Original", "Speed Scaled", "Original"))
    ]
    read = read_data_sets([sessions[0], calibration, *runs])
    (one,) = read.data_sets
    assert len(one.tested) == 4 * 50 and len(one.calibration) == 25
    assert any("runs after the calibration" in text for text in read.remarks)
    results, _ = run_finger_tasks([one], DrawSettings(1))
    deployed = next(result for result in results if result.task is DEPLOYED)
    assert deployed.n_of_runs == {ScanKind.ORIGINAL: 100, ScanKind.SPEED_SCALED: 100}
    assert not any(difference.assumptions for difference in deployed.differences())
    alone = FingerDataSet("set", one.training, one.calibration,
                          one.tested.select(one.tested.named_by == "Original"))  # fmt: skip
    expected = deployed_accuracy(alone, ScanKind.ORIGINAL, DrawSettings(1))
    np.testing.assert_array_equal(deployed.accuracy[ScanKind.ORIGINAL][0], expected)
    with pytest.raises(WrongUse, match="named before any calibration"):
        read_data_sets([sessions[0], *runs, calibration])


def test_runs_of_one_kind_are_tested_on_the_same_scans(sessions: tuple[Path, Path]) -> None:
    (one,) = read_data_sets(sessions).data_sets
    results, _ = run_finger_tasks([one], DrawSettings(1))
    deployed = next(result for result in results if result.task is DEPLOYED)
    assert deployed.n_of_runs == {} and deployed.differences()[0].assumptions
