"""The experiment from the first scan to the answers, on the virtual finger."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import h5py
import numpy as np
import pytest
from msgspec.structs import replace

from rigctl.finger.analysis.scans import encode_readings
from rigctl.finger.layout import FINGER_TRUTH
from rigctl.finger.model_file import load_finger_model, save_finger_model
from rigctl.finger.run_request import FingerRunRequest
from rigctl.finger.values import ScanKind
from rigctl.session.ground_truth import log_paths, open_truth
from rigctl.session.summary import summarise_session
from rigctl.session.verify import verify
from rigctl.values import ABOUT
from tests.finger.conftest import Trained
from tests.finger.harness import (
    ONE_SCAN,
    SMALL,
    FingerHarness,
    open_finger_harness,
    open_finger_session,
    until_ended,
)

TRUE_NAMES = ("along_mm", "force_g", "plate", "slide")
TRACKED_MM = 8.0
"""The tracker's noise and delay at the fastest slide, and the wrist that bends."""
ONE_RUN = ONE_SCAN.replace("run = 0", "run = 1")
FEW_SCANS = SMALL.replace('"medium", "fast"', '"medium"')


def assert_whole(folder: Path) -> None:
    """Assert that verify finds nothing: also that the board's spikes are the encoder's."""
    assert not verify(folder).problems


def test_training_scans_use_the_ranges_of_the_normalisation(trained: Trained) -> None:
    with open_finger_session(trained.training) as session:
        trials = session.trials
        rows = np.flatnonzero(trials["verdict"] == "committed")
        normalise = [i for i in rows if trials["stage"][i] == "normalise"]
        train = [i for i in rows if trials["stage"][i] == "train"]
        assert (len(normalise), len(train)) == (6, 18)
        readings = np.concatenate([session.samples(i) for i in normalise])
        assert session.normalisation(normalise[0]).high.tolist() == [1023] * 9
        used = session.normalisation(train[0])
        assert used.low.tolist() == readings.min(axis=0).tolist()
        assert used.high.tolist() == readings.max(axis=0).tolist()
    assert_whole(trained.training)


def test_a_run_names_textures_while_the_finger_moves(
    trained: Trained, new_session: FingerHarness
) -> None:
    run = new_session.record(new_session.request("run", model=trained.model))
    assert run.text == "every scan is committed"
    with open_finger_session(new_session.session) as session:
        for i in session.committed():
            answers = session.predictions(i)
            assert [a.windows for a in answers] == sorted(a.windows for a in answers)
            assert answers[-1].is_final and not any(a.is_final for a in answers[:-1])
            assert len(answers) >= 10, "the answer grows while the finger moves"
            assert sum(answers[0].probabilities.values()) == pytest.approx(1.0, abs=1e-4)
            assert session.trials["predicted"][i] == answers[-1].texture
            assert answers[-1].texture in answers[-1].texture_set
        status = run.status()
        correct = int(np.sum(session.trials["correct"] == 1))
        assert (status.classified, status.correct) == (6, correct)
    assert_whole(new_session.session)
    kinds = {event.kind for event in new_session.events}
    assert {"batch", "prediction", "instruction", "trial"} <= kinds
    batches = [event.data for event in new_session.events if event.kind == "batch"]
    assert all(0 < batch["scaled_s"] <= batch["seconds"] for batch in batches)
    p99_ms = new_session.engine.status().latency_p99_ms
    assert set(p99_ms) == {"features", "prediction"} and p99_ms["features"] <= 5.0


@pytest.mark.parametrize("kind", [ScanKind.SPEED_SCALED_DIVIDED, ScanKind.CALIBRATED])
def test_a_run_has_the_gain_of_its_model(trained: Trained, tmp_path: Path, kind: ScanKind) -> None:
    model, path = load_finger_model(trained.model), tmp_path / "model.h5"
    save_finger_model(dataclasses.replace(model, representation=kind.value), path)
    with open_finger_harness(tmp_path, session=1) as harness:
        harness.record(harness.request("run", model=path, protocol=ONE_RUN))
    with open_finger_session(harness.session) as session:
        assert session.header.encoder_scaling == kind.force_scaling
        gain = session.header.gain(model.normalisation)
        scans = [(session.samples(i), session.spikes(i)) for i in session.committed()]
    assert gain is not None and len(scans) == 2
    for readings, spikes in scans:
        scaled = gain.apply(readings)
        np.testing.assert_array_equal(spikes, encode_readings(scaled, model.normalisation))
        assert (spikes != encode_readings(readings, model.normalisation)).any()
    assert_whole(harness.session)


def test_features_return_within_five_milliseconds(trained: Trained) -> None:
    with open_finger_session(trained.training) as session:
        latencies = session.latencies
        features = latencies["ms"][latencies["kind"] == "features"]
    assert len(features) > 100
    assert features.max() <= 5.0


