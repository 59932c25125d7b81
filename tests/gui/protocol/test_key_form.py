"""A protocol is edited in a form; form and text are two views of one document."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QComboBox, QPlainTextEdit, QWidget

from gui.protocol.key_form import KeyRow
from gui.protocol.protocol_editor import ProtocolEditor
from gui.protocol.protocol_panel import ProtocolPanel
from rigctl.config import resources
from rigctl.config.toml_reader import KeyPath
from tests.gui.protocol.test_protocol_editor import write
from tests.gui.protocol.test_protocol_panel import open_panel
from tests.gui.steps import Harness, click, wait_until


@pytest.fixture
def panel(harness: Harness) -> Iterator[ProtocolPanel]:
    """Yield the panel with the showcase in the form of the editor."""
    panel = open_panel(harness)
    panel.protocol.setCurrentIndex(panel.protocol.findText("showcase"))
    wait_until(lambda: not panel.worker.is_busy)
    click(panel.form.edit_button)
    editor = panel.page.editor
    wait_until(lambda: not panel.worker.is_busy)
    assert 'name = "showcase"' in editor.text.toPlainText()
    click(editor.form_button)
    wait_until(editor.save_button.isEnabled)
    yield panel
    editor.text.document().setModified(False)  # the next test begins with the file
    click(editor.form_button)
    panel.show_page(False)
    panel.protocol.setCurrentIndex(panel.protocol.findText("quick"))
    wait_until(lambda: not panel.worker.is_busy)


@pytest.fixture
def editor(panel: ProtocolPanel) -> ProtocolEditor:
    """Return the editor."""
    return panel.page.editor


def row(editor: ProtocolEditor, *path: str) -> KeyRow:
    return editor.form.rows[path]


def fill(field: QWidget, text: str) -> None:
    """Replace what a field has by keys."""
    field.activateWindow()
    field.setFocus()
    wait_until(field.hasFocus)  # the window of another test may have been active
    QTest.keyClick(field, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier)
    QTest.keyClicks(field, text)


def written(editor: ProtocolEditor, *path: str | int) -> object:
    """Return the value of a key in the text, None if it is missing."""
    value: object = tomllib.loads(editor.text.toPlainText())
    for part in path:
        if isinstance(value, dict):
            value = value.get(str(part))
        elif isinstance(value, list):
            value = value[int(part)]
    return value


def test_what_is_typed_stands_in_the_text_and_comments_stay(editor: ProtocolEditor) -> None:
    before = editor.text.toPlainText()
    fill(row(editor, "speeds_mm_s").field, "40, 60, 80")
    assert editor.text.toPlainText() == before.replace("[60, 120]", "[40, 60, 80]")
    wait_until(editor.save_button.isEnabled)
    assert "18 trials, 3 plate changes" in editor.verdict.text() and "MB" in editor.verdict.text()
    fill(row(editor, "settle", "band_percent").field, "3")
    assert "band_percent = 3\n" in editor.text.toPlainText()


def test_a_mistake_stands_beside_its_field_as_it_is_typed(editor: ProtocolEditor) -> None:
    speeds, travel = row(editor, "speeds_mm_s"), row(editor, "trial", "travel_mm")
    fill(speeds.field, "40, 8000")
    assert speeds.mistake == "8000 is outside 20 to 150 mm/s"
    fill(speeds.field, "40, fast")
    assert speeds.mistake == "must be a number, not 'fast'"
    fill(speeds.field, "60 120")
    assert speeds.mistake == "'60 120' is not one number: separate numbers by commas"
    assert row(editor, "textures").name.text() == "Plates"
    fill(travel.field, "x")
    assert travel.mistake == "must be a number, not 'x'"
    assert not editor.save_button.isEnabled()
    fill(speeds.field, "40")
    assert not speeds.mistake
    fill(travel.field, "360")
    wait_until(lambda: "do not fit on the plate" in travel.mistake)  # a check of several keys
    fill(travel.field, "100")
    wait_until(editor.save_button.isEnabled)
    assert not travel.mistake


def test_a_decimal_comma_is_a_point_and_group_marks_are_refused(editor: ProtocolEditor) -> None:
    speeds, travel = row(editor, "speeds_mm_s"), row(editor, "trial", "travel_mm")
    fill(travel.field, "12,5")
    assert written(editor, "trial", "travel_mm") == 12.5
    for typed in ("1.000,5", "1'000", "1 000"):
        fill(travel.field, typed)
        words = f"must be a number, not {typed!r}: leave out the marks between groups of digits"
        assert travel.mistake == words
    fill(travel.field, "100")
    fill(speeds.field, "40,60")
    words = "40,60 may be one number or more: type 40, 60 or use a decimal point"
    assert speeds.mistake == words
    for typed in ("40, 60.5", "40; 60,5"):
        fill(speeds.field, typed)
        assert written(editor, "speeds_mm_s") == [40, 60.5]


def test_the_help_of_a_field_names_its_whole_range(editor: ProtocolEditor) -> None:
    assert (
        "0 to 9\u202f223\u202f372\u202f036\u202f854\u202f775\u202f807; default 0"
        in row(editor, "order", "seed").note.text()
    )


def test_an_emptied_field_is_left_out_and_shows_its_default(editor: ProtocolEditor) -> None:
    travel = row(editor, "trial", "travel_mm")
    fill(travel.field, "")
    QTest.keyClick(travel.field, Qt.Key.Key_Backspace)
    QTest.keyClick(travel.field, Qt.Key.Key_Return)
    assert written(editor, "trial", "travel_mm") is None
    assert travel.field.property("placeholderText") == "240" and not travel.mistake


def test_a_description_has_lines_in_form_and_text(editor: ProtocolEditor) -> None:
    before, lines = editor.text.toPlainText(), row(editor, "description").field
    fill(lines, "Every feature,")
    QTest.keyClick(lines, Qt.Key.Key_Return)
    QTest.keyClicks(lines, 'in "twelve" trials')
    assert 'description = """\nEvery feature,\nin "twelve" trials"""\n' in editor.text.toPlainText()
    assert written(editor, "description") == 'Every feature,\nin "twelve" trials'
    wait_until(editor.save_button.isEnabled)
    QTest.keyClick(lines, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert editor.text.toPlainText() == before
    assert isinstance(lines, QPlainTextEdit)
    assert lines.toPlainText() == "Every feature of a protocol, in twelve trials"
    fill(lines, "x")
    QTest.keyClick(lines, Qt.Key.Key_Backspace)
    assert written(editor, "description") == ""
    QTest.keyClick(lines, Qt.Key.Key_Tab)
    wait_until(lambda: written(editor, "description") is None)


def test_choices_and_flags_are_set_by_keys(editor: ProtocolEditor) -> None:
    kind, across = row(editor, "order", "kind").field, row(editor, "order", "across_plates").field
    QTest.keyClick(across, Qt.Key.Key_Space)
    assert written(editor, "order", "across_plates") is True
    wait_until(lambda: "12 plate changes" in editor.verdict.text() or editor._is_good)
    QTest.keyClick(kind, Qt.Key.Key_B)
    assert written(editor, "order", "kind") == "blocked"
    wait_until(lambda: bool(row(editor, "order", "across_plates").mistake))
    QTest.keyClick(across, Qt.Key.Key_Space)
    wait_until(editor.save_button.isEnabled)


def test_both_views_share_undo_and_redo(editor: ProtocolEditor) -> None:
    before = editor.text.toPlainText()
    repeats = row(editor, "repeats").field
    fill(repeats, "12")
    assert written(editor, "repeats") == 12
    QTest.keyClick(repeats, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert editor.text.toPlainText() == before and repeats.property("text") == "2"
    click(editor.redo_button)
    assert repeats.property("text") == "12"
    click(editor.text_button)
    assert editor.text.isVisible()
    QTest.keyClick(editor.text, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    click(editor.form_button)
    assert repeats.property("text") == "2" and not editor.text.isVisible()


def test_the_form_waits_for_a_text_with_an_error(editor: ProtocolEditor) -> None:
    click(editor.text_button)
    write(editor, 'name = "mine"\ntextures = oops\n')
    wait_until(lambda: editor.text.marked_line > 0)
    click(editor.form_button)
    assert editor.waiting.isVisible() and not editor.form.isEnabled()
    assert "not TOML" in editor.waiting.text() and "line" in editor.waiting.text()
    click(editor.undo_button)
    assert not editor.waiting.isVisible() and editor.form.isEnabled()


def test_a_key_that_the_form_does_not_know_stays(editor: ProtocolEditor) -> None:
    write(editor, "mine = 5  # ours\n" + editor.text.toPlainText())
    fill(row(editor, "repeats").field, "3")
    assert editor.text.toPlainText().startswith("mine = 5  # ours\n")
    wait_until(lambda: "line 1: mine: unknown key" in editor.verdict.text())


def test_steps_are_added_edited_moved_and_removed(editor: ProtocolEditor) -> None:
    steps = editor.form.steps
    assert steps.list.count() == 8
    assert steps.list.item(4).text() == "5. every 3 trials: rest 2 s"
    steps.list.setFocus()
    QTest.keyClick(steps.list, Qt.Key.Key_End)
    QTest.keyClick(steps.buttons["Add"], Qt.Key.Key_Space)
    assert steps.place == 8 and written(editor, "steps", 8) == {"at": "start", "kind": "tare"}
    choose(steps.kind, "approach_only")
    force, seconds = steps.of_kind["approach_only"]
    assert force.field.isVisible() and force.mistake == "is missing"
    fill(force.field, "400")
    fill(seconds.field, "1.5")
    expected = {"at": "start", "kind": "approach_only", "force_g": 400, "seconds": 1.5}
    assert written(editor, "steps", 8) == expected
    click(steps.buttons["Up"])
    assert steps.place == 7 and written(editor, "steps", 7) == expected
    choose(steps.kind, "message")
    assert written(editor, "steps", 7) == {"at": "start", "kind": "message"}
    click(steps.buttons["Remove"])
    wait_until(editor.save_button.isEnabled)
    assert steps.list.count() == 8


def test_another_place_drops_the_count_of_trials(editor: ProtocolEditor) -> None:
    steps = editor.form.steps
    steps.choose(4)
    assert steps.of_place["every"].field.isVisible()
    choose(steps.at, "end")
    assert written(editor, "steps", 4) == {"at": "end", "kind": "rest", "seconds": 2}
    assert not steps.of_place["every"].field.isVisible()
    choose(steps.at, "drift")
    limit = steps.of_place["drift"]
    assert limit.field.isVisible() and limit.mistake == "is missing"
    fill(limit.field, "2.5")
    choose(steps.kind, "tare")
    assert written(editor, "steps", 4) == {"at": "drift", "kind": "tare", "limit_g": 2.5}
    assert steps.list.item(4).text() == "5. drift 2.5 g: tare"


def choose(row: KeyRow, word: str) -> None:
    """Choose a word of a list by the arrow keys."""
    assert isinstance(row.field, QComboBox)
    row.field.setFocus()
    by = row.field.findText(word) - row.field.currentIndex()
    for _ in range(abs(by)):
        QTest.keyClick(row.field, Qt.Key.Key_Down if by > 0 else Qt.Key.Key_Up)
    assert row.field.currentText() == word


def test_a_protocol_of_the_finger_has_its_own_form(panel: ProtocolPanel) -> None:
    editor = panel.page.editor
    write(editor, (resources.finger_protocols() / "quick.toml").read_text(encoding="utf-8"))
    wait_until(editor.save_button.isEnabled)
    assert "200 scans of the moving finger" in editor.verdict.text()
    path: KeyPath = ("stages", "train")
    train = editor.finger_form.rows[path]
    assert train.field.isVisible()
    fill(train.field, "1")
    wait_until(lambda: "125 scans" in editor.verdict.text())
    fill(editor.finger_form.rows["profiles",].field, "slow, hasty")
    assert "'hasty' is none of slow" in editor.finger_form.rows["profiles",].mistake
