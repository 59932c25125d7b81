"""The Protocol panel: choose a protocol, check its plan, start it and follow the run."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QAbstractButton, QGridLayout, QGroupBox, QVBoxLayout, QWidget

from gui.analysis.tasks.worker import Worker
from gui.protocol.learning_page import LearningLink
from gui.protocol.protocol_form import ProtocolForm
from gui.protocol.run_queue import RunQueue
from gui.protocol.run_state_box import RunStateBox
from gui.protocol.run_values import PlanSummary, ProtocolText, SavedProtocol
from gui.protocol.session_link import SessionLink
from gui.protocol.session_page import SessionPage
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.layouts import group_box, push_button, scroll_to_top, vbox
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.config.rig_config import RigConfig

PAGE_BUTTON, LIVE_BUTTON = "Trials and notes", "Live plots"
_MOVED_BY_HAND = "The drum is moved by hand: wait until that has ended, or press STOP"


class ProtocolPanel(QWidget):
    """Controls for protocols; emits engine commands, and shows the run that the engine reports.

    ``page`` is for the middle of the window.
    """

    command_requested = Signal(str, dict)
    path_requested = Signal(object, object)
    reported = Signal(str, str)
    """Kind and text for the event log."""
    page_changed = Signal()
    """:attr:`shows_page` has changed."""

    def __init__(self) -> None:
        super().__init__()
        self.worker = Worker()
        """Plans the protocol, 24,000 trials take seconds; reads and writes the session's files."""
        self.shows_page = False
        """Whether the middle shows :attr:`page`, and not the live plots."""
        self._can_start = False
        self.form, self.page = ProtocolForm(self.worker), SessionPage()
        self.queue = RunQueue(self.form.start_arguments)
        self.run_box = RunStateBox()
        self.protocol, self.out, self.seed = self.form.protocol, self.form.out, self.form.seed
        self.plan_rows, self.problem = self.form.plan_rows, self.form.problem
        self.open_button, self.out_button = self.form.open_button, self.form.out_button
        self.run_rows, self.bar, self.state = (
            self.run_box.rows,
            self.run_box.bar,
            self.run_box.state,
        )
        self.session_link = SessionLink(self.worker, self.page, self.form.people)
        self.learning_link = LearningLink(self.page.learning)
        self.continue_button = browse_button(
            self.path_requested,
            PathKind.INTERRUPTED,
            self.continue_session,
            "Continue a session …",
        )
        self.page_button = push_button(PAGE_BUTTON, lambda: self.show_page(not self.shows_page))
        self.buttons = {"Start": push_button("Start", self._start)}
        for name in ("Pause", "Resume", "Abort"):
            send = partial(self.command_requested.emit, name.lower(), {})
            self.buttons[name] = push_button(name, send)
        self._editor_tasks: dict[str, Callable[[Any], None]] = {
            "read_protocol": self._edit,
            "check_text": self.page.editor.show_check,
            "save_protocol": self._finish_save,
        }
        self._lay_out()
        self._connect()
        self.show_status(EngineStatus())

    def poll(self) -> None:
        """Process the messages of both worker processes."""
        self.worker.poll()
        self.learning_link.worker.poll()

    def close_workers(self) -> None:
        """End both worker processes."""
        self.worker.cancel()
        self.learning_link.close()

    def add_protocol(self, path: str) -> None:
        """Add a file to the list and choose it."""
        self.form.add_protocol(path)

    def set_rig(self, rig_toml: str) -> None:
        """Plan and check protocols for a rig; for the nominal one without a description."""
        is_nominal = rig_toml == RigConfig().to_toml()
        for part in (self.form, self.page.editor):
            part.set_rig("" if is_nominal else rig_toml)

    def editing_buttons(self) -> tuple[QAbstractButton, ...]:
        """Return the buttons that edit the chosen protocol."""
        editor, steps = self.page.editor, self.page.editor.form.steps
        views = (editor.form_button, editor.text_button, editor.undo_button, editor.redo_button)
        return (self.form.edit_button, *views, editor.save_button, *steps.buttons.values())

    def continue_session(self, folder: str) -> None:
        """Run the remaining trials of a session."""
        args = {"resume": folder, "yes": False, **self.form.people()}
        self.command_requested.emit("start", args)

    def show_page(self, shows_page: bool) -> None:
        """Choose between :attr:`page` and the live plots for the middle."""
        self.shows_page = shows_page
        self.page_button.setText(LIVE_BUTTON if shows_page else PAGE_BUTTON)
        self.page_changed.emit()

    def show_status(self, status: EngineStatus) -> None:
        """Enable the commands that are possible and show the run's progress."""
        run = status.run
        is_connected = status.drum_connected and status.taxels_connected
        is_ready = is_connected and not status.fault and not run.is_active
        self._can_start = is_ready and not status.is_moved_by_hand
        self._enable_start()
        self.continue_button.setEnabled(self._can_start)
        reason = _MOVED_BY_HAND if status.is_moved_by_hand else ""
        self.buttons["Start"].setToolTip(reason)
        self.buttons["Pause"].setEnabled(run.state == "running")
        self.buttons["Resume"].setEnabled(run.state == "paused")
        self.buttons["Abort"].setEnabled(run.is_active)
        self.form.show_finish()
        self.run_box.show_status(status)
        self.session_link.show_run(run)
        self.queue.show_run(run)
        self._arrange(run.is_active)

    def showEvent(self, event: QShowEvent) -> None:
        """Plan the protocol when the panel is visible for the first time."""
        super().showEvent(event)
        if self.form.needs_plan:
            self.form.request_plan()

    def _enable_start(self) -> None:
        can_run = self.form.is_planned and not self.form.current_problem
        self.buttons["Start"].setEnabled(self._can_start and can_run)
        self.queue.set_possible(can_add=can_run, can_start=self._can_start)

    def _start(self) -> None:
        self.command_requested.emit("start", self.form.start_arguments())
        self.form.notes.clear()

    def _finish_task(self, task: str, result: Any) -> None:
        if task == "plan_protocol":
            self.form.finish_plan(result)
        elif task in self._editor_tasks:
            self._editor_tasks[task](result)
        else:
            self.session_link.finish_task(task, result)
        self._submit_next()

    def _fail_task(self, task: str, sentence: str) -> None:
        if task == "plan_protocol":
            self.form.finish_plan(PlanSummary(problem=sentence))
        else:
            self.session_link.fail_task(sentence)
        self._submit_next()

    def _read_protocol(self) -> None:
        """Read the chosen protocol's file for the editor."""
        if path := self.form.protocol.currentData():
            self.worker.submit("read_protocol", path=path)

    def _edit(self, read: ProtocolText) -> None:
        if read.problem:
            self.page.show_problem(read.problem)
            return
        self.page.editor.show_file(read.path, read.text, read.own_path)
        self.page.tabs.setCurrentWidget(self.page.editor)
        self.show_page(True)

    def _finish_save(self, saved: SavedProtocol) -> None:
        self.page.editor.show_saved(saved)
        if not saved.problem and not self.page.editor.is_finger:
            self.form.add_protocol(saved.path)

    def _submit_next(self) -> None:
        self.form.submit_plan()
        self.session_link.submit()

    def _connect(self) -> None:
        self.worker.finished.connect(self._finish_task)
        self.worker.failed.connect(self._fail_task)
        self.form.checked.connect(self._enable_start)
        self.form.planned.connect(self.page.show_plan)
        self.queue.start_requested.connect(partial(self.command_requested.emit, "start"))
        self.session_link.command_requested.connect(self.command_requested)
        self.session_link.advanced.connect(self.learning_link.show_session)
        for link in (self.session_link, self.learning_link):
            link.reported.connect(self.reported)
        self.form.edit_button.clicked.connect(lambda: self._read_protocol())
        editor = self.page.editor
        editor.check_requested.connect(
            lambda text, rig_toml, name: self.worker.submit(
                "check_text", text=text, rig_toml=rig_toml, name=name
            )
        )
        editor.save_requested.connect(
            lambda path, text, may_replace: self.worker.submit(
                "save_protocol", path=path, text=text, may_replace=may_replace
            )
        )
        for source in (self.form, self.page):
            source.path_requested.connect(self.path_requested)

    def _lay_out(self) -> None:
        self._run_group = self._run_box_group()
        self._order: tuple[QWidget, ...] = (self.form, self._run_group, self.queue)
        self._column = vbox(*self._order, spacing=4, margins=(6, 4, 6, 6))
        self._column.addStretch(1)
        self.setLayout(self._column)

    def _arrange(self, is_active: bool) -> None:
        """Put first, where nobody has to scroll for it, the run, or a queue that waits."""
        order: tuple[QWidget, ...] = (self.form, self._run_group, self.queue)
        if is_active:
            order = (self._run_group, self.form, self.queue)
        elif self.queue.waits:
            order = (self.queue, self.form, self._run_group)
        if order != self._order:
            self._order = order
            for place, part in enumerate(order):
                self._column.removeWidget(part)
                self._column.insertWidget(place, part)
            scroll_to_top(self)

    def _run_box_group(self) -> QGroupBox:
        box, column = group_box("Run", QVBoxLayout())
        grid = QGridLayout()
        for place, button in enumerate(self.buttons.values()):
            grid.addWidget(button, place // 2, place % 2)
        column.addLayout(grid)
        column.addLayout(FlowLayout(self.continue_button, self.page_button))
        column.addLayout(self.run_box)
        return box
