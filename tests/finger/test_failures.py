"""What fails around a run: its consumers, the disk, the board between scans, the person."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rigctl.errors import WrongUse
from rigctl.finger.analysis.scans import read_scans
from rigctl.finger.bench.virtual import FingerFaults
from rigctl.finger.commands import FingerCommands
from rigctl.finger.driver import Finger
from rigctl.finger.run_request import FingerRunRequest
from rigctl.finger.scan_in_progress import ScanInProgress
from rigctl.finger.slide_detector import SlideDetector
from rigctl.session import recorder
from rigctl.session.verify import verify
from rigctl.session.writer import PartWriter
from tests.engine.rpc.wrong_requests import Attacker, declared, wrong_requests
from tests.finger.harness import (
    ONE_SCAN,
    SMALL,
    FingerHarness,
    open_finger_harness,
    open_finger_session,
    until_ended,
)

NO_REPEATS = """
name = "no-repeats"
textures = ["D", "L"]
profiles = ["medium"]

[stages]
normalise = 1
train = 1
calibrate = 0
run = 0

[quality]
attempts = 1
"""


@pytest.mark.parametrize(
    ("owner", "method"),
    [(ScanInProgress, "add_block"), (ScanInProgress, "add_message"), (SlideDetector, "add")],
)
def test_a_run_that_cannot_take_its_data_fails_and_the_next_one_is_whole(
    harness: FingerHarness, owner: type, method: str
) -> None:
    def fail(*_: object) -> None:
        raise ValueError("broken on purpose")

    async def twice(opened: FingerHarness) -> None:
        with pytest.MonkeyPatch.context() as broken:
            broken.setattr(owner, method, fail)
            await until_ended(opened)
        run = opened.engine.run
        assert run is not None and run.outcome == "failed"
        assert "broken on purpose" in run.text
        again = opened.request(protocol=ONE_SCAN)
        opened.engine.start(_into(again, opened.folder / "again"))
        await until_ended(opened)

    harness.run(twice, harness.request(protocol=ONE_SCAN))
    assert harness.engine.run is not None
    assert harness.engine.run.text == "every scan is committed"
    assert not verify(harness.session).problems


def _into(request: FingerRunRequest, folder: Path) -> FingerRunRequest:
    return FingerRunRequest(request.stages, request.protocol, out=str(folder), yes=request.yes)


def test_a_disk_that_refuses_pauses_the_run_until_it_takes_files_again(
    harness: FingerHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scan whose row was on its way to the disk is made again, with the ranges of its stage."""

    async def refuse_for_a_while(opened: FingerHarness) -> None:
        run = opened.engine.run
        assert run is not None
        await opened.until(lambda: opened.engine.status().run.trials_committed == 8)
        run._recorder.wait_written()
        with monkeypatch.context() as patch:
            patch.setattr(PartWriter, "write", full)
            patch.setattr(recorder, "probe_disk", full)
            await opened.until(lambda: "disk error" in opened.engine.status().run.reasons)
            eta_s = opened.engine.status().run.eta_s
            began_s = opened.rig.loop.time()
            await opened.until(lambda: opened.rig.loop.time() > began_s + 20)
            assert opened.engine.status().run.state == "paused"
            assert opened.engine.status().run.eta_s == eta_s
        await until_ended(opened)

    harness.run(refuse_for_a_while, harness.request("normalise", "train"))
    run = harness.engine.run
    assert run is not None and run.text == "every scan is committed"
    assert "the disk is full: make room" in harness.texts("disk")[0]
    with open_finger_session(harness.session) as session:
        rows = session.trials[session.committed()]
        assert rows["trial_id"].tolist() == list(range(1, len(rows) + 1))
    assert len(read_scans(harness.session).recordings) == 18, "all with the ranges of training"
    assert not verify(harness.session).problems


