"""A protocol in a form and as text: edited, checked while it is written, and saved as a file."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import cached_property, partial
from typing import Any

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import (
    QColor,
    QFontDatabase,
    QKeySequence,
    QShortcut,
    QTextCharFormat,
    QTextCursor,
    QTextFormat,
)
from PySide6.QtWidgets import (
    QButtonGroup,
    QLineEdit,
    QPlainTextEdit,
    QStackedWidget,
    QTextEdit,
    QWidget,
)

from gui.protocol.key_form import NAME as STEPS
from gui.protocol.key_form import KeyForm
from gui.protocol.run_tasks import CheckedText
from gui.widgets.formatting import grouped
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import container, hbox, push_button, scroll_area, vbox
from gui.widgets.theme import applied_theme
from gui.widgets.typed_paths import typed_path
from rigctl.config.rig_config import RigConfig, parse_config
from rigctl.config.toml_edit import insert_table, remove_table, set_key, swap_tables
from rigctl.config.toml_reader import KeyPath
from rigctl.errors import ConfigError, WrongUse
from rigctl.protocol.form_content import NAME, FormContent, read_content


class ProtocolTextEdit(QPlainTextEdit):
    """Edits the text; changes of the form come into the same history of undo."""

    def __init__(self) -> None:
        super().__init__()
        self.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.setTabChangesFocus(True)
        self.marked_line = 0
        """Number of the line that is marked, from 1; 0 for none."""
        self._last: tuple[Hashable, int] = (None, -1)

    def change(self, edited: Callable[[str], str], step: Hashable) -> None:
        """Change the text where ``edited`` returns another one.

        Changes with the same ``step`` directly after each other are undone together.
        """
        before = self.toPlainText()
        after = edited(before)
        if after == before:
            return
        start = _alike(before, after)
        same = _alike(before[start:][::-1], after[start:][::-1])
        cursor = QTextCursor(self.document())
        if self._last == (step, self.document().revision()):
            cursor.joinPreviousEditBlock()
        else:
            cursor.beginEditBlock()
        cursor.setPosition(_units(before[:start]))
        end = _units(before[: len(before) - same])
        cursor.setPosition(end, QTextCursor.MoveMode.KeepAnchor)
        cursor.insertText(after[start : len(after) - same])
        self._last = (step, self.document().revision())
        cursor.endEditBlock()
        self._last = (step, self.document().revision())

    def mark_line(self, number: int) -> None:
        """Mark a line, none for 0."""
        self.marked_line = number
        marks = []
        block = self.document().findBlockByNumber(number - 1)
        if number and block.isValid():
            mark = QTextEdit.ExtraSelection()
            line = QTextCharFormat()
            line.setBackground(QColor(applied_theme().bad_back))
            line.setProperty(QTextFormat.Property.FullWidthSelection, True)
            mark.format, mark.cursor = line, QTextCursor(block)
            marks.append(mark)
        self.setExtraSelections(marks)


def _alike(one: str, other: str) -> int:
    """Return how many letters at the beginning are the same."""
    pairs = enumerate(zip(one, other, strict=False))
    return next((place for place, (a, b) in pairs if a != b), min(len(one), len(other)))


def _units(text: str) -> int:
    """Return the length that Qt counts, in units of UTF-16."""
    return len(text.encode("utf-16-le", "surrogatepass")) // 2


CHECK_MS = 300
"""From the last key to the check."""
MAX_FORM_LETTERS = 32_768
"""A longer text would make the window wait at every key of the form."""
NEW_STEP = {"at": "start", "kind": "tare"}
_WAITS = "The form waits until the text is mended. {problem}"
_TOO_LONG = f"the text has more than {grouped(MAX_FORM_LETTERS)} letters: edit it as text"


class ProtocolEditor(QWidget):
    """Edits one protocol; form and text show the same document."""

    check_requested = Signal(str, str, str)
    """The text, the description of the rig that it is for, and the name of its file."""
    save_requested = Signal(str, str, bool)
    """Path, text, and whether a file of that name may be replaced."""
    modified_changed = Signal()
    """:attr:`is_modified` has changed, or the file."""

    def __init__(self) -> None:
        super().__init__()
        self.text = ProtocolTextEdit()
        self.form = KeyForm(is_finger=False)
        self.waiting = label("", "bad", wraps=True)
        self.views = QStackedWidget()
        self.form_button = push_button("Form", self._show_view, "Edit the protocol in a form")
        self.text_button = push_button("Text", self._show_view, "Edit the protocol as text")
        self.undo_button = push_button("Undo", self.text.undo, "Undo the last change (Ctrl+Z)")
        self.redo_button = push_button("Redo", self.text.redo, "Redo what was undone")
        self.path = QLineEdit()
        self.path.setToolTip("File of the protocol; one of the program is saved as a new file")
        self.save_button = push_button("Save", self.save)
        self.verdict = label("", wraps=True)
        self._content = FormContent()
        self.file = self._own_path = self._saved_text = ""
        self._rig_toml, self._config = "", RigConfig()
        self._is_good = False
        self._timer = QTimer(self, singleShot=True, interval=CHECK_MS)
        self._timer.timeout.connect(self._check)
        self._lay_out()
        self._connect()
        self._show_view()
        self._enable()

    def show_file(self, path: str, text: str, own_path: str) -> None:
        """Show a protocol; ``own_path``: where it may be saved, elsewhere if built in."""
        self._own_path = path if own_path == path else ""
        self.path.setText(own_path)
        self.text.setPlainText(text)
        self.file = path
        self.modified_changed.emit()

    def set_rig(self, rig_toml: str) -> None:
        """Check for a rig, whose limits the form shows; for the nominal one without a text."""
        if rig_toml == self._rig_toml:
            return
        self._rig_toml, self._config = rig_toml, _config_of(rig_toml)
        self.form.set_rig(self._config)
        if self.text.toPlainText():
            self._on_changed()

    def show_check(self, checked: CheckedText) -> None:
        """Show whether the text is a protocol, and what is wrong at its line and its field."""
        if checked.text != self.text.toPlainText():
            return  # of an earlier text
        self._is_good = not checked.problem
        self.show_verdict(checked.problem or checked.summary, is_bad=bool(checked.problem))
        self.text.mark_line(checked.line)
        mistakes = {checked.key_path: checked.reason} if checked.problem else {}
        self._shown_form.show_mistakes(mistakes)
        self._enable()

    def show_saved(self, path: str) -> None:
        """Show that the text was saved as this file."""
        self.file = self._own_path = path
        self.text.document().setModified(self.text.toPlainText() != self._saved_text)
        self.modified_changed.emit()
        self.show_verdict(f"Saved: {path}", is_bad=False)

    @property
    def is_modified(self) -> bool:
        """Whether the text is not that of :attr:`file`."""
        return self.text.document().isModified()

    @property
    def is_checking(self) -> bool:
        """Whether a check of the text is still to be requested."""
        return self._timer.isActive()

    @property
    def is_finger(self) -> bool:
        """Whether the text is a protocol of the moving finger."""
        return self._content.is_finger

    @property
    def _file_name(self) -> str:
        """The name of the file that the text becomes."""
        return typed_path(self.path.text()).name or NAME

    @cached_property
    def finger_form(self) -> KeyForm:
        """The form of the moving finger's protocols, made with the first of these."""
        form = KeyForm(is_finger=True)
        form.edited.connect(self._edit)
        self.views.addWidget(scroll_area(form))
        return form

    @property
    def _shown_form(self) -> KeyForm:
        return self.finger_form if self._content.is_finger else self.form

    def _on_changed(self) -> None:
        self._is_good = False
        self._enable()
        self._show_content()
        self._timer.start()

    def _show_content(self) -> None:
        """Let the form show the text, or say why it waits."""
        text = self.text.toPlainText()
        is_long = len(text) > MAX_FORM_LETTERS
        content = FormContent(problem=_TOO_LONG)
        if not is_long:
            content = read_content(text, self._config, self._file_name)
        if content.problem:
            show_text(self.waiting, _WAITS.format(problem=content.problem))
        else:
            self._content = content
            self._shown_form.show_content(content)
        self.waiting.setVisible(bool(content.problem))
        self._shown_form.setEnabled(not content.problem)
        self._show_view()

    def _show_view(self) -> None:
        place = 2 if self._content.is_finger else 0
        self.views.setCurrentIndex(1 if self.text_button.isChecked() else place)

    def _edit(self, edits: list[tuple[KeyPath, Any]]) -> None:
        def edited(text: str) -> str:
            for path, value in edits:
                text = set_key(text, path, value)
            return text

        self._change(edited, edits[0][0])

    def _change(self, edited: Callable[[str], str], step: Hashable = None) -> None:
        """Change the text as the form asks; where that is impossible, say so and show the text."""
        try:
            self.text.change(edited, step)
        except WrongUse as error:
            self._show_content()
            self.show_verdict(str(error), is_bad=True)

    def _insert_step(self, place: int) -> None:
        self._change(lambda text: insert_table(text, STEPS, place, NEW_STEP))

    def _change_step(self, change: Callable[[str, str, int], str], place: int) -> None:
        self._change(lambda text: change(text, STEPS, place))

    def _check(self) -> None:
        self.check_requested.emit(self.text.toPlainText(), self._rig_toml, self._file_name)

    def save(self) -> None:
        """Ask for the text to be saved."""
        path, self._saved_text = str(typed_path(self.path.text())), self.text.toPlainText()
        self.save_requested.emit(path, self._saved_text, path == self._own_path)

    def show_verdict(self, sentence: str, *, is_bad: bool) -> None:
        """Say whether the text is a protocol, is saved, or why not."""
        show_text(self.verdict, sentence)
        set_property(self.verdict, "role", "bad" if is_bad else "")

    def _enable(self) -> None:
        self.save_button.setEnabled(self._is_good)

    def _connect(self) -> None:
        document, steps = self.text.document(), self.form.steps
        document.undoAvailable.connect(self.undo_button.setEnabled)
        document.redoAvailable.connect(self.redo_button.setEnabled)
        self.text.textChanged.connect(self._on_changed)
        document.modificationChanged.connect(lambda _: self.modified_changed.emit())
        self.form.edited.connect(self._edit)
        _add_shortcut(self.views, QKeySequence.StandardKey.Undo, self.text.undo)
        _add_shortcut(self.views, QKeySequence.StandardKey.Redo, self.text.redo)
        steps.insert_requested.connect(self._insert_step)
        steps.remove_requested.connect(partial(self._change_step, remove_table))
        steps.swap_requested.connect(partial(self._change_step, swap_tables))

    def _lay_out(self) -> None:
        self.waiting.hide()
        group = QButtonGroup(self)
        for button in (self.form_button, self.text_button):
            button.setCheckable(True)
            group.addButton(button)
        self.form_button.setChecked(True)
        for button in (self.undo_button, self.redo_button):
            button.setEnabled(False)
        for view in (scroll_area(self.form), self.text):
            self.views.addWidget(view)
        top = hbox(
            self.form_button, self.text_button, self.undo_button, self.redo_button,
            wide=-1, spacing=6,
        )  # fmt: skip
        bottom = hbox(label("Save as"), self.path, self.save_button, wide=1, spacing=6)
        rows = (container(top), self.waiting, self.views, self.verdict, container(bottom))
        self.setLayout(vbox(*rows, spacing=4, tall=2))


def _config_of(rig_toml: str) -> RigConfig:
    """Return a rig; the nominal one for a description that only another version reads."""
    try:
        return parse_config(rig_toml)
    except ConfigError:
        return RigConfig()


def _add_shortcut(
    widget: QWidget, key: QKeySequence.StandardKey, slot: Callable[[], object]
) -> None:
    """Let a key work in a widget and what it holds, and nowhere else."""
    shortcut = QShortcut(key, widget)
    shortcut.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)
    shortcut.activated.connect(slot)
