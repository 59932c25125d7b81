"""The event log, the line with the latest event, and what an action came to in its words."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from PySide6.QtCore import QElapsedTimer, Qt, QTime, QTimer, Signal
from PySide6.QtGui import QTextBlock
from PySide6.QtWidgets import QLineEdit, QPlainTextEdit, QWidget

from gui.operate.bench_controls import FAULTS, WIRINGS_ON_OFF
from gui.widgets.labels import ElidedLabel, set_property, show_text
from gui.widgets.layouts import ComboBox, hbox
from gui.widgets.theme import applied_theme
from rigctl.engine.calibration_values import (
    ForceLoopGains,
    MassReading,
    gains_words,
    imbalance_words,
)

_NAMES = {
    "calibrate_range": "taxel range",
    "test_taxels": "taxel test",
    "calibrate_loadcell": "load cell",
    "calibrate_force": "force loop",
    "calibrate_imbalance": "imbalance",
    "calibrate_wiring": "taxel order",
    "end_record": "record",
    "setup_check": "set up",
    "setup_keep": "set up",
    "setup_commission": "set up",
    "inject": "bench",
    "lsl": "streaming",
}
"""Where a button has other words than its command."""
_DONE = {
    "arm": "armed, lifted",
    "disarm": "lifted, motors off",
    "home": "the index mark is found",
    "tare": "the load cell is at 0 g",
    "approach": "the force is reached",
    "run": "the drum has turned over the plate",
    "retract": "lifted",
    "discard_calibration": "forgotten",
    "clear_fault": "the fault is cleared",
}


def action_name(command: str) -> str:
    """Return the name of an action for people."""
    return _NAMES.get(command, command.replace("_", " "))


def action_result(command: str, result: Mapping[str, Any]) -> str:
    """Return what a command came to, empty for one that is no action of a panel."""
    words = _DONE.get(command) or _measured(command, result)
    return f"{action_name(command)}: {words}" if words else ""


def injected_words(injected: Mapping[str, Any], texts: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the text of an injected fault as its list has it, or the words of the engine."""
    known = (text for text, args in texts.items() if args == injected)
    return next(known, " ".join(str(value).replace("_", " ") for value in injected.values()))


def _measured(command: str, result: Mapping[str, Any]) -> str:
    match command:
        case "jog" if "moved_mm" in result:
            return f"{result['moved_mm']:+.1f} mm".replace("-", "−")
        case "set" if "speed_mm_s" in result and "force_g" in result:
            return f"the drum has {result['speed_mm_s']:.1f} mm/s and {result['force_g']:.0f} g"
        case "calibrate_loadcell" if "mass_g" in result:
            reading = MassReading(**result)
            counts, spread = reading.mean_counts, reading.sd_counts
            return f"{reading.mass_g:g} g: {counts:.0f} counts ± {spread:.0f}"
        case "calibrate_force" if "gain_p_per_s" in result:
            return gains_words(ForceLoopGains(**result))
        case "calibrate_imbalance" if "table_g" in result:
            return imbalance_words(result["table_g"])
        case "calibrate_wiring" if "found" in result:
            return str(result["found"])
        case "save_calibration" if "kept_in" in result:
            saved = f"{result['part']} is saved in {' and '.join(result['kept_in'])}"
            return f"{saved}; {result['remark']}" if result.get("remark") else saved
        case "setup_check" if "part" in result:
            return f"{result['part']}: {'right' if result['passed'] else result['problem']}"
        case "setup_keep" if "says" in result:
            return f"rig.toml says {result['says']}"
        case "setup_commission" if "not_checked" in result:
            return f"commissioned; nobody has checked {', '.join(result['not_checked'])}"
        case "calibrate_range" if "low" in result:
            return f"the ranges of {len(result['low'])} taxels are measured"
        case "plate" if "texture" in result:
            return f"{result['texture']} is on the drum"
        case "inject" if "injected" in result:
            return injected_words(result["injected"], {**FAULTS, **WIRINGS_ON_OFF})
        case "test_taxels" if "found" in result:
            return "; ".join(map(str, result["found"])) or "no findings"
        case "record" if "session" in result:
            return f"recording into {result['session']}"
        case "end_record" if "session" in result:
            return f"{Path(str(result['session'])).name} is closed"
    return ""


MAX_LINES = 2000
ERROR_HOLD_MS = 8000
RED_MS = 30_000
ERROR_KINDS = frozenset(
    {
        "fault",
        "refused",
        "lost",
        "link",
        "gap",
        "disk",
        "failed",
        "stop",
        "check",
        "contact",
        "late",
        "awake",
        "unrecorded",
        "hook",
        "copy",
    }
)


class LogLine(NamedTuple):
    """The time of day, the kind of the event and its text."""

    time: str
    kind: str
    text: str


ALL_KINDS, PROBLEMS = "all kinds", "problems"


