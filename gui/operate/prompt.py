"""The runner's question to the operator: a panel in the window, never a dialog over it."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QPushButton

from gui.widgets.labels import label
from gui.widgets.status_lamp import Level, StatusLamp
from gui.widgets.theme import Theme
from rigctl.acquisition.rpc.messages import PromptStatus


class PromptPanel(QFrame):
    """Hidden while there is nothing to answer."""

    answered = Signal(int, str)

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.setProperty("role", "prompt")
        self._prompt_id = 0
        self.lamp = StatusLamp(theme, 18)
        self.lamp.set_level(Level.WARN)
        self.text = label("", "heading", wraps=True)
        self.done = QPushButton("Done, go on")
        self.abort = QPushButton("Abort the run")
        self.done.clicked.connect(lambda: self.answered.emit(self._prompt_id, "ok"))
        self.abort.clicked.connect(lambda: self.answered.emit(self._prompt_id, "abort"))
        row = QHBoxLayout(self)
        row.setContentsMargins(10, 6, 10, 6)
        row.addWidget(self.lamp)
        row.addWidget(self.text, 1)
        row.addWidget(self.done)
        row.addWidget(self.abort)
        self.hide()

    def set_theme(self, theme: Theme) -> None:
        """Shine in other colours."""
        self.lamp.set_theme(theme)

    def show_prompt(self, prompt: PromptStatus | None) -> None:
        """Show a question, or hide when there is none."""
        if prompt is None:
            self.hide()
            return
        if prompt.id != self._prompt_id or self.isHidden():
            self._prompt_id = prompt.id
            self.text.setText(prompt.text)
            self.show()
