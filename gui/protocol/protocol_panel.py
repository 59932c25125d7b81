"""The Protocol panel: choose a protocol, check its plan, start it and follow the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QGridLayout,
    QGroupBox,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from gui.analysis.worker import Worker
from gui.live.health import lasting_words
from gui.operate.alarms import run_end_words
from gui.protocol.about_fields import MAX_NOTE_LETTERS, OwnFields, about_fields, about_title
from gui.protocol.run_tasks import DISK_ROW, PLAN_ROWS, PlanSummary, ProtocolText
from gui.protocol.session_page import SessionPage
from gui.widgets.file_browser import ElidedComboBox, PathKind, browse_button
from gui.widgets.formatting import (
    capitalised,
    day_time,
    duration,
    grouped,
    size,
    time_stamp,
)
from gui.widgets.labels import (
    Strip,
    label,
    plain_tooltip,
    set_property,
    show_progress,
    show_text,
    show_tooltip,
)
from gui.widgets.layouts import (
    FlowLayout,
    form_layout,
    group_box,
    hbox,
    push_button,
    scroll_to_top,
    vbox,
)
from gui.widgets.number_box import WholeNumberBox
from gui.widgets.plates import World, plate_words, texture_words
from gui.widgets.theme import scaled_px
from gui.widgets.typed_paths import folder_problem, new_files_folder, typed_path
from rigctl.config import resources
from rigctl.config.rig_config import RigConfig
from rigctl.engine.rpc.messages import (
    EngineStatus,
    QueuedRunStatus,
    QueueStatus,
    RecordingStatus,
    RunStatus,
    reason_words,
)
from rigctl.finger.status import FingerRunStatus

MAX_SEED = 2**31 - 1
FINISH_ROW = "Would finish"


class ProtocolForm(QWidget):
    """The fields of a run and the plan that they make; the worker makes it."""

    path_requested = Signal(object, object)
    checked = Signal()
    """The plan, the folder or the problem has changed."""
    planned = Signal(object)
    """The summary of a plan that can run."""

    def __init__(self, worker: Worker) -> None:
        super().__init__()
        self._worker = worker
        self._next_plan: tuple[str, int | None] | None = None
        self._plan = PlanSummary()
        self._rig_toml, self._was_requested = "", False
        self._free_bytes: int | None = None
        self._needs_space = False
        self._recording = RecordingStatus()
        self._world: World = None
        self.is_planned = False
        self.protocol = ElidedComboBox()
        self.out = QLineEdit(str(Path.home() / "rigctl-sessions"))
        self.out.setToolTip("Every session gets a new folder in here")
        self.seed = WholeNumberBox(maximum=MAX_SEED)
        self.seed.setToolTip("Seed of the random order of trials; stored with the session")
        self.about, self.own = about_fields("rig.toml"), OwnFields()
        self.operator, self.sensor = self.about["operator"], self.about["sensor"]
        self.notes = QLineEdit(maxLength=MAX_NOTE_LETTERS)
        self.notes.setToolTip("Becomes the first note of the session")
        requested = self.path_requested
        self.open_button = browse_button(requested, PathKind.PROTOCOL, self.add_protocol)
        self.out_button = browse_button(requested, PathKind.OUTPUT, self.out.setText)
        self.modified = label("modified", "bad")
        self.modified.setToolTip("The editor has changes of this file that are not saved")
        self.edit_button = QPushButton("Edit")
        self.edit_button.setToolTip(
            "Edit in a form or as text; a protocol of the program is saved anew"
        )
        self.description = label("", wraps=True)
        self.plan_rows = {name: label("–", wraps=True) for name in (*PLAN_ROWS, FINISH_ROW)}
        self.problem = label("", "bad", wraps=True)
        self._lay_out()
        self._connect()
        self._list_protocols()

    def add_protocol(self, path: str) -> None:
        """Add a file to the list and choose it; plan it again if it is chosen already."""
        place = self.protocol.findData(path)
        if place < 0:
            self.protocol.addItem(Path(path).name, path)
            place = self.protocol.findData(path)
        if place == self.protocol.currentIndex():
            self.request_plan()
        self.protocol.setCurrentIndex(place)

    def set_world(self, world: World) -> None:
        """Name the plates of another rig in the tooltip of their letters."""
        self._world = world
        self._show_plates()

    def _show_plates(self) -> None:
        lines = [plate_words(name, self._world) for name in self._plan.plates]
        self.plan_rows["Plates"].setToolTip(plain_tooltip("\n".join(lines)))

    def set_rig(self, rig_toml: str) -> None:
        """Plan for a rig; for the nominal one without a description."""
        if rig_toml != self._rig_toml:
            self._rig_toml = rig_toml
            if self._was_requested:
                self.request_plan(self.seed.value() if self.is_planned else None)

    def people(self) -> dict[str, Any]:
        """Return what is said of the session, and the first note."""
        fields = {**self.about, "notes": self.notes}
        return {**{name: field.text().strip() for name, field in fields.items()}, **self.own.said()}

    def queued_arguments(self) -> dict[str, Any]:
        """Return the arguments of the engine's command enqueue: the fields, and what is planned."""
        plan = self._plan
        planned = {"trials": len(plan.order), "plate_changes": plan.plate_changes}
        folder = str(new_files_folder(self.out.text()))
        run = {**self.start_arguments(), "out": folder}
        return {**run, **planned, "duration_s": plan.duration_s}

    def start_arguments(self) -> dict[str, Any]:
        """Return the arguments of the engine's command start, with a new folder of this second."""
        folder = f"{Path(self.protocol.currentText()).stem}-{time_stamp()}"
        out = str(new_files_folder(self.out.text()) / folder)
        path, seed = self.protocol.currentData(), self.seed.value()
        return {"protocol": path, "out": out, "seed": seed, "yes": False, **self.people()}

    @property
    def remembered(self) -> dict[str, QLineEdit | OwnFields]:
        """What the next start of the window asks no more, by the key of the settings."""
        said = {f"protocol/{name}": field for name, field in self.about.items()}
        return {"save_in": self.out, "protocol/own": self.own, **said}

    @property
    def current_problem(self) -> str:
        """What keeps a run from starting; empty for nothing."""
        problem = folder_problem(self.out.text())
        seed = f"Seed: {self.seed.refusal}" if self.seed.refusal else ""
        return seed or self._plan.problem or (f"Save in: {problem}" if problem else "")

    def show_plan(self, plan: PlanSummary) -> None:
        """Show the plan of the chosen protocol, or why it cannot run."""
        self._plan, self.is_planned = plan, not plan.problem
        for name, text in zip(PLAN_ROWS, plan.texts, strict=True):
            if name != DISK_ROW:
                show_text(self.plan_rows[name], text)
        self._show_plates()
        self.take_space(plan.free_bytes)
        show_text(self.description, plan.description)
        self.description.setVisible(bool(plan.description))
        with QSignalBlocker(self.seed):
            self.seed.setValue(plan.seed)
        self.show_finish()
        self.show_problem()
        if self.is_planned:
            self.planned.emit(plan)

    def follow(self, recording: RecordingStatus) -> None:
        """Show the space that a recording in this folder sees; ask anew when it has ended."""
        before, self._recording = self._recording, recording
        self._show_space()
        if before.disk_free_bytes and not recording.disk_free_bytes:
            self.request_space()

    def request_space(self) -> None:
        """Ask for the free space of the folder's disk, once the worker is free."""
        self._needs_space = self._was_requested
        self.submit_plan()

    def take_space(self, free_bytes: int | None) -> None:
        """Show the free space of the folder's disk, None for no folder."""
        self._free_bytes = free_bytes
        self._show_space()

    def _show_space(self) -> None:
        """Show what the plan needs of the space that the health strip shows, too."""
        recording, free_bytes = self._recording, self._free_bytes
        folder = Path(recording.folder).parent if recording.folder else None
        if recording.disk_free_bytes and folder == typed_path(self.out.text()):
            free_bytes = recording.disk_free_bytes
        needs = self._plan.texts[-1]
        is_known = needs != "–" and free_bytes is not None
        free = f" of {size(free_bytes or 0)} free" if is_known else ""
        show_text(self.plan_rows[DISK_ROW], f"{needs}{free}")

    def show_finish(self) -> None:
        """Show when a run that starts now would end."""
        finish = day_time(self._plan.duration_s) if self.is_planned else "–"
        show_text(self.plan_rows[FINISH_ROW], finish)

    def show_problem(self) -> None:
        """Say what the fields lack for a run."""
        show_text(self.problem, self.current_problem)
        self.problem.setVisible(bool(self.current_problem))
        self.checked.emit()

    def request_plan(self, seed: int | None = None) -> None:
        """Request a plan, and drop a waiting request; no run starts until the plan arrives."""
        self.is_planned, self._was_requested = False, True
        if path := self.protocol.currentData():
            self._next_plan = (path, seed)
            self.submit_plan()

    def submit_plan(self) -> None:
        """Plan what was requested last, else ask for the space, if the worker is free."""
        if self._next_plan is not None and not self._worker.is_busy:
            (path, seed), self._next_plan = self._next_plan, None
            values = {"seed": seed, "out": self.out.text(), "rig_toml": self._rig_toml}
            self._worker.submit("plan_protocol", path=path, **values)
        elif self._needs_space and not self._worker.is_busy:
            self._needs_space = False
            self._worker.submit("free_space", out=self.out.text())

    def finish_plan(self, plan: PlanSummary) -> None:
        """Show a plan that arrived, unless another one was requested meanwhile."""
        if self._next_plan is None:
            self.show_plan(plan)

    @property
    def needs_plan(self) -> bool:
        """Whether the chosen protocol was never planned."""
        return not self.is_planned and not self._plan.problem

    def _list_protocols(self) -> None:
        """List the protocols of the program, the quick one first."""
        paths = resources.protocols().glob("*.toml")
        for path in sorted(paths, key=lambda path: (path.stem != "quick", path.stem)):
            self.protocol.addItem(path.stem, str(path))
            index = self.protocol.count() - 1
            self.protocol.setItemData(index, str(path), Qt.ItemDataRole.ToolTipRole)

    def _connect(self) -> None:
        self.protocol.currentIndexChanged.connect(lambda _: self.request_plan())
        self.seed.valueChanged.connect(lambda _: self.request_plan(self.seed.value()))
        self.seed.refusal_changed.connect(self.show_problem)
        for follow in (self.show_problem, self.request_space):
            self.out.textChanged.connect(follow)

    def _lay_out(self) -> None:
        box, form = group_box("Protocol", form_layout(4))
        choice = hbox(self.protocol, self.modified, self.open_button, self.edit_button)
        form.addRow("File", choice)
        form.addRow(self.description)
        for name, text in self.plan_rows.items():
            form.addRow(label(name, "muted"), text)
        form.addRow(self.problem)
        form.addRow("Save in", hbox(self.out, self.out_button))
        form.addRow("Seed", self.seed)
        for name, field in self.about.items():
            form.addRow(about_title(name), field)
        form.addRow(self.own)
        form.addRow("First note", self.notes)
        for hidden in (self.description, self.problem, self.modified):
            hidden.hide()
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(box)


