"""A run copies its finished parts to a second disk, which may be missing and come back."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from rigctl.config.rig_config import RecordingConfig, RigConfig, parse_config
from rigctl.engine import copy_process
from rigctl.errors import ConfigError
from rigctl.session.verify import verify
from tests.engine.engine_harness import TINY, EngineHarness, open_harness, until_ended


def config(to: Path) -> RigConfig:
    return RigConfig(recording=RecordingConfig(copy_to=str(to)))


def test_a_run_ends_when_its_parts_are_on_the_second_disk(tmp_path: Path) -> None:
    disk = tmp_path / "second"
    disk.mkdir()
    with open_harness(tmp_path, config=config(disk)) as harness:
        harness.record()
        assert harness.texts("copy") == []
        assert "part-0002.h5" in " ".join(harness.texts("log"))
    report = verify(disk / "session")
    assert report.whole and report.trials_committed == 4


def test_a_missing_disk_is_told_stops_nothing_and_gets_all_when_it_is_back(tmp_path: Path) -> None:
    disk = tmp_path / "second"

    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: run.control.prompt is not None)
        await harness.until(lambda: bool(harness.texts("copy")), 100_000)
        while not harness.has_ended():
            if run.control.prompt is not None:
                run.control.answer(run.control.prompt.id, "ok")
            if run.status().trials_committed == 3:
                disk.mkdir(exist_ok=True)
            await harness.wait(1)

    with open_harness(tmp_path, config=config(disk)) as harness:
        harness.run(scenario, harness.request(TINY, yes=False))
        (told,) = harness.texts("copy")
        assert told.startswith(f"not copied: {disk} is not there: connect the second disk")
        assert f"`rigctl copy {harness.session} {disk}` catches up" in told
        assert harness.engine.run is not None and harness.engine.run.outcome == "done"
    assert verify(disk / "session").whole


def test_a_recording_by_hand_is_copied_too(tmp_path: Path) -> None:
    disk = tmp_path / "second"
    disk.mkdir()

    async def scenario(harness: EngineHarness) -> None:
        await harness.handle("record", {"out": str(harness.session)})
        await harness.wait(1)
        await harness.handle("end_record", {})
        for thread in threading.enumerate():
            if thread.name == "copy":
                thread.join()

    with open_harness(tmp_path, config=config(disk)) as harness:
        harness.run(scenario)
        assert harness.texts("copy") == []
    assert verify(disk / "session").whole


def test_the_end_of_a_run_waits_for_no_disk_that_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(copy_process, "END_S", 0.0)
    disk = tmp_path / "second"
    disk.mkdir()
    with open_harness(tmp_path, config=config(disk)) as harness:
        harness.run(until_ended, harness.request())
        run = harness.engine.run
        assert run is not None and run.outcome == "done" and run.copy is not None
        (told,) = harness.texts("copy")
        assert told == f"the copy to {disk} takes longer and goes on after the run"
        run.copy.wait()
    assert verify(disk / "session").whole


def test_a_folder_that_depends_on_the_working_folder_is_refused() -> None:
    with pytest.raises(ConfigError, match="copy_to: must be a whole path"):
        parse_config('[recording]\ncopy_to = "second"\n')
