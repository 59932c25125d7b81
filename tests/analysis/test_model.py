"""A saved model predicts as it did when it was trained, or refuses with a reason."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.analysis.classify_sessions import classify
from rigctl.analysis.force_scaling import load_c
from rigctl.analysis.pca_lda import log_posteriors
from rigctl.analysis.representations import REPRESENTATIONS, RepresentationSet, represent
from rigctl.analysis.training import ModelRequest, train_model
from rigctl.analysis.trial_set import Design, join_sessions
from rigctl.cli import main
from rigctl.encoder.parameters import EncoderParameters
from rigctl.errors import SessionError, WrongUse
from rigctl.session.analysis_file import LAYOUT_VERSION
from rigctl.session.hdf5_file import write_text
from rigctl.session.model_file import load_model, save_model
from tests.analysis.recordings import record, sensor_passport
from tests.session.forging import rewrite_digests

UTC = "2026-11-21T12:00:00Z"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("model") / "session"
    carried = sensor_passport()
    return record(folder, "ABG", repeats=3, travel_mm=24.0, speeds=(40, 80), passport=carried)


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another day: other noise, one texture more, a torn trial."""
    folder = tmp_path_factory.mktemp("model") / "other"
    return record(folder, "ABGX", travel_mm=24.0, speeds=(40, 80), seed=9, torn=(3,))


@pytest.fixture(scope="module")
def made(session: Path, tmp_path_factory: pytest.TempPathFactory) -> RepresentationSet:
    folder = tmp_path_factory.mktemp("features")
    return represent(join_sessions([session]), EncoderParameters(), folder)


def saved(made: RepresentationSet, path: Path, representation: str, components: int = 12) -> Path:
    model, _ = train_model(made, ModelRequest(path, representation, components), UTC, 7)
    save_model(model, path)
    return path


@pytest.mark.parametrize("key", [r.key for r in REPRESENTATIONS])
def test_a_loaded_model_predicts_bit_for_bit(
    made: RepresentationSet, tmp_path: Path, key: str
) -> None:
    model, _ = train_model(made, ModelRequest(tmp_path / "m.h5", key, 12), UTC, 7)
    save_model(model, tmp_path / "m.h5")
    read = load_model(tmp_path / "m.h5")
    (representation,) = (r for r in REPRESENTATIONS if r.key == key)
    features = made.features(representation)
    before, after = log_posteriors(model, features), log_posteriors(read, features)
    assert before.tobytes() == after.tobytes()
    assert log_posteriors(read, features[5:6]).tobytes() == after[5:6].tobytes()
    assert read.parameters == model.parameters and read.training == model.training
    assert read.training.seed == 7 and read.training.made_utc == UTC
    np.testing.assert_allclose(np.exp(after).sum(axis=1), 1.0)


def test_posteriors_equal_those_of_scikit_learn(made: RepresentationSet, tmp_path: Path) -> None:
    from sklearn.decomposition import PCA
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

    from rigctl.analysis.pca_lda import ScaledCovariance

    labels = Design.from_trials(made.trials).texture
    for representation in REPRESENTATIONS[:4]:
        model, _ = train_model(made, ModelRequest(tmp_path / "m", representation.key, 12), UTC, 0)
        features = np.asarray(made.features(representation))
        scores = PCA(12, svd_solver="full").fit(features)
        pooled = ScaledCovariance(len(labels) / (len(labels) - 3))
        lda = LinearDiscriminantAnalysis(solver="lsqr", covariance_estimator=pooled)
        lda.fit(scores.transform(features), labels)
        new = features + np.random.default_rng(1).normal(0, 20, features.shape)
        ours = log_posteriors(model, new)
        theirs = lda.predict_proba(scores.transform(new))
        np.testing.assert_array_equal(ours.argmax(axis=1), theirs.argmax(axis=1))
        np.testing.assert_allclose(np.exp(ours), theirs, atol=1e-8)