_NUMBER = Qt.ItemDataRole.UserRole
_LIST_PX = 96


class RunQueue(QWidget):
    """Shows the runs that wait in the engine, and lets people change their order."""

    command_requested = Signal(str, dict)
    add_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._can_start = False
        self.list = QListWidget()
        self.list.setFixedHeight(scaled_px(_LIST_PX))
        self.list.setWordWrap(True)
        add_tip = "Queue a run of the fields above; the engine keeps it, also without this window"
        self.add_button = push_button("Add", self.add_requested.emit, add_tip)
        self.remove_button = push_button("Remove", partial(self._send, "dequeue"))
        self.up_button = push_button("Up", partial(self._send, "move_queued", places=-1))
        self.down_button = push_button("Down", partial(self._send, "move_queued", places=1))
        self.next_button = push_button(
            "Start next", lambda: self.command_requested.emit("start_queued", {})
        )
        self.waits_for = label("", "muted", wraps=True)
        self._lay_out()
        self.list.currentRowChanged.connect(lambda _: self._enable())
        self.set_possible(can_add=False, can_start=False)

    @property
    def buttons(self) -> tuple[QPushButton, ...]:
        """All buttons, in their order."""
        change = (self.remove_button, self.up_button, self.down_button)
        return (self.add_button, *change, self.next_button)

    def set_possible(self, *, can_add: bool, can_start: bool) -> None:
        """Allow to queue the fields above, and to start a run."""
        self.add_button.setEnabled(can_add)
        self._can_start = can_start
        self._enable()

    def show_queue(self, queue: QueueStatus) -> None:
        """Show the runs and what the first one waits for; the chosen one stays chosen."""
        texts = [_queued_text(place, run) for place, run in enumerate(queue.entries, 1)]
        numbers = [run.number for run in queue.entries]
        shown = [self.list.item(row) for row in range(self.list.count())]
        if texts != [item.text() for item in shown] or numbers != [
            item.data(_NUMBER) for item in shown
        ]:
            self._replace(texts, numbers)
        show_text(self.waits_for, f"Waits: {queue.waits_for}." if queue.waits_for else "")
        self.waits_for.setVisible(bool(queue.waits_for))

    def _replace(self, texts: Sequence[str], numbers: Sequence[int]) -> None:
        chosen = self._chosen
        with QSignalBlocker(self.list):
            self.list.clear()
            for text, number in zip(texts, numbers, strict=True):
                item = QListWidgetItem(text)
                item.setData(_NUMBER, number)
                self.list.addItem(item)
            if numbers:
                self.list.setCurrentRow(numbers.index(chosen) if chosen in numbers else 0)
        self._enable()

    @property
    def _chosen(self) -> int | None:
        item = self.list.currentItem()
        return None if item is None else int(item.data(_NUMBER))

    def _send(self, command: str, **args: int) -> None:
        self.command_requested.emit(command, {"number": self._chosen, **args})

    def _enable(self) -> None:
        row, last = self.list.currentRow(), self.list.count() - 1
        self.remove_button.setEnabled(row >= 0)
        self.up_button.setEnabled(row > 0)
        self.down_button.setEnabled(0 <= row < last)
        self.next_button.setEnabled(last >= 0 and self._can_start)

    def _lay_out(self) -> None:
        box, column = group_box("Queue", QVBoxLayout())
        column.addWidget(self.waits_for)
        column.addWidget(self.list)
        column.addLayout(FlowLayout(*self.buttons))
        outer = QVBoxLayout(self)
        outer.setContentsMargins(0, 0, 0, 0)
        outer.addWidget(box)


