"""Start of the window without a display."""

from __future__ import annotations

import pytest

from rigctl.cli import main


def test_missing_display_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    assert main(["gui"]) == 2
    text = capsys.readouterr().err
    assert "needs a display" in text and text.count("\n") == 1


def test_missing_libraries_are_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("QT_QPA_PLATFORM", "nonsense")
    assert main(["gui"]) == 2
    assert "libxcb-cursor0" in capsys.readouterr().err
