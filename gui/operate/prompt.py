"""The runner's question to the operator: a panel in the window, never a dialog over it."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame, QPushButton

from gui.widgets.labels import label
from gui.widgets.layouts import hbox
from gui.widgets.status_lamp import Level, StatusLamp
from rigctl.acquisition.rpc.messages import PromptStatus


class PromptPanel(QFrame):
    """A question and its two answers; hidden without a question."""

    command_requested = Signal(str, dict)

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("role", "prompt")
        self._prompt_id = 0
        lamp = StatusLamp(18)
        lamp.set_level(Level.WARN)
        self.text = label("", "heading", wraps=True)
        self.confirm = QPushButton("Done, continue")
        self.abort = QPushButton("Abort the run")
        self.confirm.clicked.connect(lambda: self._answer("ok"))
        self.abort.clicked.connect(lambda: self._answer("abort"))
        row = (lamp, self.text, self.confirm, self.abort)
        self.setLayout(hbox(*row, wide=1, spacing=6, margins=(10, 6, 10, 6)))
        self.hide()

    def show_prompt(self, prompt: PromptStatus | None) -> None:
        """Show a question, or hide the panel without one."""
        if prompt is None:
            self.hide()
        elif prompt.id != self._prompt_id or self.isHidden():
            self._prompt_id = prompt.id
            self.text.setText(prompt.text)
            self.show()

    def _answer(self, answer: str) -> None:
        args = {"prompt_id": self._prompt_id, "answer": answer}
        self.command_requested.emit("answer", args)
