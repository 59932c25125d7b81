"""A protocol is edited as text, checked while it is written, and saved."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from gui.protocol.protocol_editor import ProtocolEditor
from gui.protocol.protocol_panel import ProtocolPanel
from rigctl.config import resources
from rigctl.config.rig_config import RigConfig
from tests.gui.protocol.test_protocol_panel import open_panel
from tests.gui.steps import Harness, click, wait_until

MINE = """name = "mine"
textures = ["A", "B"]
speeds_mm_s = [80]
forces_g = [500]
"""


@pytest.fixture
def panel(harness: Harness) -> Iterator[ProtocolPanel]:
    """Yield the panel with the quick protocol in the editor."""
    panel = open_panel(harness)
    click(panel.form.edit_button)
    wait_until(lambda: 'name = "quick"' in panel.page.editor.text.toPlainText())
    yield panel
    panel.show_page(False)
    panel.protocol.setCurrentIndex(panel.protocol.findText("quick"))
    wait_until(lambda: not panel.worker.is_busy)


def write(editor: ProtocolEditor, text: str) -> None:
    editor.text.selectAll()
    editor.text.insertPlainText(text)


def test_the_line_of_an_error_is_marked_until_it_is_mended(panel: ProtocolPanel) -> None:
    editor = panel.page.editor
    write(editor, MINE.replace("80", "8000"))
    wait_until(lambda: editor.text.marked_line == 3)
    assert editor.verdict.text().startswith("quick.toml, line 3: speeds_mm_s: 8000 is outside")
    assert not editor.save_button.isEnabled()
    write(editor, MINE + "x = [\n")
    wait_until(lambda: "quick.toml: this is not TOML" in editor.verdict.text())
    assert "quick.toml: this is not TOML" in editor.waiting.text()
    assert not editor.save_button.isEnabled()
    write(editor, MINE)
    wait_until(editor.save_button.isEnabled)
    assert editor.text.marked_line == 0
    assert editor.verdict.text().startswith("No errors: 2 trials, 2 plate changes")


def test_plan_and_check_have_the_limits_of_the_connected_rig(
    harness: Harness, panel: ProtocolPanel
) -> None:
    editor = panel.page.editor
    write(editor, MINE + '[[steps]]\nat = "start"\nkind = "turn"\nspeed_mm_s = 75\nturns = 1\n')
    wait_until(editor.save_button.isEnabled)
    harness.engine.send_event("ready", "", rig="virtual", rig_toml=RigConfig().to_toml())
    harness.window.poll()
    assert editor.save_button.isEnabled(), "the nominal rig changes nothing"
    limits = "[limits]\nspeed_max_mm_s = 70\nforce_max_g = 1500\nover_force_g = 2000\n"
    harness.engine.send_event("ready", "", rig="bench", rig_toml=limits)
    harness.window.poll()
    form = editor.form
    assert form.rows["speeds_mm_s",].mistake == "80 is outside 20 to 70 mm/s"
    assert "50 to 1\u202f500 g" in form.rows["forces_g",].note.text()
    assert form.steps.of_kind["turn"][0].mistake == "75 is outside 20 to 70 mm/s"
    wait_until(lambda: "speeds_mm_s: 80 is outside 20 to 70" in editor.verdict.text())
    wait_until(lambda: "is outside 20 to 70 mm/s" in panel.problem.text())
    assert not panel.buttons["Start"].isEnabled()
    harness.window.engine_link.close()
    assert not form.rows["speeds_mm_s",].mistake
    wait_until(editor.save_button.isEnabled)
    wait_until(lambda: not panel.problem.isVisible() and not panel.worker.is_busy)


def test_a_changed_protocol_becomes_a_file_of_the_user(
    harness: Harness, panel: ProtocolPanel, tmp_path: Path
) -> None:
    editor, built_in = panel.page.editor, resources.protocols() / "quick.toml"
    before = built_in.read_text()
    assert Path(editor.path.text()).parent == Path.home() / "rigctl-protocols"
    write(editor, MINE)
    wait_until(editor.save_button.isEnabled)
    path = tmp_path / "new" / "mine.toml"
    editor.path.setText(str(path))
    click(editor.save_button)
    wait_until(lambda: panel.protocol.currentData() == str(path))
    assert path.read_text() == MINE and built_in.read_text() == before
    wait_until(lambda: panel.plan_rows["Trials"].text() == "2")
    write(editor, MINE.replace("80", "40, 80"))
    wait_until(editor.save_button.isEnabled)
    click(editor.save_button)
    wait_until(lambda: panel.plan_rows["Trials"].text() == "4")


@pytest.mark.parametrize(
    ("path", "sentence"),
    [
        ("mine.toml", "whole path"),
        ("{folder}/mine.txt", ".toml"),
        ("{folder}/taken.toml", "exists"),
        ("{folder}/unwritable.toml", "unwritable.toml cannot be written"),
    ],
)
def test_a_place_that_is_taken_or_none_is_refused(
    panel: ProtocolPanel, tmp_path: Path, path: str, sentence: str
) -> None:
    (tmp_path / "taken.toml").write_text("mine already")
    (tmp_path / "unwritable.toml.partial").mkdir()
    before = set(tmp_path.iterdir())
    editor = panel.page.editor
    write(editor, MINE)
    wait_until(editor.save_button.isEnabled)
    editor.path.setText(path.format(folder=tmp_path))
    click(editor.save_button)
    wait_until(lambda: sentence in editor.verdict.text())
    assert (tmp_path / "taken.toml").read_text() == "mine already"
    assert set(tmp_path.iterdir()) == before
