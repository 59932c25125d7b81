"""A session of the moving finger returns what was recorded, and no other experiment's reader
takes it."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.cli import create_parser, info, main
from rigctl.config.rig_config import RecordingConfig
from rigctl.errors import SessionError, WrongUse
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.layout import FINGER_LAYOUT, PREDICTIONS, prediction_row, spike_counts
from rigctl.finger.recorder import FingerRecorder, find_gaps
from rigctl.finger.scaled_time import scale_windows
from rigctl.finger.session import FingerSession
from rigctl.finger.values import PredictionRow
from rigctl.session.layout import DRUM_LAYOUT
from rigctl.session.part import session_layout
from rigctl.session.recorder import Recorder
from rigctl.session.session import Session
from rigctl.values import Event, Gap, Verdict
from tests.finger.finger_building import (
    HIGH,
    LOW,
    PROTOCOL,
    RIG,
    SCAN_MS,
    VELOCITIES_UM_S,
    SyntheticFinger,
    header,
    plan,
    recorder,
)
from tests.finger.harness import ONE_SCAN, FingerHarness
from tests.session import building


@pytest.fixture
def recorded(finger: Path) -> Path:
    return finger


def test_all_recorded_data_is_read_back(recorded: Path) -> None:
    with FingerSession.open(recorded) as session:
        assert session.finished
        assert session.header == replace(header(), experiment="finger")
        assert session.protocol_text == PROTOCOL
        assert len(session.committed()) == len(plan().trials)
        assert session.latencies["ms"].tolist() == [1.5] * 5 * len(plan().trials)
        for index, trial in enumerate(plan().trials):
            row = session.trial_row(index)
            assert (row.trial_id, row.stage, row.texture) == (
                trial.trial_id,
                trial.stage,
                trial.texture,
            )
            assert row.correct is (True if trial.stage == "run" else None)
            assert session.samples(index).shape == session.spikes(index).shape == (SCAN_MS, 9)
            assert session.spikes(index).any()
            assert session.velocities_um_s(index).tolist() == list(VELOCITIES_UM_S)
            track = session.track(index)
            assert row.started_s <= track["at_s"][0] < track["at_s"][-1] <= row.ended_s
            answers = session.predictions(index)
            assert [answer.decided for answer in answers] == [False, False, True, True, True]
            assert answers[-1].is_final
            assert answers[0].probabilities == {trial.texture: 0.75, "other": 0.25}
            assert answers[0].texture_set == (trial.texture,)
            ranges = session.normalisation(index)
            assert (tuple(ranges.low), tuple(ranges.high)) == (LOW, HIGH)


def test_windows_are_the_scaled_spikes(finger: Path) -> None:
    with FingerSession.open(finger) as session:
        windows = session.windows(2)
        scaled = scale_windows(session.scan_spikes(2), session.velocities_um_s(2))
        assert np.array_equal(spike_counts(windows), scaled.counts)
        assert np.array_equal(windows["real_ms"], scaled.real_ms)


def test_arrivals_that_are_no_numbers_are_refused(finger: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(finger, tmp_path / "s"))
    with h5py.File(folder / "part-0001.h5", "r+") as file:
        rows = file["/taxels/arrivals"][:]
        rows["arrived_s"] = np.nan
        file["/taxels/arrivals"][:] = rows
    with (
        FingerSession.open(folder) as session,
        pytest.raises(SessionError, match="arrived_s of /taxels/arrivals is no number"),
    ):
        session.scan_start_s(0)


def test_info_prints_the_experiments_numbers(
    finger: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = create_parser(["info"])
    assert info.run(parser.parse_args(["info", str(finger), "--json"])) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["experiment"] == "finger"
    assert answer["committed_by_stage"] == {"train": 4, "run": 4}
    assert (answer["classified"], answer["right"]) == (4, 4)
    assert (answer["batches"], answer["batches_without_velocity"]) == (40, 0)
    assert answer["latency_p99_ms"] == {"features": 1.5}
    assert info.run(parser.parse_args(["info", str(finger)])) == 0
    assert "reference mm s" in capsys.readouterr().out


def test_a_resumed_session_keeps_its_ranges_in_each_part(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    wide = replace(header(), taxel_low=(), taxel_high=())
    with FingerRecorder(folder, wide, PROTOCOL, RIG) as rec:
        rec.begin_part("start")
        rec.add_event(Event(0.5, "log", "No range is known."))
        rec.begin_part("ranges are set", header=header())
        with SyntheticFinger(rec) as finger:
            finger.trial(plan().trials[0], Verdict.REJECTED)
            finger.trial(plan().trials[0], attempt=2)
    with FingerSession.open(folder) as session:
        assert [part.header.taxel_low for part in session.parts] == [(), LOW]
        assert session.trial_row(0).reasons == ("the finger was lifted", "too fast")
        assert session.committed().tolist() == [1]
        assert len(session.windows(0)) > 0
        assert session.events[0].text == "No range is known."


def test_a_reader_follows_a_growing_session(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec, SyntheticFinger(rec) as finger:
        rec.begin_part("start")
        rec.wait_written()
        with FingerSession.open(tmp_path / "s") as session:
            for trial in plan().trials[:3]:
                finger.trial(trial)
                rec.wait_written()
                session.refresh()
                assert len(session.spikes(trial.trial_id - 1)) == SCAN_MS


def test_another_reference_speed_or_plan_is_not_resumed(finger: Path) -> None:
    with pytest.raises(SessionError, match="has a reference speed of 100000 µm/s, not of 80000"):
        FingerRecorder(
            finger, replace(header(), reference_um_per_s=80_000), PROTOCOL, RIG, resume=True
        )
    with pytest.raises(SessionError, match="another protocol or seed"):
        FingerRecorder(finger, replace(header(), plan_hash="0"), PROTOCOL, RIG, resume=True)
    with pytest.raises(WrongUse, match="needs the reference speed"):
        FingerRecorder(finger, replace(header(), reference_um_per_s=0), PROTOCOL, RIG)


def test_each_experiment_refuses_the_others_sessions(finger: Path, drum: Path) -> None:
    assert session_layout(finger) is FINGER_LAYOUT
    assert session_layout(drum) is DRUM_LAYOUT
    with pytest.raises(SessionError, match=r"is a session of the moving finger, not of the drum: "):
        Session.open(finger)
    with pytest.raises(SessionError, match=r"is a session of the drum, not of the moving finger: "):
        FingerSession.open(drum)
    with pytest.raises(SessionError, match="is a session of the moving finger"):
        Recorder(finger, building.header(), building.PROTOCOL, building.RIG, resume=True)
    with pytest.raises(SessionError, match="is a session of the drum"):
        recorder(drum, resume=True)


@pytest.mark.parametrize(
    "words",
    [
        ["analyse", "{}", "--out", "{}/out"],
        ["encode", "{}", "--out", "{}/spikes.h5"],
        ["run", "--resume", "{}"],
        ["world", "{}"],
    ],
    ids=lambda words: words[0],
)
def test_the_drums_commands_name_a_session_of_the_finger(
    finger: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(file.name for file in finger.iterdir())
    assert main([word.format(finger) for word in words]) == 2
    assert "is a session of the moving finger, not of the drum" in capsys.readouterr().err
    assert sorted(file.name for file in finger.iterdir()) == before


def test_parts_of_the_drum_have_no_attribute_of_the_finger(drum: Path) -> None:
    with Session.open(drum) as session:
        names = {"experiment", "reference_um_per_s", "stages", "tracker"}
        assert not names & session.parts[0].attributes.keys()


def block(*counters: int, flags: tuple[int, ...] = ()) -> FingerBlock:
    n = len(counters)
    marks = np.array(flags or (0,) * n, np.uint8)
    readings, spikes = np.zeros((n, 9), np.uint16), np.zeros((n, 9), np.uint8)
    return FingerBlock(np.array(counters, np.int64), marks, readings, spikes, 0)


def test_gaps_say_on_which_side_of_the_board_samples_were_lost() -> None:
    lost, missed = "lost before the finger board", "lost on the finger board's line"
    assert find_gaps(block(5, 6), None) == ()
    assert find_gaps(block(5, 6), 5) == ()
    assert find_gaps(block(7, 8, 12, flags=(0, 0, 4)), 5) == (Gap(5, 2, missed), Gap(9, 3, lost))
    assert find_gaps(block(0, 3), 500) == (Gap(1, 2, missed),), "the board restarted"


def test_a_board_that_restarts_begins_a_new_part(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start")
        rec.add_samples(block(500, 501), 0.0)
        rec.add_samples(block(0, 1), 1.0)
    with FingerSession.open(tmp_path / "s") as session:
        assert session.parts[1].attributes["reason"] == "the finger board restarted"
        assert session.n_samples == 4


def test_probabilities_that_do_not_fit_are_left_out_from_the_smallest() -> None:
    names = [f"{letter}{'ö' * 7}" for letter in "ABCDEFG"]
    probabilities = {name: 0.1 + i / 100 for i, name in enumerate(names)}
    flags = {"known": False, "decided": True, "is_final": False}
    values = PredictionRow(1, 0.0, 3, 30.0, 0.3, "A", probabilities, tuple(names), **flags)
    stored = np.array([prediction_row(values)], PREDICTIONS.dtype)
    text = stored["probabilities"][0].decode()
    assert list(json.loads(text)) == names[::-1][: len(json.loads(text))]
    assert 4 <= len(json.loads(text)) < 7


def test_a_private_finger_session_is_the_users_alone(harness: FingerHarness) -> None:
    harness.rig.config = replace(harness.rig.config, recording=RecordingConfig(private=True))
    before = os.umask(0o022)
    try:
        harness.record(harness.request(protocol=ONE_SCAN))
    finally:
        os.umask(before)
    assert harness.session.stat().st_mode & 0o777 == 0o700
    modes = {path.name: path.stat().st_mode & 0o777 for path in harness.session.iterdir()}
    assert "part-0001.h5" in modes
    assert set(modes.values()) == {0o600}
