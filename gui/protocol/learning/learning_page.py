"""The tab with the learning curve of the session that the page of a run shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QWidget

from gui.analysis.export.export_button import TABLE, ExportButton
from gui.protocol.learning.curve_texts import heading, remarks
from gui.protocol.learning.curve_view import CurveView
from gui.widgets.labels import elastic, label, show_text
from gui.widgets.layouts import container, hbox, push_button, vbox

if TYPE_CHECKING:
    from rigctl.analysis.learning.session_curve import SessionCurve

NO_SESSION = "No session: start a run, or open one."
NO_TRIAL = "Not enough trials yet: no trial counts so far."
COMPUTING = "The first curve of this session is being computed."
NO_CURVE = "No curve yet."
CANCELLED = "Cancelled: press Compute for the curve of the trials so far."
FAILED = "Press Compute to try again."
CANCEL, COMPUTE = "Cancel", "Compute"


class LearningPage(QWidget):
    """Shows a curve, how far its computation is, and saves it."""

    shown = Signal()
    """The tab came to the front."""
    pressed = Signal()
    """Cancel or Compute was pressed."""
    export_requested = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.curve: SessionCurve | None = None
        self.heading = label(NO_SESSION, "heading", wraps=True)
        self.view = CurveView()
        self.remarks = label("", "muted", wraps=True)
        self.progress = elastic(label("", "muted"))
        self.button = push_button(
            CANCEL, self.pressed.emit, "End the computation, or begin it again"
        )
        self.save_button = ExportButton("png", "svg", "pdf", TABLE)
        self.save_button.export_requested.connect(self.export_requested)
        figure = vbox(self.heading, self.view, self.remarks, spacing=4)
        figure.setStretch(1, 1)
        self.figure = container(figure)
        """What is saved as a picture."""
        foot = hbox(self.progress, self.button, self.save_button, spacing=6)
        column = vbox(self.figure, container(foot), spacing=4, margins=(6, 6, 6, 4))
        column.setStretch(0, 1)
        self.setLayout(column)
        self.show_text(NO_SESSION)
        self.show_idle()

    def show_curve(self, curve: SessionCurve) -> None:
        """Show the curve of the trials so far, or what it still needs."""
        self.curve = curve
        self.view.show_points(curve.points)
        show_text(self.heading, heading(curve))
        show_text(self.remarks, remarks(curve))
        self.save_button.setEnabled(bool(curve.points))

    def show_text(self, sentence: str) -> None:
        """Show a sentence in place of a curve."""
        self.curve = None
        self.view.show_points(())
        show_text(self.heading, sentence)
        show_text(self.remarks, "")
        self.save_button.setEnabled(False)

    def show_progress(self, stage: str, share: float) -> None:
        """Show how far the computation is."""
        show_text(self.progress, f"{stage}, {100 * share:.0f} %")

    def show_computing(self) -> None:
        """Offer Cancel while the curve is computed."""
        if self.curve is None:
            self.show_text(COMPUTING)
        self.button.setText(CANCEL)
        self.button.setEnabled(True)

    def show_cancelled(self) -> None:
        """Offer Compute after Cancel."""
        self.show_idle(CANCELLED)
        if self.curve is None:
            self.show_text(NO_CURVE)

    def show_idle(self, text: str = "") -> None:
        """Show that nothing is computed; with a ``text`` that says why, offer Compute."""
        self.button.setText(COMPUTE)
        self.button.setEnabled(bool(text))
        show_text(self.progress, text)

    def showEvent(self, event: QShowEvent) -> None:
        """Tell that the curve is wanted."""
        super().showEvent(event)
        self.shown.emit()
