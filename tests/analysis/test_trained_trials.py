"""A model says how many of the trials that it is asked about it was trained on."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import h5py
import pytest

from rigctl.analysis.classify_sessions import as_dict, as_text, classify, summary
from rigctl.analysis.representations import represent
from rigctl.analysis.training import ModelRequest, train_model
from rigctl.analysis.trial_set import join_sessions
from rigctl.cli import main
from rigctl.encoder.parameters import EncoderParameters
from rigctl.encoder.reading import Reading
from rigctl.errors import SessionError, WrongUse
from rigctl.session.model_file import load_model, save_model
from tests.analysis.recordings import record

UTC = "2026-11-21T12:00:00Z"


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Return a model, the session that it was trained on, and another one."""
    folder = tmp_path_factory.mktemp("trained")
    session = record(folder / "session", "ABG", repeats=3, travel_mm=24.0, speeds=(40, 80))
    other = record(folder / "other", "ABG", travel_mm=24.0, speeds=(40, 80), seed=9)
    features = folder / "features"
    features.mkdir()
    made = represent(join_sessions([session]), EncoderParameters(), features)
    path = folder / "model.h5"
    model, _ = train_model(made, ModelRequest(path, "Speed Scaled", 12), UTC, 7)
    save_model(model, path)
    return path, session, other


def test_a_model_does_not_report_its_own_trials_as_a_result(
    trained: tuple[Path, Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    model, session, _ = trained
    found = classify(load_model(model), [session])
    assert found.n_trained_on == found.n_scored == 36
    sentence = summary(found)
    assert sentence.startswith("Simulated: the model was trained on all 36 trials (36 right)")
    assert "says nothing about others" in sentence and "interval" not in sentence
    assert main(["classify", str(model), str(session)]) == 0
    assert sentence in capsys.readouterr().out
    answer = as_dict(found)
    assert answer["trained_on"] == 36 and answer["without_trained"]["asked"] == 0
    assert answer["without_trained"]["accuracy"] is None


def test_a_model_of_conductances_reads_them_and_knows_its_trials(
    trained: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    _, session, _ = trained
    (tmp_path / "features").mkdir()
    parameters = EncoderParameters(reading=Reading.CONDUCTANCE)
    with pytest.raises(WrongUse, match="are of counts"):
        represent(join_sessions([session]), parameters, tmp_path / "features")
    trials = join_sessions([session], reading=Reading.CONDUCTANCE)
    made = represent(trials, parameters, tmp_path / "features")
    path = tmp_path / "model.h5"
    model, _ = train_model(made, ModelRequest(path, "Speed Scaled", 12), UTC, 7)
    save_model(model, path)
    loaded = load_model(path)
    assert loaded.parameters.reading is loaded.normalisation.reading is Reading.CONDUCTANCE
    found = classify(loaded, [session])
    assert found.n_trained_on == found.n_scored == 36
    assert sum(p.right is True for p in found.predictions) > 30


def test_trials_are_known_in_a_copy_under_another_name(
    trained: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    model, session, other = trained
    copy = tmp_path / "renamed"
    shutil.copytree(session, copy)
    found = classify(load_model(model), [copy, other])
    assert found.n_scored == 48 and found.n_trained_on == 36
    right = sum(p.right is True for p in found.predictions if p.session == str(other))
    sentence = summary(found)
    assert f"{right} of 12 trials right (" in sentence
    assert "without the 36 that the model was trained on" in sentence
    answer = as_dict(found)
    assert answer["asked"] == 48 and answer["without_trained"]["asked"] == 12
    assert answer["without_trained"]["correct"] == right
    assert found.unseen.confusion.sum() == 12
    assert "the model was trained on it" in as_text(found)


def test_new_trials_are_said_to_be_new(trained: tuple[Path, Path, Path], tmp_path: Path) -> None:
    model, _, other = trained
    found = classify(load_model(model), [other])
    assert found.n_trained_on == 0 and "trained on none of them" in summary(found)
    out = tmp_path / "answers.csv"
    assert main(["classify", str(model), str(other), "--out", str(out)]) == 0
    with out.open() as file:
        assert {row["trained_on"] for row in csv.DictReader(file)} == {"no"}
    json.dumps(as_dict(found), allow_nan=False)


def test_a_model_without_a_list_of_its_trials_is_refused(
    trained: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    model, session, _ = trained
    older = tmp_path / "older.h5"
    shutil.copy(model, older)
    with h5py.File(older, "r+") as file:
        del file["training/trial_hashes"]
    with pytest.raises(WrongUse, match="of an older version"):
        classify(load_model(older), [session])


def test_a_damaged_list_of_trials_is_refused(
    trained: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    for name, values in (("text", b"none"), ("negative", [-1, 2])):
        path = tmp_path / f"{name}.h5"
        shutil.copy(trained[0], path)
        with h5py.File(path, "r+") as file:
            del file["training/trial_hashes"]
            file["training/trial_hashes"] = values
        with pytest.raises(SessionError, match="trial_hashes"):
            load_model(path)