def test_a_model_file_predicts_without_rigctl(made: RepresentationSet, tmp_path: Path) -> None:
    path = saved(made, tmp_path / "m.h5", "Speed Scaled")
    features = np.asarray(made.features(REPRESENTATIONS[1]))
    with h5py.File(path) as f:
        pca, lda = f["pca"], f["lda"]
        scores = (features - pca["mean"][:]) @ pca["axes"][:]
        white = np.linalg.solve(lda["factor"][:], scores.T).T
        means = lda["whitened_means"][:]
        by_hand = white @ means - 0.5 * (means**2).sum(axis=0) + lda["log_priors"][:]
        named = {name: f["encoder"][name][()] for name in EncoderParameters().as_dict()}
        assert named["sa_gain"] == 100.0 and f["encoder/sa_gain"].attrs["unit"] == b"mV/ms"

        def check(name: str, node: Any) -> None:
            if isinstance(node, h5py.Dataset):
                assert {"doc", "shape"} <= set(node.attrs), name

        f.visititems(check)
    ours = log_posteriors(load_model(path), features)
    np.testing.assert_array_equal(by_hand.argmax(axis=1), ours.argmax(axis=1))


def test_another_session_is_classified_with_all_remarks(
    made: RepresentationSet, other: Path, tmp_path: Path
) -> None:
    model = load_model(saved(made, tmp_path / "m.h5", "Speed Scaled"))
    found = classify(model, [other])
    assert len(found.predictions) == 15  # one of sixteen is torn
    assert found.n_scored == 11 and found.n_correct >= 10
    assert {p.right for p in found.predictions if p.texture == "X"} == {None}
    assert all(0 < p.posterior <= 1 and p.margin >= 0 for p in found.predictions)
    remarks = "\n".join(found.remarks)
    assert "the model's taxel ranges" in remarks and "are outside and are clipped" in remarks
    assert "1 trial left out for gaps in their samples: 3" in remarks
    assert "textures that are not in the model (X)" in remarks
    assert "WARNING" not in remarks and found.rate_errors == ()


def test_c_of_another_session_gives_a_warning_with_its_rate_error(
    made: RepresentationSet, session: Path, other: Path, tmp_path: Path
) -> None:
    model = load_model(saved(made, tmp_path / "m.h5", "Speed and Force Scaled, texture-blind"))
    at_home = classify(model, [session])
    assert at_home.rate_errors == () and not any("WARNING" in r for r in at_home.remarks)
    found = classify(model, [other])
    assert "any change of the sensor voids it" in found.remarks[0]
    assert [(m.speed_mm_s, m.force_g) for m in found.rate_errors] == [(40.0, 250.0), (80.0, 250.0)]
    for miss in found.rate_errors:
        assert 0 < miss.with_c_hz < miss.without_c_hz
        assert f"{miss.with_c_hz:.2f} Hz with C" in found.remarks[0]
    own = load_model(saved(made, tmp_path / "own.h5", "Force Scaled"))
    remarks = "\n".join(classify(own, [other]).remarks)
    assert re.search(r"such as .*other: trial \d+ has texture 'X', C is for A, B, G", remarks)


def test_sessions_that_do_not_fit_are_refused_with_a_reason(
    made: RepresentationSet, session: Path, tmp_path: Path
) -> None:
    speed = load_model(saved(made, tmp_path / "speed.h5", "Speed Scaled"))
    blind = load_model(saved(made, tmp_path / "blind.h5", "Force Scaled, texture-blind"))
    fast = record(tmp_path / "fast", "AB", travel_mm=24.0, speeds=(120,))
    with pytest.raises(WrongUse, match=r"fast: trial 1 was made at 120 mm/s, C at 40, 80 mm/s"):
        classify(blind, [fast])
    assert any("no trial at 120 mm/s" in r for r in classify(speed, [fast]).remarks)
    heavy = record(tmp_path / "heavy", "AB", travel_mm=24.0, speeds=(40,), forces=(500, 900))
    found = classify(blind, [heavy])
    assert {one.force_g for one in found.predictions} == {500.0}
    sentence = r"2 of 4 trials left out, which C cannot scale, such as .*heavy: trial \d+ was"
    assert any(re.match(sentence, remark) for remark in found.remarks)
    narrow = imported(tmp_path, 3)
    with pytest.raises(SessionError, match="has 3 taxels, the model was trained with 18"):
        classify(speed, [narrow])
    slower = tmp_path / "slower"
    shutil.copytree(session, slower)
    for part in slower.glob("part-*.h5"):
        with h5py.File(part, "r+") as file:
            file.attrs["sample_rate_hz"] = 500
    rewrite_digests(slower)
    with pytest.raises(SessionError, match=r"has 500 samples a second, the model .* with 1000"):
        classify(speed, [slower])


