"""Representations and models whose SA current is scaled by the force that all taxels show."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.analysis.classify_sessions import classify
from rigctl.analysis.pca_lda import log_posteriors
from rigctl.analysis.representations import REPRESENTATIONS, RepresentationSet, represent
from rigctl.analysis.training import ModelRequest, train_model
from rigctl.analysis.trial_set import join_sessions, open_trials
from rigctl.cli import main
from rigctl.encoder.features import feature_matrices
from rigctl.encoder.force_gain import ForceScaling, divided
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT
from rigctl.encoder.reading import Reading
from rigctl.errors import ConfigError, SessionError, WrongUse
from rigctl.session.model_file import load_model, save_model
from rigctl.session.sensor_passport import load_passport, sensor_change
from rigctl.session.session import Session
from tests.analysis.recordings import record, sensor_passport

UTC = "2026-11-21T12:00:00Z"
BY_KEY = {one.key: one for one in REPRESENTATIONS}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("gains") / "session"
    return record(folder, "ABG", repeats=2, travel_mm=24.0, passport=sensor_passport())


@pytest.fixture(scope="module")
def made(session: Path, tmp_path_factory: pytest.TempPathFactory) -> RepresentationSet:
    return represent(join_sessions([session]), DEFAULT, tmp_path_factory.mktemp("features"))


@pytest.fixture(scope="module")
def model(made: RepresentationSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "calibrated.h5"
    save_model(train_model(made, ModelRequest(path, "Calibrated", 12), UTC, 7)[0], path)
    return path


def test_features_are_those_of_scaled_conductances(made: RepresentationSet) -> None:
    ranges, parameters = made.encoder(BY_KEY["calibrated"])
    assert parameters.reading is ranges.reading is Reading.CONDUCTANCE
    assert made.encoder(BY_KEY["original"]) == (made.normalisation, DEFAULT)
    trials = made.trials.as_conductances
    with open_trials(trials.files) as reader:
        readings = [reader.read(trial) for trial in trials.trials]
    speeds = [trial.speed_mm_s for trial in trials.trials]
    layouts = (made.unscaled, made.scaled)
    passport, n = sensor_passport(), len(readings)
    with Session.open(made.trials.paths[0]) as session:
        measured_g = session.trials["mean_force_g"][[trial.row for trial in trials.trials]]
    gains = {
        "divided": [divided(ranges)] * n,
        "calibrated": [passport.gain(ranges)] * n,
        "loadcell": [passport.gain_at(force_g, ranges) for force_g in measured_g.tolist()],
    }
    for key, of_trials in gains.items():
        expected = feature_matrices(readings, speeds, ranges, layouts, parameters, gains=of_trials)
        for name, features in zip((key, f"speed_{key}"), expected, strict=True):
            np.testing.assert_array_equal(made.features(BY_KEY[name]), features)
    assert BY_KEY["divided"].knows == "nothing" and "passport" in BY_KEY["calibrated"].knows
    assert "label" in BY_KEY["force"].knows and not BY_KEY["calibrated"].sees_labels


def test_an_import_without_wiring_is_divided_in_its_counts(tmp_path: Path) -> None:
    session = record(tmp_path / "session", "AB", travel_mm=12.0, rig="import")
    made = represent(join_sessions([session]), DEFAULT, tmp_path)
    assert made.encoder(BY_KEY["divided"])[1].reading is Reading.COUNTS
    assert "calibrated" not in made.files and "divided" in made.files
    given = represent(join_sessions([session]), DEFAULT, tmp_path, passport=sensor_passport())
    assert "calibrated" not in given.files
    assert any("gives the counts of 18" in remark for remark in given.remarks)


def test_each_session_has_the_gain_of_its_own_passport(session: Path, tmp_path: Path) -> None:
    carried = sensor_passport(gain=1.3)
    later = record(tmp_path / "later", "ABG", travel_mm=24.0, seed=8, passport=carried)
    made = represent(join_sessions([session, later]), DEFAULT, tmp_path)
    assert made.gained is not None
    ranges, trials = made.gained.normalisation, made.trials.trials
    of_session = sensor_passport().gain(ranges), carried.gain(ranges)
    assert of_session[0] != of_session[1]
    gains = made.gained.gains[ForceScaling.CALIBRATED]
    assert gains == tuple(of_session[trial.session] for trial in trials)


def test_the_load_cell_gives_one_gain_for_a_whole_trial(tmp_path: Path) -> None:
    high = np.full(18, 4095, np.uint16)
    ranges = Normalisation(np.zeros(18, np.uint16), high, reading=Reading.CONDUCTANCE)
    passport = sensor_passport()
    for force_g, row in ((250.0, 1), (500.0, 2), (1000.0, 3)):
        plate, aim = np.round(passport.curves[row : row + 1]).astype(np.uint16), passport.curves[2]
        gain = passport.gain_at(force_g, ranges)
        np.testing.assert_allclose(gain.apply(plate)[0], aim, rtol=0.01)
        half = gain.apply(plate // 2)[0]  # a texture that reads half as much stays at half
        np.testing.assert_allclose(half, aim / 2, rtol=0.01)
    unmeasured = record(tmp_path / "one", "AB", passport=passport, has_loadcell=False)
    made = represent(join_sessions([unmeasured]), DEFAULT, tmp_path)
    assert "calibrated" in made.files and "loadcell" not in made.files
    assert any("has no force of the load cell" in remark for remark in made.remarks)


def test_a_model_by_the_load_cell_classifies_by_the_force_of_each_trial(
    session: Path, made: RepresentationSet, tmp_path: Path
) -> None:
    path = tmp_path / "loadcell.h5"
    request = ModelRequest(path, "Load Cell", 12)
    save_model(train_model(made, request, UTC, 7)[0], path)
    read = load_model(path)
    found = classify(read, [session])
    best = log_posteriors(read, made.features(BY_KEY["loadcell"])).argmax(axis=1)
    assert [one.predicted for one in found.predictions] == [read.classes[i] for i in best]
    assert BY_KEY["loadcell"].knows == "load cell, the sensor's passport"


def test_a_calibrated_model_needs_a_passport(
    session: Path, made: RepresentationSet, model: Path, tmp_path: Path
) -> None:
    read = load_model(model)
    assert (read.force, read.c) == (ForceScaling.CALIBRATED, None)
    found = classify(read, [session])
    best = log_posteriors(read, made.features(BY_KEY["calibrated"])).argmax(axis=1)
    assert [one.predicted for one in found.predictions] == [read.classes[i] for i in best]
    bare = record(tmp_path / "bare", "ABG", travel_mm=24.0, seed=9)
    with pytest.raises(WrongUse, match="bare carries no passport of its sensor"):
        classify(read, [bare])
    file = tmp_path / "sensor.json"
    file.write_text(json.dumps(sensor_passport().to_values()))
    assert main(["classify", str(model), str(bare), "--passport", str(file)]) == 0


def test_a_model_says_by_how_much_the_sensor_changed(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    aged = record(tmp_path / "aged", "ABG", travel_mm=24.0, passport=sensor_passport(gain=1.2))
    assert main(["classify", str(model), str(aged)]) == 0
    text = capsys.readouterr().out
    assert "the model was trained on this sensor as it was on 2026-11-20: the same force" in text
    other = record(tmp_path / "other", "AB", travel_mm=24.0, passport=sensor_passport(1, "S2"))
    assert main(["classify", str(model), str(other)]) == 0
    assert "the model was trained on sensor S1, not S2" in capsys.readouterr().out
    same = record(tmp_path / "same", "AB", travel_mm=24.0, passport=sensor_passport(gain=1.01))
    assert main(["classify", str(model), str(same)]) == 0
    assert "WARNING" not in capsys.readouterr().out


def test_change_of_a_sensor_is_in_force_beyond_its_error() -> None:
    change = sensor_change(sensor_passport(), sensor_passport(gain=1.1))
    assert change.is_certain and 0.2 < change.force < 0.3  # readings rise with force ** 0.4
    assert change.factor == pytest.approx(1.0)
    assert not sensor_change(sensor_passport(), sensor_passport(gain=1.005)).is_certain


def test_a_wrong_passport_is_named(tmp_path: Path) -> None:
    file = tmp_path / "sensor.json"
    with pytest.raises(ConfigError, match=r"sensor\.json cannot be read"):
        load_passport(file, 18)
    values = sensor_passport().to_values()
    wrong = {
        "no passport of a sensor": {"force_g": [1.0]},
        "Expected `float` > 0": {**values, "taxels": [{"curve": [0.0] * 5, "span": 1.0}]},
        "do not rise": {**values, "force_g": values["force_g"][::-1]},
        "18 taxels, this one has 9": values,
    }
    for words, content in wrong.items():
        file.write_text(json.dumps(content))
        with pytest.raises(ConfigError, match=words):
            load_passport(file, 9)


def test_a_passport_of_another_sensor_gives_no_gain() -> None:
    with pytest.raises(WrongUse, match="of 18 taxels, these are 9"):
        sensor_passport().gain(Normalisation.full_scale(9, reading=Reading.CONDUCTANCE))


def test_a_session_or_a_model_with_a_damaged_passport_is_refused(
    model: Path, session: Path, tmp_path: Path
) -> None:
    copy = shutil.copytree(session, tmp_path / "copy")
    with h5py.File(copy / "part-0001.h5", "r+") as part:
        part.attrs["passport"] = np.bytes_(b'{"sensor": 3}')
    with pytest.raises(SessionError, match="its description"):
        join_sessions([copy])
    read = load_model(model)
    inputs = ({**read.training.inputs[0], "passport": {"force_g": "none"}},)
    damaged = replace(read, training=replace(read.training, inputs=inputs))
    with pytest.raises(SessionError, match="carries a passport of its sensor that cannot be used"):
        classify(damaged, [session])
