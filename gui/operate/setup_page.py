"""The page Set up: the parts of a rig, one at a time, with what is expected and what was found."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QLineEdit, QListWidget, QListWidgetItem, QPushButton, QWidget

from gui.operate.boards_box import BoardsBox
from gui.operate.calibrate import common_obstacle
from gui.operate.part_picture import CellTrace, PartDrawing
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import FlowLayout, container, hbox, push_button, vbox
from rigctl.engine.rpc.messages import EngineStatus
from rigctl.engine.setup.setup_status import FORCE, PartStatus, SetupStatus

COMMANDS = frozenset(
    {
        "setup_open", "setup_check", "setup_answer", "setup_keep", "setup_begin_again",
        "setup_commission",
    }
)  # fmt: skip
"""The engine's commands of this page."""
FIRMWARE = "firmware"
MARKS = {"open": "○", "right": "✓", "wrong": "✗"}
WORDS = {"open": "not checked yet", "right": "right", "wrong": "wrong"}
DRUM_LOST = (
    "The drum board does not answer: check its cable; or disconnect, and find or flash the boards "
    "here."
)
INTRODUCTION = (
    "Each part is checked alone before anything may press. You can leave at any part and go on "
    "another day; what has passed lies beside rig.toml."
)
ALL_PASSED = "All parts are right and the board is commissioned: run a protocol."
KEEP_TIP = "Let rig.toml describe the part as it is wired, where it can"
WIDEST = "✓ 99  Load cell with known masses"
WITHOUT_TIP = "For the experienced: the board presses at once, whatever nobody has checked"
_ROLE = Qt.ItemDataRole.UserRole


