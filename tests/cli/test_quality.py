"""``rigctl quality`` judges a session anew, and leaves it as it is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rigctl.cli import main
from rigctl.session.verify import verify
from tests.analysis.recordings import record


def test_a_session_is_judged_and_drawn_beside_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = record(tmp_path / "session", textures="AD")
    files = sorted(session.iterdir())
    assert main(("quality", str(session), "--json")) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["simulated"] is True and printed["counts"]["given up"] == 0
    page = tmp_path / "session-quality"
    assert {path.name for path in page.iterdir()} == {
        "quality.html", "quality.json", "quality.png", "quality.svg",
    }  # fmt: skip
    assert json.loads((page / "quality.json").read_text()) == printed
    assert "Simulated" in (page / "quality.html").read_text()
    assert sorted(session.iterdir()) == files and verify(session).whole
    assert main(("quality", str(session))) == 2
    assert "already exists: name another folder" in capsys.readouterr().err


def test_a_trial_without_a_good_attempt_is_given_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = record(tmp_path / "session", textures="A")
    assert main(("note", str(session), "a hand was on it", "--trial", "1", "--bad")) == 0
    assert main(("quality", str(session))) == 1
    assert "1 given up" in capsys.readouterr().out
    page = (tmp_path / "session-quality" / "quality.html").read_text()
    assert "given up" in page and "a hand was on it" in page
