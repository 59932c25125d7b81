"""What goes wrong with a person, a tracker or a board: the scan is refused with the reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from rigctl.encoder.reading import Reading
from rigctl.errors import SessionError, WrongUse
from rigctl.finger.bench.virtual import FingerFaults
from rigctl.finger.devices import TrackingLoss
from rigctl.finger.model_file import FingerModel, load_finger_model, save_finger_model
from rigctl.finger.models import calibrate_models
from rigctl.finger.run_request import FingerRunRequest
from rigctl.finger.values import ScanKind
from rigctl.session.sensor_passport import SensorPassport, TaxelResponse, read_passport
from rigctl.session.verify import verify
from rigctl.values import Position
from tests.finger.conftest import Trained
from tests.finger.harness import (
    ONE_SCAN,
    SMALL,
    FingerHarness,
    open_finger_harness,
    open_finger_session,
    until_ended,
)

Fault = Callable[[FingerFaults], None]


def _record_with(harness: FingerHarness, fault: Fault, at_mm: float = 120.0) -> list[str]:
    """Inject a fault into the first scan; return the reasons of all attempts."""

    async def inject(opened: FingerHarness) -> None:
        await opened.until_scanning(at_mm)
        fault(opened.rig.faults)
        await until_ended(opened)

    harness.run(inject, harness.request(protocol=ONE_SCAN))
    assert harness.engine.run is not None
    assert harness.engine.run.text == "every scan is committed"
    assert not verify(harness.session).problems
    with open_finger_session(harness.session) as session:
        return [str(reasons) for reasons in session.trials["reasons"]]


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (lambda faults: faults.lose_tracker(0.3), "the tracker was lost for"),
        (lambda faults: faults.lose_tracker(2.0), "no position of the finger for 1 s"),
        (lambda faults: faults.lift(0.13), "the finger touched the plate in"),
        (lambda faults: faults.lift(0.6), "the finger left the plate after"),
        (lambda faults: faults.reverse(), "the finger moved backwards"),
        (lambda faults: faults.stand_still(1.5), "the finger stood still for 1 s"),
        (lambda faults: faults.too_fast(), "the velocity profile was slow-to-fast"),
        (lambda faults: faults.short_scan(), "the finger left the plate after"),
        (lambda faults: faults.reset(), "the finger board restarted"),
    ],
    ids=["lost", "gone", "lifted", "away", "back", "still", "fast", "short", "reset"],
)
def test_a_spoilt_scan_is_refused_with_its_reason_and_repeated(
    harness: FingerHarness, fault: Fault, reason: str
) -> None:
    reasons = _record_with(harness, fault)
    assert reason in reasons[0]
    assert reasons[-1] == ""
    asked = [event.data for event in harness.events if event.kind == "instruction"]
    with open_finger_session(harness.session) as session:
        for name in ("trial_id", "attempt"):
            assert [data[name] for data in asked] == session.trials[name].tolist()


def test_a_short_stop_is_no_fault(harness: FingerHarness) -> None:
    """The velocity is 0 then: the window takes longer, and its rate is that of its real time."""
    reasons = _record_with(harness, lambda faults: faults.stand_still(0.3))
    assert reasons[0] == "" or "velocity profile" in reasons[0]


def test_an_unplugged_board_pauses_the_run_and_gets_its_ranges_again(
    trained: Trained, new_session: FingerHarness
) -> None:
    async def unplug(opened: FingerHarness) -> None:
        await opened.until_scanning(at_mm=100.0)
        opened.rig.faults.unplug()
        await opened.until(lambda: opened.engine.status().run.state == "paused")
        assert opened.engine.status().run.reasons == ("link",)
        opened.rig.faults.replug()
        await until_ended(opened)

    new_session.run(unplug, new_session.request("run", model=trained.model))
    assert new_session.engine.run is not None
    assert new_session.engine.run.text == "every scan is committed"
    settings, used = new_session.rig.finger.settings, new_session.engine.devices.normalisation
    assert settings is not None
    assert settings.low == tuple(used.low.tolist())
    assert not verify(new_session.session).problems


def test_a_tracker_that_is_off_pauses_the_run(harness: FingerHarness) -> None:
    async def switch_off(opened: FingerHarness) -> None:
        await opened.until_scanning(at_mm=100.0)
        opened.rig.faults.unplug_tracker()
        await opened.until(lambda: opened.engine.status().run.state == "paused")
        opened.rig.faults.replug_tracker()
        await until_ended(opened)

    harness.run(switch_off, harness.request(protocol=ONE_SCAN))
    assert harness.engine.run is not None
    assert harness.engine.run.text == "every scan is committed"


@pytest.mark.parametrize(("lost_s", "times"), [(0.3, 0), (0.8, 1)])
def test_after_a_loss_of_tracking_the_corners_are_asked_for_once(
    harness: FingerHarness, lost_s: float, times: int
) -> None:
    _record_with(harness, lambda faults: faults.lose_tracker(lost_s))
    asked = [text for text in harness.texts("link") if "touch the plate's corners again" in text]
    assert len(asked) == times
    with open_finger_session(harness.session) as session:
        told = [event.text for event in session.events if event.kind == "link"]
    assert told == asked


def test_lost_bytes_reject_a_scan(harness: FingerHarness) -> None:
    async def corrupt(opened: FingerHarness) -> None:
        await opened.until_scanning(at_mm=80.0)
        opened.rig.faults.corrupt_bytes("to_host", 0.001)
        await opened.until(lambda: opened.engine.status().run.trials_rejected == 1)
        opened.rig.faults.corrupt_bytes("to_host", 0.0)
        await until_ended(opened)

    harness.run(corrupt, harness.request(protocol=ONE_SCAN))
    with open_finger_session(harness.session) as session:
        assert session.trials["verdict"].tolist() == ["rejected", "committed", "committed"]
    assert not verify(harness.session).problems


def test_another_plate_than_announced_is_named_for_what_it_is(
    trained: Trained, new_session: FingerHarness
) -> None:
    """An untrained plate must not get a sure answer; it is marked as unknown or stays unsure."""

    async def swap(opened: FingerHarness) -> None:
        opened.rig.faults.wrong_plate("G")
        await until_ended(opened)

    new_session.run(swap, new_session.request("run", model=trained.model))
    with open_finger_session(new_session.session) as session:
        final = session.predictions(int(session.committed()[0]))[-1]
    assert not final.known or not final.decided


def test_a_model_that_is_not_calibrated_is_refused(
    trained: Trained, new_session: FingerHarness
) -> None:
    model = trained.training / "model-speed-scaled.h5"
    with pytest.raises(WrongUse, match="is not calibrated for this session"):
        _open(new_session, new_session.request("run", model=model))


def test_a_calibrated_model_needs_a_passport(
    trained: Trained, new_session: FingerHarness, tmp_path: Path
) -> None:
    path = tmp_path / "model.h5"
    model = replace(load_finger_model(trained.model), representation=ScanKind.CALIBRATED.value)
    save_finger_model(model, path)
    for passport, message in (
        (None, "a calibrated gain needs the sensor's passport"),
        (nine_taxels(1.0), "is of conductance, the encoder takes counts"),
    ):
        new_session.rig.passport = passport
        with pytest.raises(WrongUse, match=message):
            _open(new_session, new_session.request("run", model=path))


@pytest.mark.parametrize(
    ("protocol", "message"),
    [
        (SMALL.replace('"L"]', '"N"]'), "does not know the plate N"),
        ("reference_mm_s = 120\n" + SMALL, "was trained at a reference speed of 100 mm/s"),
    ],
)
def test_a_model_that_does_not_fit_the_protocol_is_refused(
    trained: Trained, new_session: FingerHarness, protocol: str, message: str
) -> None:
    with pytest.raises(WrongUse, match=message):
        _open(new_session, new_session.request("run", protocol=protocol, model=trained.model))


def test_a_model_of_another_sensor_is_refused(trained: Trained, new_session: FingerHarness) -> None:
    give_sensor(new_session, "finger 2")
    with pytest.raises(WrongUse, match="was trained with the sensor '', this rig has 'finger 2'"):
        _open(new_session, new_session.request("run", model=trained.model))


def test_calibrate_and_run_need_a_session_each(
    trained: Trained, new_session: FingerHarness
) -> None:
    with pytest.raises(WrongUse, match="calibrate and run need a session each"):
        _open(new_session, new_session.request("calibrate", "run", model=trained.model))


async def abort_after_one(harness: FingerHarness) -> None:
    await harness.until(lambda: harness.engine.status().run.trials_committed == 1)
    assert harness.engine.run is not None
    harness.engine.run.control.abort("stopped by the test")
    await until_ended(harness)


def test_a_resumed_run_counts_the_answers_of_the_whole_session(
    trained: Trained, tmp_path: Path
) -> None:
    with open_finger_harness(tmp_path, session=1) as first:
        first.run(abort_after_one, first.request("run", model=trained.model))
    with open_finger_harness(tmp_path / "again", session=1) as again:
        model = str(trained.model)
        run = again.record(FingerRunRequest(resume=str(first.session), model=model, yes=True))
    assert run.text == "every scan is committed"
    with open_finger_session(first.session) as session:
        correct = int(np.sum(session.trials["correct"][session.committed()] == 1))
    assert (run.status().classified, run.status().correct) == (6, correct)


@pytest.mark.parametrize("other", ["sensor", "model", "representation"])
def test_a_session_is_resumed_with_its_own_sensor_and_model(
    trained: Trained, tmp_path: Path, other: str
) -> None:
    with open_finger_harness(tmp_path, session=1) as first:
        first.run(abort_after_one, first.request("run", model=trained.model))
        begun = first.session
    model = trained.model
    if other == "model":
        model = tmp_path / "other.h5"
        save_finger_model(with_other_ranges(load_finger_model(trained.model)), model)
    if other == "representation":
        model = trained.calibration / "model-original.h5"
    message = {
        "sensor": "recorded with the sensor ''",
        "model": "its taxel ranges differ",
        "representation": "resume it with the Speed Scaled model",
    }[other]
    with open_finger_harness(tmp_path / "again", session=1) as again:
        if other == "sensor":
            give_sensor(again, "finger 2")
        request = FingerRunRequest(resume=str(begun), model=str(model), yes=True)
        with pytest.raises(WrongUse, match=message):
            _open(again, request)


def test_a_session_is_resumed_with_the_sensor_that_was_named_at_its_start(tmp_path: Path) -> None:
    with open_finger_harness(tmp_path) as first:
        first.record(structs.replace(first.request(protocol=ONE_SCAN), sensor="S2"))
    resume = FingerRunRequest(resume=str(first.session), yes=True)
    with open_finger_harness(tmp_path / "again") as again:
        with pytest.raises(SessionError, match="with the sensor 'S2', this rig has ''"):
            _open(again, resume)
        with pytest.raises(SessionError, match="is complete"):
            again.engine.start(structs.replace(resume, sensor="S2"))


def test_a_calibration_of_other_ranges_is_refused(trained: Trained, tmp_path: Path) -> None:
    model = tmp_path / "other.h5"
    save_finger_model(with_other_ranges(load_finger_model(trained.model)), model)
    with pytest.raises(WrongUse, match="was trained with other taxel ranges"):
        calibrate_models(model, trained.calibration)


def test_a_model_with_an_empty_range_ends_the_run_with_a_sentence(
    trained: Trained, new_session: FingerHarness
) -> None:
    model = load_finger_model(trained.model)
    ranges, high = model.normalisation, model.normalisation.high.copy()
    high[2] = ranges.low[2]
    path = new_session.folder / "empty.h5"
    save_finger_model(replace(model, normalisation=replace(ranges, high=high)), path)
    run = new_session.record(new_session.request("run", model=path))
    assert run.outcome == "failed"
    assert run.text.startswith("taxel 3: the range")


def give_sensor(harness: FingerHarness, name: str) -> None:
    config = harness.rig.config
    harness.rig.config = replace(config, about=replace(config.about, sensor=name))


def with_other_ranges(model: FingerModel) -> FingerModel:
    ranges = model.normalisation
    return replace(model, normalisation=replace(ranges, high=ranges.high + np.uint16(1)))


def test_run_without_a_model_is_refused(new_session: FingerHarness) -> None:
    with pytest.raises(WrongUse, match="name its file with --model"):
        _open(new_session, new_session.request("run"))


def test_training_without_normalisation_is_refused(harness: FingerHarness) -> None:
    with pytest.raises(WrongUse, match="plan the stage normalise too"):
        _open(harness, harness.request("train"))


def _open(harness: FingerHarness, request: FingerRunRequest) -> None:
    """Open a run as the engine does, without its server."""

    async def start(opened: FingerHarness) -> None:
        opened.engine.start(request)

    harness.run(start)


def test_a_refused_request_leaves_no_folder(harness: FingerHarness, tmp_path: Path) -> None:
    with pytest.raises(WrongUse):
        _open(harness, harness.request("run"))
    assert not harness.session.exists()


def losses(valid: list[tuple[float, bool]]) -> list[float]:
    loss = TrackingLoss()
    told = [loss.add(Position(at_s, 0.0, 0.0, 0.0, is_valid)) for at_s, is_valid in valid]
    return [lost_s for lost_s in told if lost_s is not None]


@pytest.mark.parametrize(
    ("valid", "told"),
    [
        ([(0.0, True), (0.1, False), (0.5, False), (0.7, True), (0.8, True)], [0.6]),
        ([(0.0, True), (0.1, False), (0.6, True)], []),
        ([(0.0, False), (5.0, True)], []),
        ([(0.0, True), (5.0, True)], []),
        ([(0.0, True), (1.0, False), (2.0, True), (3.0, False), (5.0, True)], [1.0, 2.0]),
        ([(0.0, True), (0.1, False), (0.4, True), (0.5, False), (0.9, True)], []),
    ],
    ids=["long", "short", "before the first", "silent", "twice", "two short ones"],
)
def test_a_long_loss_is_told_once_with_its_length(
    valid: list[tuple[float, bool]], told: list[float]
) -> None:
    assert losses(valid) == pytest.approx(told)


def nine_taxels(gain: float) -> SensorPassport:
    """Return what a calibration of the finger's sensor finds, ``gain`` times as much."""
    forces_g = (100.0, 500.0, 1000.0)
    taxel = TaxelResponse(tuple(gain * force**0.7 for force in forces_g), gain * 100.0)
    about = ("", "2026-11-20T12:00:00Z", "", True, Reading.CONDUCTANCE)
    return SensorPassport(*about, forces_g, (0.02,) * 3, (taxel,) * 9)


def test_a_run_says_that_the_sensor_changed_since_the_model(
    trained: Trained, tmp_path: Path
) -> None:
    model, path = load_finger_model(trained.model), tmp_path / "earlier.h5"
    inputs = ({**model.training.inputs[0], "passport": nine_taxels(1.0).to_values()},)
    training = replace(model.training, inputs=inputs)
    save_finger_model(replace(model, training=training), path)
    with open_finger_harness(tmp_path / "run", session=1) as harness:
        harness.rig.passport = nine_taxels(1.3)
        harness.run(abort_after_one, harness.request("run", model=path))
    with open_finger_session(harness.session) as session:
        said = [event.text for event in session.events_of("check")]
        assert read_passport(session.header.passport) == nine_taxels(1.3)
    assert any("trained on this sensor as it was on 2026-11-20" in text for text in said)