class SetupPage(QWidget):
    """A list of the parts, and the chosen one; it shows what the engine knows, whoever asked."""

    command_requested = Signal(str, dict)
    """The engine's command and its arguments."""
    closed = Signal()
    """The user leaves; what has passed is kept."""
    flash_requested = Signal()
    """The user wants to flash the boards of the connected rig."""

    def __init__(self, boards: BoardsBox) -> None:
        super().__init__()
        self.boards = boards
        self._setup = SetupStatus()
        self._obstacle = DRUM_LOST
        self._refusal, self._asked_id = "", 0
        self._was_connected = self._is_simulated = self._had_fault = self._is_measuring = False
        self.list = QListWidget()
        self.list.setAccessibleName("Parts of the setup")
        self.list.currentRowChanged.connect(lambda _: self._show_part())
        self.drawing, self.trace = PartDrawing(), CellTrace()
        self.title, self.state = label("", "heading", wraps=True), label("", "muted", wraps=True)
        self.expected, self.found = label("", wraps=True), label("", wraps=True)
        self.problem = label("", "bad", wraps=True)
        self.question = label("", "heading", wraps=True)
        self.answer = QLineEdit()
        self.answer.setAccessibleName("Answer")
        self.unit = label()
        self.answer.returnPressed.connect(lambda: self._answer(self.answer.text()))
        self.answer_buttons: list[QPushButton] = []
        self._answers = FlowLayout()
        self._add_buttons()
        self._lay_out()
        self.show_status(EngineStatus())

    @property
    def controls(self) -> list[QWidget]:
        """What acts on the rig."""
        buttons = (self.check_button, self.keep_button, self.again_button, self.without_button)
        return [*buttons, self.cancel_button, self.answer]

    @property
    def part(self) -> PartStatus:
        """The chosen part; one without a name before the setup is open."""
        row = self.list.currentRow()
        return self._setup.parts[row] if 0 <= row < len(self._setup.parts) else PartStatus()

    def open(self) -> None:
        """Ask the engine how far the setup has come, unless it is known."""
        if not self._obstacle and not self._setup.parts:
            self._send("setup_open")

    def show_status(self, status: EngineStatus) -> None:
        """Show what has been checked and what is possible now."""
        self.trace.add(status)
        self.boards.setVisible(not status.rig)
        self.parts.setVisible(bool(status.rig))
        self._is_simulated = status.simulated
        if not status.drum_connected or (self._had_fault and not status.fault):
            self._refusal = ""  # of another connection, or of a fault that is cleared
        self._had_fault = bool(status.fault)
        self._obstacle = common_obstacle(status) if status.drum_connected else DRUM_LOST
        if status.fault:
            self._obstacle = ""  # the parts name what is behind a fault
        if status.drum_connected and not self._was_connected and self.isVisible():
            self.open()
        self._was_connected = status.drum_connected
        self._is_measuring = bool(status.calibration.measuring)  # also while a part is kept
        before, self._setup = self._setup, status.setup
        if before != self._setup:
            self._show_list(before)
        self._show_part()

    def show_refusal(self, command: str, sentence: str) -> None:
        """Show why the engine refused a command of this page."""
        if command in COMMANDS:
            self._refusal = sentence
            self._show_part()

    def _add_buttons(self) -> None:
        self.check_button = push_button("Check", self._check, "Check this part now")
        self.cancel_button = push_button("Stop the check", self._cancel, "The drum lifts and stops")
        self.keep_button = push_button("Keep it so", self._keep, KEEP_TIP)
        self.flash_button = push_button(
            "Flash the boards …", self.flash_requested.emit, "Disconnect, then write their firmware"
        )
        self.back_button = push_button("Back", lambda: self._move(-1), "The part before")
        self.next_button = push_button("Next", lambda: self._move(1), "The part after")
        self.leave_button = push_button("Leave", self._leave, "Go on another time")
        self.again_button = push_button(
            "Begin again", lambda: self._send("setup_begin_again"), "Forget what has passed"
        )
        self.without_button = push_button(
            "Commission without", lambda: self._send("setup_commission"), WITHOUT_TIP
        )

    def _lay_out(self) -> None:
        heading = hbox(label("Set up", "heading"), self.leave_button, spacing=8)
        to_part = (self.check_button, self.cancel_button, self.keep_button, self.flash_button)
        check = FlowLayout(*to_part)
        moves = FlowLayout(self.back_button, self.next_button)
        all_of_it = FlowLayout(self.again_button, self.without_button)
        self.answers_box = container(self._answers)
        right = vbox(
            *(self.title, self.drawing, self.trace, self.question),
            *(hbox(self.answer, self.unit, spacing=6), self.answers_box),
            *(self.expected, self.found, self.problem, self.state, check, moves),
            spacing=6,
            tall=1,
        )
        right.insertStretch(right.indexOf(check) + 1, 0)  # the way on keeps its place
        left = vbox(self.list, all_of_it, spacing=6, tall=0)
        self.parts = container(hbox(left, right, spacing=12, wide=1))
        self.introduction = label(INTRODUCTION, "muted", wraps=True)
        rows = (heading, self.introduction, self.boards, self.parts)
        column = vbox(*rows, spacing=6, margins=(9, 4, 9, 4), tall=2)
        column.setStretch(3, 1)
        self.setLayout(column)
        bar_px = self.list.verticalScrollBar().sizeHint().width()
        self.list.setFixedWidth(self.fontMetrics().horizontalAdvance(WIDEST) + bar_px + 24)

    def _show_list(self, before: SetupStatus) -> None:
        """Show the parts with their marks; go to the one that is checked, or to the first open."""
        names = [part.name for part in self._setup.parts]
        if names != [part.name for part in before.parts]:
            self.list.clear()
            self.list.addItems(names)
            states = [part.state for part in self._setup.parts]
            first = next((i for i, state in enumerate(states) if state != "right"), 0)
            self.list.setCurrentRow(first if names else -1)
        for number, part in enumerate(self._setup.parts):
            item = self.list.item(number)
            assert isinstance(item, QListWidgetItem)
            item.setText(f"{MARKS[part.state]} {number + 1}  {part.title}")
            item.setData(_ROLE, part.name)
            item.setToolTip(f"{part.title}: {WORDS[part.state]}")
        if self._setup.checking in names:
            self.list.setCurrentRow(names.index(self._setup.checking))

    def _show_part(self) -> None:
        part, setup = self.part, self._setup
        is_free = not (self._obstacle or self._is_measuring or setup.checking) and bool(part.name)
        show_text(self.title, part.title or "Set a rig up")
        show_text(self.expected, f"Expected: {part.expected}" if part.expected else "")
        show_text(self.found, f"Found: {part.found}" if part.found else "")
        show_text(self.problem, part.problem)
        self._show_picture(setup.picture or part.picture)
        self._show_question()
        self._show_state(part)
        self.check_button.setEnabled(is_free)
        self.check_button.setText("Check again" if part.state != "open" else "Check")
        self.cancel_button.setEnabled(bool(setup.checking))
        self.keep_button.setEnabled(is_free and bool(part.remedy))
        is_other_build = part.name == FIRMWARE and part.state == "wrong"
        self.flash_button.setVisible(is_other_build and not self._is_simulated)
        self.flash_button.setEnabled(not setup.checking)
        self.keep_button.setToolTip(f"Let rig.toml say {part.remedy}" if part.remedy else KEEP_TIP)
        row = self.list.currentRow()
        self.back_button.setEnabled(row > 0 and not setup.checking)
        self.next_button.setEnabled(0 <= row < len(setup.parts) - 1 and not setup.checking)
        self.again_button.setEnabled(is_free)
        self.without_button.setEnabled(is_free)
        self.list.setEnabled(not setup.checking)

    def _show_picture(self, picture: str) -> None:
        is_plot = picture == FORCE
        self.drawing.setVisible(bool(picture) and not is_plot)
        self.trace.setVisible(is_plot or "load-cell" in picture)
        if not is_plot:
            self.drawing.show_part(picture)

    def _show_question(self) -> None:
        """Show the question of the check, with a button for each answer or a field for a number."""
        setup = self._setup
        show_text(self.question, setup.question)
        asks_number = bool(setup.question) and not setup.choices
        self.answer.setVisible(asks_number)
        show_text(self.unit, setup.unit if asks_number else "")
        self.answers_box.setVisible(bool(setup.question))
        if setup.question_id == self._asked_id:
            return
        self._asked_id, self._refusal = setup.question_id, ""
        for button in self.answer_buttons:
            self._answers.removeWidget(button)
            button.deleteLater()
        self.answer.setText(setup.known if asks_number else "")
        texts = setup.choices or ("answer",)
        self.answer_buttons = [self._answer_button(text, asks_number) for text in texts]
        for button in self.answer_buttons:
            self._answers.addWidget(button)
        (self.answer if asks_number else self.answer_buttons[0]).setFocus()

    def _answer_button(self, text: str, asks_number: bool) -> QPushButton:
        known = self._setup.known
        tip = f"The simulated bench says: {known}" if known else ""
        is_told = text == known and len(self._setup.choices) > 1
        shown = f"{text.capitalize()}{' (simulated)' if is_told else ''}"

        def answer() -> None:
            self._answer(self.answer.text() if asks_number else text)

        return push_button(shown, answer, tip)

    def _show_state(self, part: PartStatus) -> None:
        text, role = self._obstacle, "muted"
        if self._refusal:
            text, role = self._refusal, "bad"
        elif self._setup.checking and not self._setup.question:
            text = "Checking …"
        elif not text and self._setup.remarks:
            text = self._setup.remarks[0]
        elif not text and self._setup.parts and all(p.state == "right" for p in self._setup.parts):
            text = ALL_PASSED
        elif not text and part.state == "right":
            text = "This part is right."
        show_text(self.state, text)
        set_property(self.state, "role", role)

    def _move(self, by: int) -> None:
        self._refusal = ""
        self.list.setCurrentRow(self.list.currentRow() + by)

    def _check(self) -> None:
        self._send("setup_check", part=self.part.name)

    def _keep(self) -> None:
        self._send("setup_keep", part=self.part.name)

    def _cancel(self) -> None:
        self._send("cancel_calibration")

    def _answer(self, text: str) -> None:
        self._send("setup_answer", question_id=self._setup.question_id, text=text)

    def _leave(self) -> None:
        if self._setup.checking:
            self._cancel()
        self.closed.emit()

    def _send(self, command: str, **args: Any) -> None:
        self._refusal = ""
        self.command_requested.emit(command, args)
