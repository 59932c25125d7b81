"""``rigctl check`` reports what a protocol needs before anything moves."""

from __future__ import annotations

import json
from collections import namedtuple
from pathlib import Path

import pytest

from rigctl.cli import check, create_parser
from rigctl.errors import CheckFailed, ConfigError, ProtocolError


def run(*words: str) -> int:
    return check.run(create_parser(["check"]).parse_args(["check", *words]))


def test_it_prints_trials_plate_changes_time_and_disk(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("paper") == 0
    text = capsys.readouterr().out
    assert "24,000 of 240 mm" in text
    assert "plate changes       16" in text
    assert "plates              A B C D" in text
    assert "order               plate by plate, forces, speeds, repeats, 100 of each" in text
    assert "23 h 12 min of trials" in text
    assert "GB" in text


def test_a_protocol_of_the_moving_finger_is_planned_stage_by_stage(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("finger/paper") == 0
    text = capsys.readouterr().out
    assert "train           100 scans, 8 min 20 s and 87 changes of plates, 22 MB" in text
    assert "all             300 scans, 25 min 00 s" in text
    assert "rigctl realtime train, calibrate, run" in text
    assert run("protocols/finger/quick.toml", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert {name: stage["trials"] for name, stage in answer["stages"].items()} == {
        "normalise": 25, "train": 100, "calibrate": 50, "run": 25,
    }  # fmt: skip
    assert answer["seconds"] == 1000


def test_a_finger_toml_is_read_with_a_protocol_of_the_finger(tmp_path: Path) -> None:
    rig = tmp_path / "finger.toml"
    rig.write_text("[tracker]\nsource = 5\n")
    with pytest.raises(ConfigError, match=r"line 2: tracker\.source"):
        run("finger/quick", "--rig", str(rig))


def test_a_disk_too_small_for_the_finger_fails_the_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(check.shutil, "disk_usage", lambda _: usage(2_000_000, 1, 1_000_000))
    with pytest.raises(CheckFailed, match=r"1 MB free, but the protocol needs 45 MB"):
        run("finger/quick", "--out", str(tmp_path))


def test_json_is_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("quick", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["trials"] == 32
    assert answer["plate_changes"] == 4
    assert answer["trial_seconds"] == 96
    assert answer["bytes"] > 5_000_000


def test_a_rig_with_narrower_limits_refuses(tmp_path: Path) -> None:
    rig = tmp_path / "slow.toml"
    rig.write_text("[limits]\nspeed_max_mm_s = 100\n")
    with pytest.raises(ProtocolError, match="120 is outside 20 to 100 mm/s"):
        run("quick", "--rig", str(rig))


def test_an_unknown_protocol_lists_the_known_ones() -> None:
    with pytest.raises(ProtocolError, match="baseline, paper, quick, sensor, showcase"):
        run("qiuck")


def test_too_little_disk_space_fails_the_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(check.shutil, "disk_usage", lambda _: usage(2_000_000, 1, 1_000_000))
    with pytest.raises(CheckFailed, match=r"1 MB free, but the protocol needs 13 MB"):
        run("quick", "--out", str(tmp_path / "new" / "folder"))