class EventLog(QPlainTextEdit):
    """A read-only log; each line begins with the time at which the window got the event."""

    kind_came = Signal(str)
    """An event of a kind that the log did not have."""

    def __init__(self) -> None:
        super().__init__(readOnly=True, maximumBlockCount=MAX_LINES)
        self.setMinimumHeight(48)
        self._lines: deque[LogLine] = deque(maxlen=MAX_LINES)
        self._kinds: set[str] = set()
        self._kind, self._words = ALL_KINDS, tuple[str, ...]()

    def show_only(self, kind: str, words: str) -> None:
        """Show the lines of a kind, of all or of problems that contain each of these words."""
        self._kind, self._words = kind, tuple(words.casefold().split())
        block = self.document().firstBlock()
        for line in self._lines:
            self._show_block(block, line)
            block = block.next()
        self._lay_out()

    def reset_colours(self) -> None:
        """Show the present lines in the colours of another theme."""
        super().clear()
        for line in self._lines:
            self._show(line)
        self._lay_out()

    def add(self, kind: str, text: str, at: QTime | None = None) -> None:
        """Append an event of now or ``at`` a time; errors get the theme's colour for them."""
        line = LogLine((at or QTime.currentTime()).toString("HH:mm:ss"), kind, text)
        self._lines.append(line)
        self._show(line)
        if not self._is_shown(line):
            self._lay_out()
        if kind not in self._kinds:
            self._kinds.add(kind)
            self.kind_came.emit(kind)

    def clear(self) -> None:
        """Remove all lines."""
        self._lines.clear()
        super().clear()

    def _show(self, line: LogLine) -> None:
        theme = applied_theme()
        colour = theme.bad if line.kind in ERROR_KINDS else theme.text
        self.appendHtml(
            f'<span style="color:{theme.muted}">{line.time}&nbsp;&nbsp;{escape(line.kind)}&nbsp;'
            f'</span> <span style="color:{colour}">{escape(line.text)}</span>'
        )
        self._show_block(self.document().lastBlock(), line)

    def _show_block(self, block: QTextBlock, line: LogLine) -> None:
        """Show or hide the block of a line; the text of all 2000 anew would take too long."""
        block.setVisible(self._is_shown(line))
        block.setLineCount(max(1, block.layout().lineCount()) if block.isVisible() else 0)

    def _is_shown(self, line: LogLine) -> bool:
        is_problem = self._kind == PROBLEMS and line.kind in ERROR_KINDS
        text = " ".join(line).casefold()
        is_kind = is_problem or self._kind in (ALL_KINDS, line.kind)
        return is_kind and all(word in text for word in self._words)

    def _lay_out(self) -> None:
        document = self.document()
        document.markContentsDirty(0, document.characterCount())
        document.documentLayout().documentSizeChanged.emit(document.size())
        self.viewport().update()


class LogPanel(QWidget):
    """A log beside its filter."""

    def __init__(self, log: EventLog) -> None:
        super().__init__()
        self.kinds, self.search = ComboBox(), QLineEdit(placeholderText="Search the log")
        self.kinds.addItems([ALL_KINDS, PROBLEMS])
        self.kinds.setSizeAdjustPolicy(ComboBox.SizeAdjustPolicy.AdjustToContents)
        self.kinds.setToolTip("Show the events of one kind")
        self.kinds.setAccessibleName("Kind of the events in the log")
        self.search.setAccessibleName("Search the log")
        self.search.setToolTip("Words that each line must contain")
        self.search.setClearButtonEnabled(True)
        log.kind_came.connect(self.kinds.addItem)
        for changed in (self.kinds.currentTextChanged, self.search.textChanged):
            changed.connect(lambda _: log.show_only(self.kinds.currentText(), self.search.text()))
        row = hbox(log, self.kinds, self.search)
        row.setStretch(0, 5)
        row.setStretch(2, 1)
        for control in (self.kinds, self.search):
            row.setAlignment(control, Qt.AlignmentFlag.AlignTop)
        self.setLayout(row)
        self.setFocusProxy(log)


class StatusLine(ElidedLabel):
    """The latest event; an error stays for a while unless another error follows.

    An error that nothing has replaced loses its red: the log keeps it, with its time. A text that
    is too long ends in an ellipsis; :meth:`text`, the tooltip and the log have all of it.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text, "muted")
        self._since_error = QElapsedTimer()
        self.red_timer = QTimer(self, singleShot=True, interval=RED_MS)
        self.red_timer.timeout.connect(lambda: set_property(self, "role", "muted"))

    def show_event(self, kind: str, text: str) -> None:
        """Show an event unless a recent error is more important."""
        is_error = kind in ERROR_KINDS
        if is_error:
            self._since_error.start()
            self.red_timer.start()
        elif self._since_error.isValid() and not self._since_error.hasExpired(ERROR_HOLD_MS):
            return
        show_text(self, text)
        set_property(self, "role", "bad" if is_error else "muted")