def test_readings_on_another_scale_are_refused(made: RepresentationSet, tmp_path: Path) -> None:
    model, _ = train_model(made, ModelRequest(tmp_path / "m.h5", "Speed Scaled", 4), UTC, 0)
    foreign = imported(tmp_path, 18, scale=0.1)
    with pytest.raises(SessionError, match=f"{foreign} stores readings on another scale"):
        classify(model, [foreign])


def imported(folder: Path, n_taxels: int, scale: float = 1.0) -> Path:
    """Import a session of another sensor."""
    np.save(folder / "A_1.npy", scale * np.arange(60 * n_taxels).reshape(60, n_taxels))
    columns = ", ".join(f'"{i + 1}"' for i in range(n_taxels))
    (folder / "map.toml").write_text(
        "[files]\npattern = '(?P<texture>[A-Z])_'\n[labels]\nspeed_mm_s = 40\n"
        f"[time]\nrate_hz = 1000\n[taxels]\ncolumns = [{columns}]\n"
    )
    words = ["import", "--map", str(folder / "map.toml"), str(folder / "A_1.npy")]
    assert main([*words, "--out", str(folder / "narrow")]) == 0
    return folder / "narrow"


def test_invalid_model_files_are_refused_with_a_reason(
    made: RepresentationSet, tmp_path: Path
) -> None:
    good = saved(made, tmp_path / "good.h5", "Speed Scaled")
    with pytest.raises(SessionError, match="No such file"):
        load_model(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("not HDF5")
    with pytest.raises(
        SessionError, match=r"text\.h5 is damaged: HDF5 cannot read it: .* --save-model"
    ):
        load_model(tmp_path / "text.h5")
    with h5py.File(tmp_path / "else.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(SessionError, match="an HDF5 file, but not a model"):
        load_model(tmp_path / "else.h5")

    def changed(name: str, change: Any) -> Path:
        path = tmp_path / f"{name}.h5"
        shutil.copy(good, path)
        with h5py.File(path, "r+") as file:
            change(file)
        return path

    def newer(file: Any) -> None:
        file.attrs["layout_version"] = LAYOUT_VERSION + 1

    def lacking(file: Any) -> None:
        del file["pca/axes"]

    def holed(file: Any) -> None:
        file["lda/factor"][0, 0] = np.nan

    def unknown(file: Any) -> None:
        del file["encoder/reset"]
        write_text(file["encoder"], "reset", "never", "")

    for name, change, message in (
        ("newer", newer, f"layout version {LAYOUT_VERSION + 1}, this program reads"),
        ("lacking", lacking, "is damaged: pca/axes is missing"),
        ("holed", holed, r"factor should be \(12, 12\) finite numbers"),
        ("unknown", unknown, "encoder parameter reset is 'never'"),
    ):
        with pytest.raises(SessionError, match=message):
            load_model(changed(name, change))
    size = good.stat().st_size
    for part in range(1, 10):
        cut = tmp_path / f"cut{part}.h5"
        cut.write_bytes(good.read_bytes()[: size * part // 10])
        with pytest.raises(SessionError, match=f"cut{part}"):
            load_model(cut)


def test_the_commands_train_save_and_classify(
    session: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, report = tmp_path / "model.h5", tmp_path / "report"
    words = ["analyse", str(session), "--out", str(report), "--iterations", "1", "--k-max", "3"]
    assert main([*words, "--representation", "Original"]) == 2
    assert "--save-model" in capsys.readouterr().err
    assert main([*words, "--save-model", str(model), "--representation", "colour"]) == 2
    assert "choose one of 'Original'" in capsys.readouterr().err
    blind = "Speed and Force Scaled, texture-blind"
    words += ["--save-model", str(model), "--representation", blind]
    assert main([*words, "--components", "9", "--task", "textures"]) == 0
    output = capsys.readouterr().out
    assert f"model: {model}" in output and "9 components, 3 textures, trained on all 36" in output
    assert main([*words, "--task", "textures"]) == 2
    assert "already exists" in capsys.readouterr().err

    assert main(["classify", str(model), str(other), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["asked"] == 11 and len(answer["predictions"]) == 15
    assert answer["rate_error_of_c"] and "WARNING" in answer["remarks"][0]
    assert answer["model"]["trained_on"][0]["content"]
    out = tmp_path / "answers.csv"
    assert main(["classify", str(model), str(other), "--out", str(out)]) == 0
    assert " of 11 trials right (" in capsys.readouterr().out
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert [row["predicted"] for row in rows] == [p["predicted"] for p in answer["predictions"]]
    assert {row["right"] for row in rows if row["texture"] == "X"} == {""}
    assert main(["classify", str(model), str(other)]) == 0
    output = capsys.readouterr().out
    assert "trial 1: " in output and "rows: true, columns: predicted" in output
    assert main(["classify", str(session), str(other)]) == 2
    assert "rigctl: " in capsys.readouterr().err


def test_analyse_takes_c_from_a_model_and_reports_its_rate_error(
    made: RepresentationSet, session: Path, tmp_path: Path
) -> None:
    model = saved(made, tmp_path / "m.h5", "Force Scaled")
    day = record(tmp_path / "day", "AB", repeats=2, travel_mm=24.0, speeds=(40, 80), seed=11)
    words = ["--iterations", "1", "--k-max", "3", "--task", "textures", "--c", str(model)]
    assert main(["analyse", str(day), "--out", str(tmp_path / "r"), *words]) == 0
    plain = json.loads((tmp_path / "r" / "results.json").read_text())
    force = plain["force_matrix"]
    assert force["from_file"] == str(model) and len(force["rate_error"]) == 2
    assert "WARNING" in force["sentence"] and force["sentence"] in plain["remarks"]
    assert "speed_force_blind" in plain["tasks"]["textures"]["representations"]
    assert "any change of the sensor voids it" in (tmp_path / "r" / "report.html").read_text()
    (tmp_path / "home").mkdir()
    trials = join_sessions([session])
    home = represent(trials, made.parameters, tmp_path / "home", source=load_c(model, trials))
    assert home.transferred_c is not None and home.transferred_c.rate_errors
    sentence = home.transferred_c.sentence
    assert "WARNING" not in sentence and "was not searched" in sentence
    for representation in REPRESENTATIONS:
        ours, theirs = home.features(representation), made.features(representation)
        np.testing.assert_array_equal(ours, theirs)
    assert main(["encode", str(session), "--no-cache", "--out", str(tmp_path / "spikes")]) == 0
    spikes = tmp_path / "spikes" / "spikes.h5"
    of_spikes = load_c(spikes, trials)
    np.testing.assert_array_equal(of_spikes.force.c, load_c(model, trials).force.c)
    assert of_spikes.unseen == () and load_c(spikes, join_sessions([day])).unseen == (day,)
    with pytest.raises(SessionError, match=r"is an HDF5 file, but not a model or a spikes\.h5"):
        load_c(next(day.glob("part-*.h5")), trials)
    plainly = saved(made, tmp_path / "plain.h5", "Original")
    assert main(["analyse", str(day), "--out", str(tmp_path / "x"), "--c", str(plainly)]) == 2