def _queued_text(place: int, run: QueuedRunStatus) -> str:
    """Return what a run is, and when it is due and over."""
    seed = "" if run.seed is None else f", seed {run.seed}"
    size = f"{grouped(run.trials)} trials, {_changes(run.plate_changes)}"
    due = duration(run.duration_s)
    if run.due_s is not None:
        due = f"due {day_time(run.due_s)}, over {day_time(run.due_s + run.duration_s)} ({due})"
    return f"{place}. {run.protocol}{seed}: {size}\n{due}"


def _changes(count: int) -> str:
    return f"{count} plate change{'' if count == 1 else 's'}"


ROWS = ("Progress", "Finishes", "Trial", "Next plate", "Rejected", "Disk", "Session")
MAX_NAME, STAMP = 26, 16
"""Letters of a session's name in one line, and of the time at the end of a longer one."""
_KEPT = ": committed trials are kept"
_STATES = {
    "idle": "No run",
    "running": "Running",
    "prompt": "Waiting for your answer above",
    "paused": "Paused, drum lifted",
    "done": "Done: all trials are on disk",
    "aborted": f"Aborted{_KEPT}",
    "failed": f"Failed{_KEPT}",
    "kept": _KEPT,
}


class RunStateBox(QVBoxLayout):
    """Shows the run that an engine reports; a layout, so that its box follows its height.

    ``rows``: names of lines below the bar. ``states``: words for each state of a run, and for
    ``kept``, which follows those of an aborted one.
    """

    continue_requested = Signal(str)
    """The session of the run that has ended."""

    def __init__(self, rows: Sequence[str] = ROWS, states: Mapping[str, str] = _STATES) -> None:
        super().__init__()
        self._states = states
        self.state = label("No run", "heading", wraps=True)
        self.bar = QProgressBar(format="%p %")
        self.rows = {name: label("–", wraps=True) for name in rows}
        self.addWidget(self.state)
        self.addWidget(self.bar)
        self.session = ""
        self.continue_button = push_button(
            "Continue it",
            lambda: self.continue_requested.emit(self.session),
            PathKind.INTERRUPTED.value[2],
        )
        self.addWidget(self.continue_button)
        form = form_layout(3)
        for name, text in self.rows.items():
            form.addRow(label(name, "muted"), text)
        self.addLayout(form)

    def show_run(
        self, run: RunStatus | FingerRunStatus, planned: int, texts: Mapping[str, str]
    ) -> None:
        """Show a run, with the texts of the rows but the session's."""
        show_text(self.state, self._sentence(run))
        set_property(self.state, "role", "bad" if run.state == "failed" else "heading")
        show_progress(self.bar, run.trials_committed, planned)
        for name, text in texts.items():
            show_text(self.rows[name], text)
        self.session = run.session or ""
        may_continue = bool(self.session) and run.has_ended and not run.is_complete
        self.continue_button.setVisible(may_continue)
        name = Path(run.session).name if run.session else "–"
        self.rows["Session"].setText(name if len(name) <= MAX_NAME else f"…{name[-STAMP:]}")
        show_tooltip(self.rows["Session"], plain_tooltip(run.session or ""))

    def _sentence(self, run: RunStatus | FingerRunStatus) -> str:
        """Return the run's state, with the reasons of a pause."""
        if run.text:
            kept = self._states.get("kept", "") if run.state == "aborted" else ""
            return f"{capitalised(run.text)}{kept}"
        words = self._states.get(run.state, run.state)
        reasons = reason_words(run.reasons)
        return f"{words} ({reasons})" if reasons else words


