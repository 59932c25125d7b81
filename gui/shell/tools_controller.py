"""The pages of the Tools menu: calibrate or accept a rig, list the serial ports."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, TypeVar

from PySide6.QtCore import QObject, QProcess, Qt, QTimer, Signal
from PySide6.QtWidgets import QHBoxLayout, QLineEdit, QPlainTextEdit, QWidget

from gui.link.engine_link import EngineLink
from gui.operate.boards_box import BoardsBox, FlashStrip
from gui.operate.calibrate import CalibratePage
from gui.operate.setup_page import SetupPage
from gui.shell.actions import ActionRegistry
from gui.shell.docks import PageStack
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import label, set_property
from gui.widgets.layouts import combo_box, container, form_layout, hbox, push_button, vbox
from gui.widgets.typed_paths import typed_path
from rigctl.boards.identity import offered_flash
from rigctl.engine.live_file import LiveReader
from rigctl.engine.rpc.messages import EngineStatus
from rigctl.plugins import installed

_KILL_MS, _CLEAN_UP_MS = 1000, 5000


class CommandPage(QWidget):
    """Title, explanation, Run and Cancel, and the output.

    ``words`` returns the command and its arguments, ``refusal`` why it cannot run now, empty if it
    can, ``success`` the sentence above the lines that it has printed.
    """

    closed = Signal()
    """The user wants to see the page from before."""

    def __init__(
        self,
        title: str,
        explanation: str,
        run_text: str,
        *,
        words: Callable[[], Sequence[str]],
        refusal: Callable[[], str],
        success: Callable[[Sequence[str]], str] = lambda lines: lines[-1],
    ) -> None:
        super().__init__()
        self._words, self._refusal, self._success = words, refusal, success
        self.run_button = push_button(run_text, self.run)
        self.cancel_button = push_button("Cancel", self.cancel)
        self.close_button = push_button("Close", self.closed.emit)
        self.verdict = label("", "heading", wraps=True)
        self.output = QPlainTextEdit(readOnly=True)
        self.output.setAccessibleName(f"{title}: output")
        self._process: QProcess | None = None
        self._inputs = QHBoxLayout()
        self.buttons = hbox(self.run_button, self.cancel_button, self.close_button, wide=-1)
        rows = (label(title, "heading"), label(explanation, "muted", wraps=True), self._inputs)
        self.setLayout(
            vbox(
                *rows,
                self.buttons,
                self.verdict,
                self.output,
                spacing=6,
                margins=(9, 4, 9, 4),
                tall=5,
            )
        )
        self.cancel_button.setEnabled(False)

    @property
    def is_running(self) -> bool:
        """Whether the command runs."""
        return self._process is not None

    def run(self) -> None:
        """Start the command, or say why it cannot start."""
        refusal = self._refusal()
        self.start(() if refusal else self._words(), refusal)

    def start(self, words: Sequence[str], refusal: str) -> None:
        """Start a command with its arguments, or say why it cannot start."""
        if self.is_running:
            return
        self.output.clear()
        if refusal:
            self._show_verdict(refusal, "bad")
            return
        process = self._process = QProcess(self)
        process.setProcessChannelMode(QProcess.ProcessChannelMode.MergedChannels)
        process.readyReadStandardOutput.connect(self._read)
        process.finished.connect(self._finish)
        self._show_verdict("Running …", "muted")
        self.show_running(True)
        process.start(sys.executable, ["-m", "rigctl", *words])

    def cancel(self) -> None:
        """End the command: it removes what is half written, and is killed if that takes long."""
        process, self._process = self._process, None
        if process is not None:
            process.finished.disconnect(self._finish)
            process.finished.connect(process.deleteLater)
            process.terminate()
            QTimer.singleShot(_CLEAN_UP_MS, process, process.kill)
            self._show_verdict("Cancelled.", "muted")
            self.show_running(False)

    def close_process(self) -> None:
        """End the command before the window closes."""
        process = self._process
        self.cancel()
        if process is not None and not process.waitForFinished(_KILL_MS):
            process.kill()
            process.waitForFinished(_KILL_MS)

    def _read(self) -> None:
        if self._process is not None:
            data = self._process.readAllStandardOutput().data()
            cursor = self.output.textCursor()
            cursor.movePosition(cursor.MoveOperation.End)
            cursor.insertText(bytes(data).decode("utf-8", errors="replace"))

    def _finish(self, exit_code: int) -> None:
        self._read()
        process, self._process = self._process, None
        if process is not None:
            process.deleteLater()
        lines = self.output.toPlainText().splitlines() or ["it printed nothing"]
        if exit_code == 0:
            self._show_verdict(self._success(lines), "heading")
        else:
            self._show_verdict(lines[-1], "bad")
        self.show_running(False)

    def add_input(self, widget: QWidget, stretch: int = 0) -> None:
        """Add a field above the buttons."""
        self._inputs.addWidget(widget, stretch, Qt.AlignmentFlag.AlignVCenter)

    def _show_verdict(self, text: str, role: str) -> None:
        self.verdict.setText(text)
        set_property(self.verdict, "role", role)

    def show_running(self, running: bool) -> None:
        """Offer what is possible while the command runs."""
        self.run_button.setEnabled(not running)
        self.cancel_button.setEnabled(running)


class FieldsPage(CommandPage):
    """A command whose arguments are typed or chosen: one field a line.

    ``fields``: what each is, and what it takes; all but the ``optional`` are needed. ``words``
    returns the command.
    """

    path_requested = Signal(object, object)

    def __init__(
        self,
        title: str,
        explanation: str,
        run_text: str,
        fields: Mapping[str, tuple[PathKind, str]],
        words: Callable[[Mapping[str, str]], Sequence[str]],
        optional: Sequence[str] = (),
    ) -> None:
        super().__init__(
            title,
            explanation,
            run_text,
            words=lambda: words(self.texts()),
            refusal=lambda: self.lack(*(name for name in fields if self._is_needed(name))),
        )
        self._optional = optional
        self.fields: dict[str, QLineEdit] = {}
        self.form = form = form_layout(4)
        for name, (kind, hint) in fields.items():
            field = self.fields[name] = QLineEdit(placeholderText=hint)
            field.returnPressed.connect(self.run)
            form.addRow(name, hbox(field, browse_button(self.path_requested, kind, field.setText)))
        self.add_input(container(form), 1)

    def _is_needed(self, name: str) -> bool:
        return name not in self._optional or bool(self.fields[name].text().strip())

    def texts(self) -> dict[str, str]:
        """Return the path in each field, from the home folder where it begins with ``~``."""
        return {name: str(typed_path(field.text())) for name, field in self.fields.items()}

    def lack(self, *names: str) -> str:
        """Return which of some fields is empty or no whole path; empty where none is."""
        for name in names:
            text = self.fields[name].text().strip()
            if not text:
                return EMPTY.format(name=name)
            if not typed_path(text).is_absolute():
                return NOT_WHOLE.format(name=name)
        return ""


EMPTY = "{name}: choose it first."
NOT_WHOLE = "{name}: give the whole path, or one that begins with ~."
SESSION, OUT, MAP, RECORDINGS = "Session", "Write into", "Map", "Recordings"


def accept_page() -> FieldsPage:
    """Return the page that judges force, drift, speed, steps and losses of a rig."""
    return FieldsPage(
        "Accept a rig",
        "Judges force, drift, speed, steps and losses of a rig by a session that was recorded "
        "with the protocol “acceptance”, as rigctl accept does.",
        "Judge the rig",
        {SESSION: (PathKind.SESSION, "Session of the acceptance protocol")},
        lambda texts: ("accept", "--", texts[SESSION]),
    )


def encode_page() -> FieldsPage:
    """Return the page that writes the spikes of a session."""
    return FieldsPage(
        "Encode a session",
        "Writes the spikes of all trials, C and counts as plain arrays into a new folder, as "
        "rigctl encode does. What is done stays in the cache: the next run goes on from there.",
        "Encode",
        {SESSION: (PathKind.SESSION, "Session folder"), OUT: (PathKind.OUTPUT, "New folder")},
        lambda texts: ("encode", f"--out={texts[OUT]}", "--", texts[SESSION]),
    )


def recover_page() -> FieldsPage:
    """Return the page that closes the parts of a killed writer."""
    return FieldsPage(
        "Recover a session",
        "Closes the parts of a session whose writer was killed, and says what it lacks, as "
        "rigctl recover does. Rows stay what they are.",
        "Recover",
        {SESSION: (PathKind.SESSION, "Session folder")},
        lambda texts: ("recover", "--", texts[SESSION]),
    )


TABLE = "table"
FORMATS = {
    "NWB (.nwb): pynwb, SpikeInterface, pynapple, MatNWB": "nwb",
    "MATLAB 7.3 (.mat): MATLAB, Octave": "matlab",
    "Parquet (a folder): pandas, Polars, R": "parquet",
    "Neo (.nix)": "neo",
    "CSV (a folder)": "csv",
    "Table of the trials (.csv)": TABLE,
}
"""What a session can be exported to, and its name on the command line."""
REPRESENTATIONS = {
    "Readings and spikes": "readings,spikes",
    "Readings": "readings",
    "Spikes": "spikes",
    "Readings, spikes, and counts in windows": "readings,spikes,counts",
}


class ExportPage(FieldsPage):
    """A session, or a part of it, in the format of another program."""

    def __init__(self) -> None:
        super().__init__(
            "Export a session",
            "Writes readings, spikes, what the rig did, trials and events on one clock, as rigctl "
            "export does. The export appears whole or not at all; nothing is replaced. Analysis "
            "saves samples, spikes and figures of a trial.",
            "Export",
            {
                SESSION: (PathKind.SESSION, "Session folder"),
                OUT: (PathKind.TABLE, "New file or folder; empty: beside the session"),
            },
            self._words_of,
            optional=(OUT,),
        )
        others = {f"{p.name} ({p.package})": p.name for p in installed("exporter")}
        self.format = combo_box({**FORMATS, **others})
        self.trials = QLineEdit(placeholderText="All, or such as 1-100,205")
        self.taxels = QLineEdit(placeholderText="All, or such as 1-9")
        self.representations = combo_box(REPRESENTATIONS)
        self.form.addRow("Format", self.format)
        self.form.addRow("Contains", self.representations)
        self.form.addRow("Trials", self.trials)
        self.form.addRow("Taxels", self.taxels)
        self.format.currentIndexChanged.connect(lambda _: self._show_choice())

    def show_session(self, path: str) -> None:
        """Offer the export of a session."""
        self.fields[SESSION].setText(path)
        self.fields[OUT].clear()

    def _show_choice(self) -> None:
        """Take a choice for the formats that have one."""
        for field in (self.representations, self.trials, self.taxels):
            field.setEnabled(self.format.currentData() != TABLE)

    def _is_needed(self, name: str) -> bool:
        return self.format.currentData() == TABLE or super()._is_needed(name)

    def _words_of(self, texts: Mapping[str, str]) -> Sequence[str]:
        kind, session = self.format.currentData(), texts[SESSION]
        if kind == TABLE:
            return ("info", f"--csv={texts[OUT]}", "--", session)
        chosen = {"trials": self.trials.text().strip(), "taxels": self.taxels.text().strip()}
        if self.fields[OUT].text().strip():
            chosen["out"] = texts[OUT]
        chosen["representations"] = self.representations.currentData()
        options = (f"--{name}={value}" for name, value in chosen.items() if value)
        return ("export", f"--to={kind}", *options, "--", session)


class ImportPage(FieldsPage):
    """Recordings from elsewhere into a session, by a map that can be guessed first."""

    session_requested = Signal(str)
    """Open the new session."""

    def __init__(self) -> None:
        super().__init__(
            "Import recordings",
            "Makes a session of recordings from elsewhere (.csv, .tsv, .txt, .lvm, .mat, .npy, "
            ".npz, .nwb, or a folder of them), as rigctl import does. The map says what each "
            "column is: guess one, read it, then import.",
            "Import",
            {
                RECORDINGS: (PathKind.RECORDINGS, "Folder of recordings, or a file"),
                MAP: (PathKind.MAP, "Map (.toml): a new one to guess, or one to import by"),
                OUT: (PathKind.OUTPUT, "New session folder"),
            },
            lambda texts: self._words_of(f"--map={texts[MAP]}", f"--out={texts[OUT]}"),
        )
        self.guess_button = push_button("Guess the map", self._guess, "Writes the file Map")
        self.open_button = push_button("Open the session", self._open)
        self.open_button.setEnabled(False)
        self.buttons.insertWidget(0, self.guess_button)
        self.buttons.insertWidget(2, self.open_button)

    def show_running(self, running: bool) -> None:
        """Offer what is possible while the command runs, and what it has made."""
        super().show_running(running)
        self.guess_button.setEnabled(not running)
        made = typed_path(self.fields[OUT].text())
        self.open_button.setEnabled(not running and made.is_absolute() and made.is_dir())

    def _words_of(self, *options: str) -> tuple[str, ...]:
        return ("import", *options, "--", self.texts()[RECORDINGS])

    def _guess(self) -> None:
        words = self._words_of("--guess", f"--map={self.texts()[MAP]}")
        self.start(words, self.lack(RECORDINGS, MAP))

    def _open(self) -> None:
        self.session_requested.emit(self.texts()[OUT])


class PortsPage(CommandPage):
    """All ports of this computer; ``refusal`` returns why a board may not be reset now."""

    def __init__(self, refusal: Callable[[], str]) -> None:
        explanation = (
            "Asks the board on every serial port for its name, firmware and self-test, as "
            "rigctl ports does. Opening a port resets its board, whose bootloader is left in peace "
            "for two seconds first."
        )
        super().__init__(
            "Serial ports",
            explanation,
            "List the ports",
            words=lambda: ("ports",),
            refusal=refusal,
            success=_count_ports,
        )


def _count_ports(lines: Sequence[str]) -> str:
    """Return how many ports there are."""
    ports = [line for line in lines if not line.startswith(" ") and ": " in line]
    if lines[0].startswith("no serial port"):
        return lines[0]
    return f"{len(ports)} port{'' if len(ports) == 1 else 's'}"


UNSAVED = "calibration not saved: {parts}; it is lost unless another window is on the rig"
IN_USE = "The window uses the boards: disconnect first, because asking the ports resets them."


_Page = TypeVar("_Page", bound=CommandPage)


class ToolsController(QObject):
    """Adds the pages to the window and ends their commands when it closes."""

    path_requested = Signal(object, object)
    reported = Signal(str, str)
    session_requested = Signal(str)
    """Open this session."""
    connect_requested = Signal(str)
    """The ``rig.toml`` of the boards that were found."""
    closed = Signal()
    """The user has closed a page."""

    def __init__(
        self, stack: PageStack, menus: ActionRegistry, link: EngineLink[EngineStatus, LiveReader]
    ) -> None:
        super().__init__()
        self._stack, self._link = stack, link
        self.flash_strip = FlashStrip()
        self._commands: list[CommandPage] = []
        """The pages of commands that are made already."""
        self.calibrate_page = CalibratePage()
        stack.add_page("calibrate", self.calibrate_page)
        self.calibrate_page.closed.connect(self.closed)
        show = partial(stack.show_page, "calibrate")
        tip = "Calibrate load cell and force loop, measure the imbalance, identify the taxels"
        menus.add("Tools", "&Calibrate", show, shortcut="Ctrl+Shift+C", tip=tip)
        self._add_commands(menus)
        self._connect_calibration()
        self._add_setup(menus)

    @cached_property
    def import_page(self) -> ImportPage:
        """The page that makes a session of recordings from elsewhere."""
        page = ImportPage()
        page.session_requested.connect(self.session_requested)
        return self._add_page("import", page)

    @cached_property
    def export_page(self) -> ExportPage:
        """The page that writes a session for other programs."""
        return self._add_page("export", ExportPage())

    @cached_property
    def encode_page(self) -> FieldsPage:
        """The page that writes the spikes of a session as plain arrays."""
        return self._add_page("encode", encode_page())

    @cached_property
    def recover_page(self) -> FieldsPage:
        """The page that closes the parts of a session whose writer was killed."""
        return self._add_page("recover", recover_page())

    @cached_property
    def accept_page(self) -> FieldsPage:
        """The page that judges a rig by a session of the acceptance protocol."""
        return self._add_page("accept", accept_page())

    @cached_property
    def ports_page(self) -> PortsPage:
        """The page that lists the board on each port."""
        return self._add_page("ports", PortsPage(self._ports_refusal))

    def show_calibration(self, part: str) -> None:
        """Show a part of the page Calibrate."""
        self.calibrate_page.show_part(part)
        self._stack.show_page("calibrate")

    def show_export(self, session: str) -> None:
        """Show the page Export with a session."""
        self.export_page.show_session(session)
        self._stack.setCurrentWidget(self.export_page)

    def show_setup(self) -> None:
        """Show the page Set up."""
        self._stack.show_page("setup")
        self.setup_page.open()

    def close(self) -> None:
        """End the commands that still run."""
        for page in self._commands:
            page.close_process()
        self.setup_page.boards.worker.close()

    def _add_commands(self, menus: ActionRegistry) -> None:
        """Add the ways to the pages of commands, which are made when they are first wanted."""
        judge = "Judge a rig by a session of the acceptance protocol"
        made = "Make a session of recordings from elsewhere"
        export = "Write a session for other programs: NWB, MATLAB, Parquet, Neo, CSV"
        spikes = "Write the spikes of a session as plain arrays"
        close = "Close the parts of a session whose writer was killed"
        for menu, text, tip, page in (
            ("File", "I&mport recordings", made, lambda: self.import_page),
            ("File", "&Export a session", export, lambda: self.export_page),
            ("Tools", "&Encode a session", spikes, lambda: self.encode_page),
            ("Tools", "&Recover a session", close, lambda: self.recover_page),
            ("Tools", "&Accept a rig", judge, lambda: self.accept_page),
            ("Tools", "&Serial ports", "List the board on each port", lambda: self.ports_page),
        ):
            menus.add(menu, text, partial(self._show, page), tip=tip)

    def _add_page(self, name: str, page: _Page) -> _Page:
        """Add the page of a command, which runs in a process of its own."""
        self._commands.append(page)
        self._stack.add_page(name, page)
        page.closed.connect(self.closed)
        if isinstance(page, FieldsPage):
            page.path_requested.connect(partial(self._choose_path, name))
        return page

    def _show(self, page: Callable[[], QWidget]) -> None:
        self._stack.setCurrentWidget(page())

    def _connect_calibration(self) -> None:
        link, page = self._link, self.calibrate_page
        page.command_requested.connect(self._request)
        link.status_changed.connect(page.show_status)
        link.closed.connect(lambda _: self._leave_rig())
        link.silent.connect(page.load_cell.show_old)
        link.refused.connect(page.show_refusal)
        link.answered.connect(page.show_answer)

    def _add_setup(self, menus: ActionRegistry) -> None:
        link, page = self._link, SetupPage(BoardsBox(self._ports_refusal))
        self.setup_page, strip = page, self.flash_strip
        page.boards.path_requested.connect(partial(self._choose_path, "setup"))
        page.boards.connect_requested.connect(self.connect_requested)
        page.flash_requested.connect(link.close)
        strip.flash_requested.connect(self._flash)
        link.opened.connect(strip.hide)
        link.closed.connect(self._offer_flash)
        link.event_received.connect(self._take_event)
        self._stack.add_page("setup", page)
        page.closed.connect(self.closed)
        page.command_requested.connect(self._request)
        link.status_changed.connect(page.show_status)
        link.closed.connect(lambda _: page.show_status(EngineStatus()))
        link.refused.connect(page.show_refusal)
        tip = "Check a rig part by part, from its wires to the first trial"
        menus.add("Rig", "Set &up …", self.show_setup, tip=tip)

    def _leave_rig(self) -> None:
        """Say what was measured and not saved, and forget it, as the engine does at its end."""
        if unsaved := self.calibrate_page.unsaved:
            self.reported.emit("check", UNSAVED.format(parts=", ".join(unsaved)))
        self.calibrate_page.show_status(EngineStatus())

    def _request(self, command: str, args: dict[str, Any]) -> None:
        self._link.request(command, **args)

    def _offer_flash(self, reason: str) -> None:
        """Offer to flash the board that a connection failed for."""
        self.flash_strip.hide()
        if offered := offered_flash(reason):
            self.flash_strip.offer(*offered, reason)

    def _take_event(self, message: dict[str, Any]) -> None:
        """Offer to flash a board that answers with another build than this installation brings."""
        data = message.get("data") or {}
        if port := data.get("flash_at"):
            self.flash_strip.offer(str(data["board"]), str(port), str(message.get("text")))

    def _flash(self, board: str, port: str) -> None:
        """Flash a board; a connected rig lets its ports go first."""
        is_connected = self._link.is_connected
        self._link.close()
        self._stack.show_page("setup")
        if is_connected:
            self.setup_page.boards.show_released()
        else:
            self.setup_page.boards.flash(board, port)

    def _choose_path(self, page: str, kind: object, selected: object) -> None:
        """Let the user choose a file, and come back to the page."""
        assert callable(selected)

        def take(path: str) -> None:
            selected(path)
            self._stack.show_page(page)

        self.path_requested.emit(kind, take)

    def _ports_refusal(self) -> str:
        uses_boards = self._link.is_connected and not self._link.status.simulated
        return IN_USE if uses_boards else ""
