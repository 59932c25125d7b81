"""A page that runs one command of ``rigctl`` in a process of its own and shows what it prints."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from PySide6.QtCore import QProcess, Qt, Signal
from PySide6.QtWidgets import QHBoxLayout, QLineEdit, QPlainTextEdit, QWidget

from gui.widgets.file_browser import PathKind, browse_button, typed_path
from gui.widgets.labels import label, set_property
from gui.widgets.layouts import hbox, push_button, vbox

_KILL_MS = 1000


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
        buttons = hbox(self.run_button, self.cancel_button, self.close_button, wide=-1)
        buttons.addStretch(1)
        rows = (label(title, "heading"), label(explanation, "muted", wraps=True), self._inputs)
        column = vbox(*rows, buttons, self.verdict, self.output, spacing=6, margins=(9, 4, 9, 4))
        column.setStretch(5, 1)
        self.setLayout(column)
        self._show_running(False)

    @property
    def is_running(self) -> bool:
        """Whether the command runs."""
        return self._process is not None

    def run(self) -> None:
        """Start the command, or say why it cannot start."""
        if self.is_running:
            return
        self.output.clear()
        if refusal := self._refusal():
            self._show_verdict(refusal, "bad")
            return
        process = self._process = QProcess(self)
        process.setProcessChannelMode(QProcess.ProcessChannelMode.MergedChannels)
        process.readyReadStandardOutput.connect(self._read)
        process.finished.connect(self._finish)
        self._show_verdict("Running …", "muted")
        self._show_running(True)
        process.start(sys.executable, ["-m", "rigctl", *self._words()])

    def cancel(self) -> None:
        """End the command."""
        process, self._process = self._process, None
        if process is not None:
            process.finished.disconnect(self._finish)
            process.finished.connect(process.deleteLater)
            process.kill()
            self._show_verdict("Cancelled.", "muted")
            self._show_running(False)

    def close_process(self) -> None:
        """End the command before the window closes."""
        process = self._process
        self.cancel()
        if process is not None:
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
        self._show_running(False)

    def add_input(self, widget: QWidget, stretch: int = 0) -> None:
        """Add a field above the buttons."""
        self._inputs.addWidget(widget, stretch, Qt.AlignmentFlag.AlignVCenter)

    def _show_verdict(self, text: str, role: str) -> None:
        self.verdict.setText(text)
        set_property(self.verdict, "role", role)

    def _show_running(self, running: bool) -> None:
        self.run_button.setEnabled(not running)
        self.cancel_button.setEnabled(running)


class AcceptPage(CommandPage):
    """Force, drift, speed, steps and losses of a rig, each against its limit."""

    path_requested = Signal(object, object)

    def __init__(self) -> None:
        explanation = (
            "Judges force, drift, speed, steps and losses of a rig by a session that was recorded "
            "with the protocol “acceptance”, as rigctl accept does."
        )
        super().__init__(
            "Accept a rig",
            explanation,
            "Judge the rig",
            words=self._accept_words,
            refusal=self._missing_session,
        )
        self.folder = QLineEdit(placeholderText="Session of the acceptance protocol")
        self.folder.returnPressed.connect(self.run)
        self.add_input(label("Session"))
        self.add_input(self.folder, 1)
        self.add_input(browse_button(self.path_requested, PathKind.SESSION, self.folder.setText))

    def _accept_words(self) -> Sequence[str]:
        return ("accept", "--", str(typed_path(self.folder.text())))

    def _missing_session(self) -> str:
        return "" if self.folder.text().strip() else "Choose the folder of a session first."


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