def run_texts(status: EngineStatus, world: World = None) -> dict[str, str]:
    """Return the text of each row of a drum's run; ``world`` names its plates."""
    run = status.run
    return {
        "Progress": progress_sentence(run),
        "Finishes": finish_sentence(run),
        "Trial": trial_sentence(run),
        "Next plate": plate_sentence(run, world),
        "Rejected": f"{run.trials_rejected}" if run.trials_planned else "–",
        "Disk": disk_sentence(status.recording),
    }


def progress_sentence(run: RunStatus) -> str:
    """Return how many trials are committed, and the time left."""
    if not run.trials_planned:
        return "–"
    left = f", {duration(run.eta_s)} left" if run.is_active and run.eta_s is not None else ""
    early = f", {run.trials_ended_early} left out by an early end" if run.trials_ended_early else ""
    return f"{run.trials_committed} of {run.trials_planned} trials{early}{left}"


def finish_sentence(run: RunStatus) -> str:
    """Return the time of day at which the run ends if nothing makes it wait."""
    if not run.is_active or run.eta_s is None:
        return "–"
    return day_time(run.eta_s) + (", plus plate changes" if run.next_plate else "")


def plate_sentence(run: RunStatus, world: World = None) -> str:
    """Return the next change of plates, below it what the plate is."""
    plate = run.next_plate
    if run.prompt is not None and run.prompt.texture:
        return f"{run.prompt.texture} now{_texture_line(run.prompt.texture, world)}"
    if not run.is_active or plate is None:
        return "no other plate" if run.is_active else "–"
    line = _texture_line(plate.texture, world)
    if not plate.trials:
        after = "the pause" if run.state == "paused" else "this trial"
        return f"{plate.texture} after {after}{line}"
    trials = f"{plate.trials} trial{'' if plate.trials == 1 else 's'}"
    return f"{plate.texture} after {trials}, in {duration(plate.left_s)}{line}"