def test_a_disk_that_stays_full_keeps_the_committed_scans(
    harness: FingerHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fill(opened: FingerHarness) -> None:
        run = opened.engine.run
        assert run is not None
        await opened.until(lambda: opened.engine.status().run.trials_committed == 2)
        await opened.until_scanning()
        run._recorder.wait_written()
        monkeypatch.setattr(PartWriter, "write", full)
        monkeypatch.setattr(recorder, "probe_disk", full)
        await opened.until(lambda: opened.engine.status().run.reasons == ("disk error",))
        run.control.abort("enough")
        await until_ended(opened)

    harness.run(fill, harness.request("normalise", "train"))
    run = harness.engine.run
    assert run is not None and run.outcome == "aborted"
    with open_finger_session(harness.session) as session:
        assert len(session.committed()) == 2


def test_a_disk_that_refuses_again_at_once_ends_the_run(
    harness: FingerHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes a file of a megabyte, and no part."""

    async def fill(opened: FingerHarness) -> None:
        await opened.until_scanning()
        monkeypatch.setattr(PartWriter, "write", full)
        await until_ended(opened)

    harness.run(fill, harness.request("normalise", "train"))
    run = harness.engine.run
    assert run is not None and run.outcome == "failed"
    assert "the disk is full: make room" in run.text
    assert len(harness.texts("disk")) == 3


def full(*_: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("fault", [FingerFaults.unplug, FingerFaults.reset])
def test_a_board_that_is_lost_while_it_is_set_is_waited_for(
    harness: FingerHarness, fault: Callable[[FingerFaults], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    settle = Finger.configure
    faults = [fault]

    async def configure(finger: Finger, *args: Any) -> Any:
        if faults:
            faults.pop()(harness.rig.faults)
        return await settle(finger, *args)

    async def plug_in(opened: FingerHarness) -> None:
        await opened.until(lambda: not opened.rig.finger.connected or bool(opened.texts("stage")))
        if not opened.rig.finger.connected:
            await opened.until(lambda: opened.engine.status().run.state == "paused")
            opened.rig.faults.replug()
        await until_ended(opened)

    monkeypatch.setattr(Finger, "configure", configure)
    harness.run(plug_in, harness.request(protocol=ONE_SCAN))
    assert harness.engine.run is not None
    assert harness.engine.run.text == "every scan is committed"
    assert not verify(harness.session).problems


def test_a_board_that_is_still_scanning_for_a_killed_engine_is_set_all_the_same(
    harness: FingerHarness,
) -> None:
    async def start(opened: FingerHarness) -> None:
        opened.rig.finger.send_start(1)
        opened.engine.start(opened.request(protocol=ONE_SCAN))
        await until_ended(opened)

    harness.run(start)
    assert harness.engine.run is not None
    assert harness.engine.run.text == "every scan is committed"
    assert not verify(harness.session).problems


@pytest.mark.parametrize(
    ("request_name", "reason"),
    [
        ("send_start", "the finger board did not start the scan"),
        ("send_stop", ""),
        ("set_velocity", "velocities that did not reach the board in time: 1"),
    ],
)
def test_a_request_that_is_lost_on_the_line_is_noticed_or_repeated(
    harness: FingerHarness, request_name: str, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    send = getattr(Finger, request_name)
    lost: list[tuple[int, ...]] = []

    def lose_first(finger: Finger, *args: int) -> None:
        if not lost:
            lost.append(args)
        else:
            send(finger, *args)

    monkeypatch.setattr(Finger, request_name, lose_first)
    run = harness.record(harness.request(protocol=ONE_SCAN))
    assert run.text == "every scan is committed"
    with open_finger_session(harness.session) as session:
        first = str(session.trials["reasons"][0])
        assert session.trials["scan"][session.committed()].min() > (0 if not reason else 1)
    assert reason in first
    assert "did not report the end" not in first
    assert not verify(harness.session).problems


def test_a_person_who_never_slides_can_abort(harness: FingerHarness) -> None:
    simulation, harness.rig.simulation = harness.rig.simulation, None

    async def wait(opened: FingerHarness) -> None:
        await opened.until(lambda: opened.engine.status().run.prompt is not None)
        run, prompt = opened.engine.run, opened.engine.status().run.prompt
        assert run is not None and prompt is not None
        run.control.answer(prompt.id, "ok")
        begin_s = opened.rig.loop.time()
        await opened.until(lambda: opened.rig.loop.time() > begin_s + 30.0)
        assert opened.engine.status().run.state == "running"
        await FingerCommands(opened.engine).handle("abort", {})
        await until_ended(opened)

    harness.run(wait, harness.request(protocol=ONE_SCAN))
    harness.rig.simulation = simulation
    assert harness.engine.run is not None
    assert harness.engine.run.outcome == "aborted"
    with open_finger_session(harness.session) as session:
        assert session.trials["verdict"].tolist() == ["aborted"]
    assert not verify(harness.session).problems


def test_stop_ends_a_run(harness: FingerHarness) -> None:
    async def stop(opened: FingerHarness) -> None:
        await opened.until_scanning(at_mm=100.0)
        await FingerCommands(opened.engine).handle("stop", {})
        await until_ended(opened)

    harness.run(stop, harness.request(protocol=ONE_SCAN))
    assert harness.engine.run is not None
    assert harness.engine.run.text == "stopped by a client"
    assert not verify(harness.session).problems


def test_training_keeps_its_ranges_when_a_normalisation_scan_is_made_up_for(
    tmp_path: Path,
) -> None:
    async def spoil_first(opened: FingerHarness) -> None:
        await opened.until_scanning(at_mm=120.0)
        opened.rig.faults.short_scan()
        await opened.until(lambda: opened.engine.status().run.trials_committed == 2)
        assert opened.engine.run is not None
        opened.engine.run.control.abort("stopped by the test")
        await until_ended(opened)

    with open_finger_harness(tmp_path) as harness:
        harness.run(spoil_first, harness.request("normalise", "train", protocol=NO_REPEATS))
        folder = harness.session
    with open_finger_harness(tmp_path / "again", seed=5) as again:
        run = again.record(FingerRunRequest(resume=str(folder), yes=True))
        assert run.text == "every scan is committed"
    assert len(read_scans(folder).recordings) == 2, "the ranges are the same in all of them"
    assert not verify(folder).problems


def test_an_unknown_plate_is_refused_before_anything_is_recorded(harness: FingerHarness) -> None:
    async def start(opened: FingerHarness) -> None:
        opened.engine.start(opened.request(protocol=SMALL.replace('"L"]', '"Z"]')))

    with pytest.raises(WrongUse, match="no plate 'Z'"):
        harness.run(start)
    assert not harness.session.exists()


def test_a_report_of_a_painted_answer_must_be_of_a_scan(harness: FingerHarness) -> None:
    """A client's mistake does not reach the recorder, whose failure would end the run."""

    async def report(opened: FingerHarness) -> None:
        handle = FingerCommands(opened.engine).handle
        await opened.until_scanning(at_mm=100.0)
        with pytest.raises(WrongUse, match="scan: expected a whole number"):
            await handle("shown", {"scan": "1", "sent_s": 0.0})
        for scan in (0, 2, 10**15):
            await handle("shown", {"scan": scan, "sent_s": 0.0})
        await handle("shown", {"scan": 1, "sent_s": opened.rig.loop.time() - 0.02})
        await until_ended(opened)

    harness.run(report, harness.request(protocol=ONE_SCAN))
    assert harness.engine.run is not None
    assert harness.engine.run.text == "every scan is committed"
    with open_finger_session(harness.session) as session:
        rows = session.latencies
        shown = rows[rows["kind"] == "screen"]
    assert shown["scan"].tolist() == [1]
    assert shown["ms"] == pytest.approx([20.0])


def test_a_finger_run_goes_on_under_wrong_requests(harness: FingerHarness) -> None:
    async def scenario(harness: FingerHarness) -> None:
        await harness.until_scanning()
        client = await Attacker.connect(harness.address)
        await client.attack(wrong_requests(*declared(FingerCommands, FingerFaults)))
        await until_ended(harness)
        await client.close()
        client.require_refusals()

    harness.run(scenario, harness.request(protocol=ONE_SCAN))
    run = harness.engine.run
    assert run is not None and run.text == "every scan is committed"
    assert harness.texts("fault") == []
