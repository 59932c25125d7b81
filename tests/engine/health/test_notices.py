"""The notice on the new meaning of an empty order: shown once, only where it applies."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.cli import main
from rigctl.engine.notices import wiring_notice


@pytest.fixture(autouse=True)
def unknown_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use state and runtime folders of this test."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("RIGCTL_RUNTIME", str(tmp_path / "runtime"))


def described(folder: Path, text: str) -> str:
    path = folder / "rig.toml"
    path.write_text(text)
    return str(path)


def test_the_notice_is_shown_once_with_the_cure(tmp_path: Path) -> None:
    rig = described(tmp_path, "[about]\nname = 'mine'")
    notice = wiring_notice(rig)
    assert notice.startswith(
        f"{rig}: [taxels] wiring is empty, which means the order of the wiring"
    )
    assert "wiring = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17]" in notice
    assert f"rigctl calibrate --rig {rig} wiring" in notice
    assert "low and high" not in notice
    assert wiring_notice(rig) == ""


def test_the_notice_mentions_a_calibrated_range(tmp_path: Path) -> None:
    text = f"[taxels]\nlow = {[1] * 18}\nhigh = {[2] * 18}\n"
    assert "low and high" in wiring_notice(described(tmp_path, text))


@pytest.mark.parametrize(
    "text",
    [f"[taxels]\nwiring = {list(range(18))}", '[ports]\nsimulate = "virtual"', "[taxels", ""],
)
def test_the_notice_is_not_shown_where_it_does_not_apply(tmp_path: Path, text: str) -> None:
    rig = described(tmp_path, text) if text else "virtual"
    assert wiring_notice(rig) == ""
    assert not (tmp_path / "state").exists()


def test_the_notice_repeats_where_it_cannot_be_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    rig = described(tmp_path, "")
    assert wiring_notice(rig) == wiring_notice(rig) != ""


@pytest.mark.parametrize(
    "words", [["run", "quick", "--json"], ["calibrate", "loadcell", "--mass", "100"]]
)
def test_the_command_line_shows_the_notice_before_it_opens_the_rig(
    tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    rig = described(tmp_path, '[ports]\ndrum = "tcp://127.0.0.1:9"\ntaxels = "tcp://127.0.0.1:9"\n')
    command = [words[0], "--rig", rig, *words[1:]]
    assert main(command) == 3
    assert "wiring is empty" in capsys.readouterr().err
    assert main(command) == 3
    assert "wiring is empty" not in capsys.readouterr().err