def _texture_line(name: str, world: World) -> str:
    words = texture_words(name, world)
    return words and f"\n{words}"


def disk_sentence(recording: RecordingStatus) -> str:
    """Return the free space, and how long it lasts."""
    if not recording.disk_free_bytes:
        return "–"
    lasts = lasting_words(recording)
    left = f", enough for {lasts}" if lasts else ""
    return f"{size(recording.disk_free_bytes)} free{left}"


def trial_sentence(run: RunStatus) -> str:
    """Return the conditions of the present trial."""
    if not run.current:
        return "–"
    trial = run.current
    mounting = f", mounting {trial.mount}" if trial.mount > 1 else ""
    return (
        f"#{run.trial_id or 0}: {trial.texture}, {trial.speed_mm_s:g} mm/s, "
        f"{trial.force_g:g} g, repeat {trial.repeat}{mounting}"
    )


class UnsavedStrip(Strip):
    """Asks what happens to changes of a protocol that are not saved, and then goes on."""

    save_requested = Signal(object)
    """What goes on once the changes are saved."""

    def __init__(self) -> None:
        super().__init__()
        self._go_on: Callable[[], None] = self.hide
        self.save = push_button("Save and go on", self._save)
        self.go_on = push_button("Leave them out", self._leave)
        self.cancel = push_button("Cancel", self.hide)
        self.lay_out(self.save, self.go_on, self.cancel)

    def ask(self, name: str, words: tuple[str, str], go_on: Callable[[], None], why: str) -> None:
        """Ask about a file; ``words``: on the buttons; ``why`` the changes cannot be saved."""
        self.text.setText(f"{name} has changes that are not saved.{why and f' {why}'}")
        for button, text in zip((self.save, self.go_on), words, strict=True):
            button.setText(text)
        self.save.setEnabled(not why)
        self._go_on = go_on
        self.show()
        self.cancel.setFocus()

    def _save(self) -> None:
        self.hide()
        self.save_requested.emit(self._go_on)

    def _leave(self) -> None:
        self.hide()
        self._go_on()


