"""A run of the finger tells what somebody must know, and copies what is finished."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rigctl.config.rig_config import RecordingConfig, RunConfig
from rigctl.engine.rpc.messages import NOTHING_RECORDED_S
from rigctl.errors import ConfigError
from rigctl.finger.config import FingerConfig, load_finger_config
from rigctl.finger.run import FingerRun
from rigctl.session.verify import verify
from tests.engine.test_event_hook import got, writer
from tests.finger.harness import ONE_SCAN, open_finger_harness


def test_its_end_and_that_nothing_is_recorded_are_told_and_its_parts_are_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, disk = tmp_path / "got", tmp_path / "second"
    disk.mkdir()
    begin_stage = FingerRun._begin_stage

    async def begin_late(run: FingerRun, *args: Any) -> None:
        end_s = run._now_s() + 2 * NOTHING_RECORDED_S
        await run.control.wait_until(lambda: run._now_s() > end_s)
        await begin_stage(run, *args)

    monkeypatch.setattr(FingerRun, "_begin_stage", begin_late)
    config = FingerConfig(
        recording=RecordingConfig(copy_to=str(disk)), run=RunConfig(on_event=writer(path))
    )
    with open_finger_harness(tmp_path, config=config) as harness:
        assert harness.record(harness.request(protocol=ONE_SCAN)).outcome == "done"
        assert harness.texts("unrecorded") == ["no sample was recorded for 60 s: look at the rig"]
        assert harness.texts("copy") == []
    assert sorted(line[0] for line in got(path)) == ["done", "unrecorded"]
    assert verify(disk / "session").whole


def test_both_tables_are_read_and_checked(tmp_path: Path) -> None:
    path = tmp_path / "finger.toml"
    path.write_text('[run]\non_event = ["tell", "finger 1"]\n[recording]\ncopy_to = "/second"\n')
    config = load_finger_config(path)
    assert config.run.on_event == ("tell", "finger 1")
    assert config.recording.copy_to == "/second"
    for text in ('[run]\non_event = "tell"\n', '[recording]\ncopy_to = "second"\n'):
        path.write_text(text)
        with pytest.raises(ConfigError, match=r"finger.toml, line 2: .*(on_event|copy_to): must"):
            load_finger_config(path)
