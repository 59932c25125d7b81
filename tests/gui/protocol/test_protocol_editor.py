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
    wait_until(lambda: not panel.worker.is_busy)
    assert 'name = "quick"' in panel.page.editor.text.toPlainText()
    yield panel
    panel.unsaved.hide()
    panel.page.editor.text.document().setModified(False)
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


def _starts(harness: Harness) -> list[str]:
    return [args["protocol"] for command, args in harness.engine.requests if command == "start"]


def test_start_asks_about_changes_that_are_not_saved_and_saves_them_first(
    harness: Harness, panel: ProtocolPanel, tmp_path: Path
) -> None:
    editor, strip, start = panel.page.editor, panel.unsaved, panel.buttons["Start"]
    panel.out.setText(str(tmp_path))
    assert not panel.form.modified.isVisible()
    write(editor, MINE)
    assert panel.form.modified.isVisible()
    harness.update()
    click(start)
    assert strip.isVisible() and "quick has changes that are not saved" in strip.text.text()
    assert not strip.save.isEnabled() and "mistake" in strip.text.text(), "not checked yet"
    click(strip.cancel)
    assert not strip.isVisible() and _starts(harness) == []
    wait_until(editor.save_button.isEnabled)
    editor.path.setText(str(tmp_path / "mine.toml"))
    click(start)
    click(strip.save)
    wait_until(lambda: _starts(harness) == [str(tmp_path / "mine.toml")])
    assert (tmp_path / "mine.toml").read_text() == MINE
    assert panel.plan_rows["Trials"].text() == "2" and not panel.form.modified.isVisible()


def test_the_saved_protocol_runs_where_the_changes_are_left_out(
    harness: Harness, panel: ProtocolPanel
) -> None:
    write(panel.page.editor, MINE)
    harness.update()
    click(panel.buttons["Start"])
    click(panel.unsaved.go_on)
    assert _starts(harness) == [panel.protocol.currentData()]
    assert _starts(harness)[0].endswith("quick.toml") and panel.form.modified.isVisible()
    panel.page.editor.text.undo()
    assert not panel.form.modified.isVisible()
    click(panel.buttons["Start"])
    assert not panel.unsaved.isVisible() and len(_starts(harness)) == 2


def test_changes_that_cannot_be_saved_start_nothing(
    harness: Harness, panel: ProtocolPanel, tmp_path: Path
) -> None:
    editor, taken = panel.page.editor, tmp_path / "taken.toml"
    taken.write_text("mine already")
    write(editor, MINE)
    wait_until(editor.save_button.isEnabled)
    editor.path.setText(str(taken))
    harness.update()
    click(panel.buttons["Start"])
    click(panel.unsaved.save)
    log = harness.window.event_log
    wait_until(lambda: "taken.toml exists: choose another name" in log.toPlainText())
    wait_until(lambda: not panel.worker.is_busy)
    assert _starts(harness) == [] and taken.read_text() == "mine already"


def test_edit_keeps_changes_of_its_file_and_asks_about_those_of_another(
    panel: ProtocolPanel,
) -> None:
    editor = panel.page.editor
    write(editor, MINE)
    panel.show_page(False)
    click(panel.form.edit_button)
    assert panel.shows_page and editor.text.toPlainText() == MINE
    panel.protocol.setCurrentIndex(panel.protocol.findText("baseline"))
    click(panel.form.edit_button)
    assert "quick.toml has changes" in panel.unsaved.text.text()
    assert editor.text.toPlainText() == MINE
    click(panel.unsaved.go_on)
    wait_until(lambda: 'name = "baseline"' in editor.text.toPlainText())


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
