"""Protocols with errors: a sentence in place, and the window goes on."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.gui.steps import Harness, wait_until


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name = 'x'\ntextures = [\n", "end of document"),
        ("name = 'x'\ntextures = ['A']\nspeeds_mm_s = [80]\nforces_g = ['much']\n", "forces_g"),
        ("name = 'x'\ntextures = ['A']\nspeeds_mm_s = [80]\nforce_g = [500]\n", "force_g"),
        ("\0\1\2", "line"),
    ],
)
def test_a_protocol_with_errors_says_where_and_cannot_start(
    harness: Harness, tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    panel = harness.window.protocol_panel
    harness.window.show_panel("protocol")
    panel.add_protocol(str(path))
    wait_until(lambda: "wrong.toml" in panel.problem.text())
    harness.update()
    assert words in panel.problem.text() and "Traceback" not in panel.problem.text()
    assert not panel.buttons["Start"].isEnabled()
    panel.protocol.setCurrentIndex(0)
    wait_until(lambda: not panel.problem.text() and not panel.worker.is_busy)