_RUNS = ("Save and run", "Run the saved one")
_QUEUES = ("Save and add", "Add the saved one")
_EDITS = ("Save and edit the other", "Discard them")
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
        self._can_start = self._can_add = False
        self._world: World = None
        self.form, self.unsaved = ProtocolForm(self.worker), UnsavedStrip()
        self._after_save: Callable[[], None] | None = None
        self._after_plan: Callable[[], None] | None = None
        """What goes on once the editor's changes are saved, and then planned."""
        self.page = SessionPage(self.worker, self.form.people)
        self.queue = RunQueue()
        self.run_box = RunStateBox()
        self.protocol, self.out, self.seed = self.form.protocol, self.form.out, self.form.seed
        self.plan_rows, self.problem = self.form.plan_rows, self.form.problem
        self.open_button, self.out_button = self.form.open_button, self.form.out_button
        self.run_rows, self.bar, self.state = (
            self.run_box.rows,
            self.run_box.bar,
            self.run_box.state,
        )
        self.continue_button = browse_button(
            self.path_requested,
            PathKind.INTERRUPTED,
            self.continue_session,
            "Continue a session …",
        )
        self.continue_buttons = (self.continue_button, self.run_box.continue_button)
        self.page_button = push_button(PAGE_BUTTON, lambda: self.show_page(not self.shows_page))
        start = partial(self._ask_first, _RUNS, self._start)
        self.buttons = {"Start": push_button("Start", start)}
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

    def close_workers(self) -> None:
        """End both worker processes."""
        self.worker.close()
        self.page.learning.close_worker()

    def add_protocol(self, path: str) -> None:
        """Add a file to the list and choose it."""
        self.form.add_protocol(path)

    def set_world(self, world: World) -> None:
        """Name the plates of another rig."""
        self._world = world
        self.form.set_world(world)

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
        self._can_add = is_connected
        self._enable_start()
        for button in self.continue_buttons:
            button.setEnabled(self._can_start)
        reason = _MOVED_BY_HAND if status.is_moved_by_hand else ""
        show_tooltip(self.buttons["Start"], reason)
        self.buttons["Pause"].setEnabled(run.state == "running")
        self.buttons["Resume"].setEnabled(run.state == "paused")
        self.buttons["Abort"].setEnabled(run.is_active)
        self.form.show_finish()
        self.form.follow(status.recording)
        planned = run.trials_planned - run.trials_ended_early
        told = replace(run, text=run_end_words(status))
        self.run_box.show_run(told, planned, run_texts(status, self._world))
        self.page.show_run(run)
        self.queue.show_queue(status.queue)
        self._arrange(run.is_active, bool(status.queue.entries))

    def showEvent(self, event: QShowEvent) -> None:
        """Plan the protocol when the panel is visible for the first time."""
        super().showEvent(event)
        if self.form.needs_plan:
            self.form.request_plan()

    def _enable_start(self) -> None:
        can_run = self.form.is_planned and not self.form.current_problem
        self.buttons["Start"].setEnabled(self._can_start and can_run)
        self.queue.set_possible(can_add=can_run and self._can_add, can_start=self._can_start)

    def _start(self) -> None:
        self.command_requested.emit("start", self.form.start_arguments())
        self.form.notes.clear()

    def _enqueue(self) -> None:
        self.command_requested.emit("enqueue", self.form.queued_arguments())

    @property
    def _is_modified(self) -> bool:
        """Whether the editor has changes of the chosen protocol that are not saved."""
        editor = self.page.editor
        return editor.is_modified and editor.file == self.form.protocol.currentData()

    @property
    def _mistake(self) -> str:
        """Why the editor's changes cannot be saved, empty where they can."""
        can_save = self.page.editor.save_button.isEnabled()
        return "" if can_save else "They have a mistake, which the editor shows."

    def _ask_first(self, words: tuple[str, str], go_on: Callable[[], None]) -> None:
        """Ask what happens to changes of the chosen protocol that are not saved, then go on."""
        if self._is_modified:
            self.unsaved.ask(self.form.protocol.currentText(), words, go_on, self._mistake)
        else:
            go_on()

    def _save_first(self, go_on: Callable[[], None]) -> None:
        self._after_save = go_on
        self.page.editor.save()

    def _go_on(self) -> None:
        """Do what waited for the changes to be saved and planned; a plan with a problem runs not.

        It says itself what is wrong.
        """
        go_on, self._after_plan = self._after_plan, None
        if go_on is not None and self.form.is_planned and not self.form.current_problem:
            go_on()

    def _show_modified(self) -> None:
        self.form.modified.setVisible(self._is_modified)

    def _finish_task(self, task: str, result: Any) -> None:
        if task == "plan_protocol":
            self.form.finish_plan(result)
            self._go_on()
        elif task == "free_space":
            self.form.take_space(result)
        elif task in self._editor_tasks:
            self._editor_tasks[task](result)
        else:
            self.page.finish_task(task, result)
        self._submit_next()

    def _fail_task(self, task: str, sentence: str) -> None:
        if task == "plan_protocol":
            self.form.finish_plan(PlanSummary(problem=sentence))
        elif task == "save_protocol":
            self._after_save = None
            self.page.editor.show_verdict(sentence, is_bad=True)
            self.reported.emit("refused", sentence)
        else:
            self.page.show_problem(sentence)
        self._submit_next()

    def _read_protocol(self) -> None:
        """Show the chosen protocol's file in the editor, as it is if it is there already."""
        editor, path = self.page.editor, self.form.protocol.currentData()
        if self._is_modified:
            self._show_editor()
        elif editor.is_modified and path:
            read = partial(self._read_file, path)
            self.unsaved.ask(Path(editor.file).name, _EDITS, read, self._mistake)
        elif path:
            self._read_file(path)

    def _read_file(self, path: str) -> None:
        self.form.add_protocol(path)
        self.worker.submit("read_protocol", path=path)

    def _edit(self, read: ProtocolText) -> None:
        self.page.editor.show_file(read.path, read.text, read.own_path)
        self._show_editor()

    def _show_editor(self) -> None:
        self.page.tabs.setCurrentWidget(self.page.editor)
        self.show_page(True)

    def _finish_save(self, path: str) -> None:
        self.page.editor.show_saved(path)
        self._after_plan, self._after_save = self._after_save, None
        if self.page.editor.is_finger:
            self._go_on()
        else:
            self.form.add_protocol(path)

    def _submit_next(self) -> None:
        self.form.submit_plan()
        self.page.submit()

    def _connect(self) -> None:
        self.worker.finished.connect(self._finish_task)
        self.worker.failed.connect(self._fail_task)
        self.run_box.continue_requested.connect(self.continue_session)
        self.form.checked.connect(self._enable_start)
        self.form.planned.connect(self.page.show_plan)
        self.queue.command_requested.connect(self.command_requested)
        self.queue.add_requested.connect(partial(self._ask_first, _QUEUES, self._enqueue))
        self.page.command_requested.connect(self.command_requested)
        self.page.advanced.connect(self.page.learning.show_session)
        for link in (self.page, self.page.learning):
            link.reported.connect(self.reported)
        self.form.edit_button.clicked.connect(lambda: self._read_protocol())
        editor = self.page.editor
        self.unsaved.save_requested.connect(self._save_first)
        editor.modified_changed.connect(self._show_modified)
        self.form.protocol.currentIndexChanged.connect(lambda _: self._show_modified())
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

    def _arrange(self, is_active: bool, is_queued: bool) -> None:
        """Put first, where nobody has to scroll for it, the run, or a queue that waits."""
        order: tuple[QWidget, ...] = (self.form, self._run_group, self.queue)
        if is_active:
            order = (self._run_group, self.form, self.queue)
        elif is_queued:
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