def test_a_model_keeps_what_it_was_trained_with(trained: Trained) -> None:
    model = load_finger_model(trained.model)
    assert model.textures == ("A", "D", "L")
    assert model.reference_um_per_s == 100_000
    assert model.calibration is not None
    assert model.training.simulated
    assert model.training.trials == 18
    plain = load_finger_model(trained.training / "model-original.h5")
    assert plain.representation == "Original"
    assert plain.calibration is None


def test_what_is_said_of_a_session_is_kept_in_it(tmp_path: Path) -> None:
    said = {"operator": "Kim", "sensor": "S2", "plate_lot": "PLA 3", "project": "pilot"}
    with open_finger_harness(tmp_path) as harness:
        request = replace(harness.request(protocol=ONE_SCAN), **said, remarks=" cold room ")
        harness.record(request)
        summary = summarise_session(harness.session)
        assert {name: summary[name] for name in ABOUT} == {**said, "remarks": "cold room"}


def test_the_same_seed_records_the_same_spikes(tmp_path: Path) -> None:
    recorded = []
    for name in ("one", "two"):
        with open_finger_harness(tmp_path / name, seed=5) as harness:
            harness.record(harness.request(protocol=ONE_SCAN))
            with open_finger_session(harness.session) as session:
                recorded.append([session.spikes(i) for i in session.committed()])
    for first, second in zip(*recorded, strict=True):
        assert np.array_equal(first, second)


def test_an_aborted_run_is_resumed_where_it_stopped(tmp_path: Path) -> None:
    async def abort_after_two(harness: FingerHarness) -> None:
        await harness.until(lambda: harness.engine.status().run.trials_committed == 2)
        assert harness.engine.run is not None
        harness.engine.run.control.abort("stopped by the test")
        await until_ended(harness)

    with open_finger_harness(tmp_path) as harness:
        harness.run(abort_after_two, harness.request("normalise", "train", protocol=FEW_SCANS))
        folder = harness.session
    with open_finger_harness(tmp_path / "again") as again:
        run = again.record(FingerRunRequest(resume=str(folder), yes=True))
        assert run.text == "every scan is committed"
    with open_finger_session(folder) as session:
        ids = session.trials["trial_id"][session.committed()]
        assert ids.tolist() == list(range(1, 13))
    assert [path.name for path in log_paths(folder)] == ["world.h5", "world-0002.h5"]
    assert_whole(folder)


def test_the_true_path_plate_and_pressure_lie_beside_a_session(harness: FingerHarness) -> None:
    harness.record(harness.request(protocol=ONE_SCAN))
    log = harness.session / "world.h5"
    with open_finger_session(harness.session) as session, open_truth(log, FINGER_TRUTH) as truth:
        slides = set()
        for i in session.committed():
            track, trial = session.track(i), session.trials[i]
            at = np.rint(1000 * track["at_s"]).astype(int) - truth.first_ms - 1
            touching = truth.window("force_g", 0, truth.n_rows)[at] > 0.0
            track, at = track[touching], at[touching]
            true = {name: truth.window(name, 0, truth.n_rows)[at] for name in TRUE_NAMES}
            assert set(true["plate"].tolist()) == {trial["texture"].encode()}
            assert np.abs(track["along_mm"] - true["along_mm"]).max() < TRACKED_MM
            assert np.median(true["force_g"]) > 150.0
            slides |= set(true["slide"].tolist())
        assert len(slides) == len(session.committed())
    with h5py.File(log, "r+") as file:
        del file["/plate"]
    (problem,) = verify(harness.session).problems
    assert "world.h5" in problem and "/plate" in problem


def test_a_person_is_asked_for_each_plate(harness: FingerHarness) -> None:
    asked: list[str] = []

    async def answer(opened: FingerHarness) -> None:
        for _ in range(2):
            await opened.until(lambda: opened.engine.status().run.prompt is not None)
            prompt = opened.engine.status().run.prompt
            assert prompt is not None and opened.engine.run is not None
            asked.append(prompt.text)
            assert opened.engine.run.control.answer(prompt.id, "ok")
        await until_ended(opened)

    harness.run(answer, harness.request(protocol=ONE_SCAN, yes=False))
    assert asked == [
        "Lay plate D under the finger, then confirm.",
        "Lay plate L under the finger, then confirm.",
    ]


def test_a_pause_repeats_the_interrupted_scan(harness: FingerHarness) -> None:
    async def pause(opened: FingerHarness) -> None:
        await opened.until_scanning(at_mm=120.0)
        assert opened.engine.run is not None
        opened.engine.run.control.pause()
        await opened.until(lambda: "aborted" in str(opened.texts("trial")))
        opened.engine.run.control.resume()
        await until_ended(opened)

    harness.run(pause, harness.request(protocol=ONE_SCAN))
    with open_finger_session(harness.session) as session:
        verdicts = session.trials["verdict"].tolist()
    assert verdicts == ["aborted", "committed", "committed"]
    assert_whole(harness.session)
