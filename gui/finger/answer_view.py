"""The answer, large: which plate, right or wrong, how sure, and after how long."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QPaintEvent
from PySide6.QtWidgets import QFrame

from gui.finger.scan_record import AnswerState, ScanRecord
from gui.widgets.labels import elastic, label, set_property, show_text
from gui.widgets.layouts import hbox, vbox
from rigctl.finger_values import PredictionRow
from rigctl.realtime.messages import FingerRunStatus

_MARKS = {
    AnswerState.NONE: "",
    AnswerState.GROWING: "…",
    AnswerState.RIGHT: "✓",
    AnswerState.WRONG: "✗",
    AnswerState.UNKNOWN: "⚠",
}


class AnswerView(QFrame):
    """A frame whose background is the verdict, as in the paper's demonstration.

    Marks and words say the same as the colour.
    """

    painted = Signal(int, float)
    """Scan and time of sending of the velocity, after an answer to it is on the screen."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("role", "answer")
        self.caption, self.verdict = elastic(label("", "muted")), label("", "verdict", wraps=True)
        self.mark, self.letter = label("", "mark"), label("", "letter")
        self.decision, self.texture_set = elastic(label("", "")), elastic(label("", ""))
        for text in (self.mark, self.letter):
            text.setAlignment(Qt.AlignmentFlag.AlignCenter)
        answer = hbox(self.letter, self.mark, self.verdict, wide=2, spacing=12)
        column = vbox(self.caption, spacing=1, margins=(10, 6, 10, 6))
        column.addLayout(answer, 1)
        column.addWidget(self.decision)
        column.addWidget(self.texture_set)
        self.setLayout(column)
        self.coverage = FingerRunStatus().coverage
        """Share of the sets that hold the true texture."""
        self._unpainted: tuple[int, float] | None = None
        self.show_record(ScanRecord())

    @property
    def state(self) -> str:
        """The verdict that is shown."""
        return str(self.property("verdict"))

    def show_record(self, record: ScanRecord, sent_s: float | None = None) -> None:
        """Show the newest answer; ``sent_s``: when the velocity that led to it was sent."""
        row, state = record.prediction, record.state
        set_property(self, "verdict", state.value)
        show_text(self.mark, _MARKS[state])
        show_text(self.letter, "–" if row is None else _letter(row))
        show_text(self.caption, _caption(record))
        show_text(self.verdict, _verdict_words(record))
        show_text(self.decision, _decision_words(record))
        show_text(self.texture_set, "" if row is None else _set_words(row, self.coverage))
        if row is not None and sent_s is not None:
            self._unpainted = (row.scan, sent_s)
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint, and report an answer that was not on the screen before."""
        super().paintEvent(event)
        if self._unpainted is not None:
            scan_and_time, self._unpainted = self._unpainted, None
            self.painted.emit(*scan_and_time)


def _letter(row: PredictionRow) -> str:
    return row.texture if row.known else "?"


def _caption(record: ScanRecord) -> str:
    row = record.prediction
    if record.scan < 0:
        return "No scan yet"
    if row is None:
        return f"Scan {record.scan}"
    windows = f"{row.windows} window{'s' if row.windows > 1 else ''}"
    return f"Scan {record.scan}: {row.distance_mm:.0f} mm, {row.seconds:.1f} s, {windows}"


def _verdict_words(record: ScanRecord) -> str:
    """Return the verdict in words."""
    row, state = record.prediction, record.state
    if row is None:
        return "The answer appears here while the finger moves" if record.scan < 0 else "no answer"
    share = row.probabilities.get(row.texture, 0.0)
    if not row.known:
        return f"not one of these; nearest is {row.texture} ({share:.0%})".replace("%", "\u202f%")
    words = {
        AnswerState.GROWING: "so far",
        AnswerState.RIGHT: "right",
        AnswerState.WRONG: f"wrong: the plate is {record.texture}",
    }[state]
    return f"{words} ({share:.0%})".replace("%", "\u202f%")


def _decision_words(record: ScanRecord) -> str:
    """Return after how many s and mm the answer was sure."""
    sure = record.first_sure
    if record.prediction is None:
        return ""
    if sure is None:
        return "Not sure at the end" if record.prediction.is_final else "Not sure yet"
    return f"Sure of {sure.texture} after {sure.seconds:.2f} s, {sure.distance_mm:.0f} mm"


def _set_words(row: PredictionRow, coverage: float) -> str:
    """Return the set of textures; one with all of them says nothing."""
    names, total = ", ".join(row.texture_set) or "none", len(row.probabilities)
    share = f"{coverage:.0%}".replace("%", "\u202f%")
    return f"{share} set: {names} ({len(row.texture_set)} of {total})"
