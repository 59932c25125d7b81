"""The health strips: the figures that show whether a recording or a scan counts, each judged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from PySide6.QtCore import QEvent, QTimer
from PySide6.QtGui import QHideEvent, QResizeEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QWidget

from gui.widgets.data_ages import DataAges, stale_words
from gui.widgets.formatting import age, ago, size
from gui.widgets.labels import Level, StatusLamp, elastic, label, set_property, show_tooltip
from gui.widgets.layouts import EventWatch, hbox, vbox
from gui.widgets.theme import text_scale
from rigctl.boards.drum_registers import SHOWN, Register
from rigctl.engine.rpc.messages import BoardStatus, EngineStatus, RecordingStatus
from rigctl.finger.latency import FEATURES, SCREEN
from rigctl.finger.status import FingerEngineStatus
from rigctl.values import SAMPLE_RATE_HZ

VERDICTS_PX = 1240
_CELL_GAP_PX, _SIDES_PX = 2, 16
DISK_HOURS_LIMIT = 1.0
DISK_FREE_LIMIT_BYTES = 2_000_000_000
RECENT_LOSS_S = 60.0
"""So long after a loss the figure is BAD."""


class Reading(NamedTuple):
    """Text and verdict of one cell; ``short``: a text for a cell that the first does not fit."""

    text: str
    level: Level
    short: str = ""


class CellSpec(NamedTuple):
    """Name, stretch (the width in pixels in the smallest window) and tooltip of a cell."""

    name: str
    stretch: int
    tooltip: str


class HealthCell(QFrame):
    """Name, value with unit, verdict in words, and a lamp."""

    def __init__(self, spec: CellSpec) -> None:
        super().__init__()
        self.setProperty("role", "card")
        self.setToolTip(spec.tooltip)
        self.lamp = StatusLamp(13)
        self.verdict = label("", "muted")
        self.value = elastic(label("–", "value"))
        grid = QGridLayout(self)
        grid.setContentsMargins(4, 3, 4, 3)
        grid.setVerticalSpacing(0)
        grid.setHorizontalSpacing(2)
        grid.addWidget(label(spec.name, "muted"), 0, 0)
        grid.addWidget(self.verdict, 0, 1)
        grid.addWidget(self.lamp, 0, 2)
        grid.addWidget(self.value, 1, 0, 1, 3)
        grid.setColumnStretch(0, 1)

    def show_reading(self, reading: Reading) -> None:
        """Show a value and its verdict."""
        self.value.setText(self._fitting(reading))
        self.lamp.set_level(reading.level)
        self.verdict.setText("" if reading.level is Level.OFF else reading.level.value.upper())
        is_alert = reading.level in (Level.WARN, Level.BAD)
        set_property(self.verdict, "role", reading.level.value if is_alert else "muted")
        set_property(self.value, "level", reading.level.value)
        set_property(self, "level", reading.level.value)

    def _fitting(self, reading: Reading) -> str:
        """Return the text, or the short one where the text is too wide."""
        needs_px = self.value.fontMetrics().horizontalAdvance(reading.text)
        return reading.short if reading.short and needs_px > self.value.width() else reading.text


class HealthRow(QWidget):
    """A row with a cell for each figure; two lines where the texts are too large for one."""

    def __init__(self, specs: Mapping[str, CellSpec]) -> None:
        super().__init__()
        self._stretches = {key: spec.stretch for key, spec in specs.items()}
        self._lines = (hbox(spacing=2), hbox(spacing=2))
        self._n_lines = 0
        self.setLayout(vbox(*self._lines, spacing=2, margins=(8, 0, 8, 0)))
        self.cells = {key: HealthCell(spec) for key, spec in specs.items()}
        self._fill_lines(1)
        kinds = QEvent.Type
        EventWatch(self, self._fit, kinds.Show, kinds.FontChange, kinds.StyleChange)
        self.setMinimumWidth(1)  # a strip that another one hides must not widen the window
        self.show_nothing()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the cells in a turn of its own: a second line takes its height from the plots."""
        super().resizeEvent(event)
        QTimer.singleShot(0, self, self._fit)

    def hideEvent(self, event: QHideEvent) -> None:
        """Take no more height than one line behind another strip."""
        super().hideEvent(event)
        self._fill_lines(1)

    def _fit(self) -> None:
        """Use a second line, and leave the verdicts to the lamps, where the words do not fit."""
        width_px = self.width() / text_scale()
        needs_px = sum(self._stretches.values()) + _CELL_GAP_PX * (len(self.cells) - 1) + _SIDES_PX
        n_lines = 1 if width_px >= needs_px or not self.isVisible() else 2
        if n_lines != self._n_lines:
            self._fill_lines(n_lines)
        for cell in self.cells.values():
            cell.verdict.setHidden(width_px * n_lines < VERDICTS_PX)

    def _fill_lines(self, n_lines: int) -> None:
        """Share the cells among the lines in their order, so that both are about as long."""
        self._n_lines = n_lines
        most_px = sum(self._stretches.values()) / n_lines
        used_px = 0
        for key, cell in self.cells.items():
            line = self._lines[min(int(used_px / most_px), n_lines - 1)]
            line.addWidget(cell, self._stretches[key])
            used_px += self._stretches[key]

    def show_nothing(self) -> None:
        """Show that no figure is known."""
        for cell in self.cells.values():
            cell.show_reading(Reading("–", Level.OFF))

    def show_readings(self, readings: Mapping[str, Reading]) -> None:
        """Show readings with their verdicts."""
        for key, reading in readings.items():
            self.cells[key].show_reading(reading)


def judge(is_good: bool) -> Level:
    """Return OK or BAD."""
    return Level.OK if is_good else Level.BAD


def loss_reading(count: int, lost_age_s: float | None, connected: bool) -> Reading:
    """Return how many samples are lost: BAD while that is recent, then OK with its age."""
    number = f"{count}" if count < 10_000 else f"{count // 1000} k"
    if not connected or not count:
        return Reading(number, Level.OK if connected else Level.OFF)
    if lost_age_s is not None and lost_age_s <= RECENT_LOSS_S:
        return Reading(number, Level.BAD)
    earlier = f"{number} earlier"
    text = earlier if lost_age_s is None else f"{number}, {ago(lost_age_s)}"
    return Reading(text, Level.OK, earlier)


def loss_line(what: str, count: int, lost_age_s: float | None) -> str:
    """Return a sentence on all losses; ``what``: whose, in the plural."""
    if not count:
        return f"No {what} are lost."
    when = f", the last of them {ago(lost_age_s)}" if lost_age_s is not None else ""
    return f"{count} {what} are lost{when}."


def age_reading(age_s: float | None, limit_s: float, connected: bool) -> Reading:
    """Return an age that must be at most the limit; None before any data."""
    if age_s is None:
        return Reading("–", Level.OFF if connected else Level.BAD)
    return Reading(age(age_s), judge(connected and age_s <= limit_s))


def disk_reading(recording: RecordingStatus) -> Reading:
    """Return the free disk space and, while recording, how long it lasts."""
    if not recording.disk_free_bytes:
        return Reading("–", Level.OFF)
    free, hours = size(recording.disk_free_bytes), recording.hours_left
    if (lasts := lasting_words(recording)) and hours is not None:
        return Reading(f"{free}, {lasts}", judge(hours > DISK_HOURS_LIMIT))
    return Reading(free, judge(recording.disk_free_bytes > DISK_FREE_LIMIT_BYTES))


def lasting_words(recording: RecordingStatus) -> str:
    """Return how long the free space lasts at the present rate, empty where nothing is recorded.

    The whole units are those that are left for sure.
    """
    hours = recording.hours_left
    if not recording.active or hours is None:
        return ""
    if hours >= 48:
        return f"{int(hours / 24)} d"
    return f"{int(hours)} h" if hours >= 1 else f"{int(60 * hours)} min"


RATE_TOLERANCE = 0.02
BLOCK_AGE_LIMIT_S = 0.3
POLL_AGE_LIMIT_S = 0.3
CLOCK_LIMIT_PPM = 5000.0
TRIAL_AGE_LIMIT_S = 180.0
SUPPLY_LIMITS_V = (4.6, 5.4)
MIN_FREE_STACK_PERCENT = 25
"""Of a chip's RAM that its stack has never used; with less, the stack may overwrite data."""
_REGISTER_PX = 96


CELLS = {
    "rate": CellSpec("Sample rate", 91, "Taxel samples in the last second: 1000 Hz ± 2 %"),
    "lost": CellSpec(
        "Lost samples",
        107,
        "Taxel samples that the board took and the computer never received since the engine "
        f"started: BAD for {RECENT_LOSS_S:g} s after each loss",
    ),
    "block": CellSpec("Block age", 86, "Time since the last taxel samples arrived: at most 300 ms"),
    "poll": CellSpec(
        "Poll age",
        92,
        "Time since the drum last answered: at most 300 ms; 3× means three repeated polls",
    ),
    "loadcell": CellSpec(
        "Cell lost",
        106,
        "Load-cell samples that the computer never received since the engine started: BAD for "
        f"{RECENT_LOSS_S:g} s after each loss. Spikes are single samples far from their "
        "neighbours, since the board's boot: the board does not act on them",
    ),
    "disk": CellSpec(
        "Disk left", 118, "Free disk space, and how long it lasts at the present recording rate"
    ),
    "clock": CellSpec(
        "Clock ppm",
        119,
        "Rate errors of the drum's and the taxel board's clocks: at most ±5000 ppm",
    ),
    "boards": CellSpec(
        "Boards",
        72,
        "Supply of the taxel board, its self-test, the causes of the boards' resets, and "
        "the stack that their programs never used: at least 25 % of the RAM",
    ),
    "ticks": CellSpec(
        "Ticks", 106, "Late ticks of both boards since connecting: 0; and their longest interrupt"
    ),
    "trial": CellSpec(
        "Last trial",
        93,
        "Time since the last committed trial of this sitting: at most 3 min during a run",
    ),
    **{
        entry.name: CellSpec(entry.shown, _REGISTER_PX, f"The drum: {entry.doc}") for entry in SHOWN
    },
}


class HealthStrip(HealthRow):
    """One cell per figure: name, value with unit, verdict, and a lamp."""

    def __init__(self) -> None:
        super().__init__(CELLS)

    def show_status(self, status: EngineStatus) -> None:
        """Show and judge the figures of a status."""
        self.show_readings(readings(status))
        details = {
            "lost": taxel_loss_lines(status),
            "loadcell": loadcell_loss_lines(status),
            "boards": board_lines(status.boards),
            "ticks": tick_lines(status.boards),
        }
        for key, lines in details.items():
            show_tooltip(self.cells[key], "\n".join([CELLS[key].tooltip, *lines]))

    def show_ages(self, ages: DataAges) -> None:
        """Show nothing once the engine's last status is too old."""
        if stale_words(ages.engine_s):
            self.show_nothing()


def readings(status: EngineStatus) -> dict[str, Reading]:
    """Return the reading of each cell."""
    return {
        "rate": _sample_rate(status),
        "lost": loss_reading(status.lost_samples, status.lost_age_s, status.taxels_connected),
        "block": age_reading(status.last_block_age_s, BLOCK_AGE_LIMIT_S, status.taxels_connected),
        "poll": _poll(status),
        "loadcell": _loadcell(status),
        "disk": disk_reading(status.recording),
        "clock": _clock(status.clock_ppm),
        "boards": _boards(status.boards),
        "ticks": _ticks(status.boards),
        "trial": _trial(status.run.trial_age_s, status.run.state == "running"),
        **{entry.name: _register(entry, status) for entry in SHOWN},
    }


def _register(entry: Register, status: EngineStatus) -> Reading:
    """Return the value of a register; none is judged."""
    value = status.registers.get(entry.name)
    if value is None or not status.drum_connected:
        return Reading("–", Level.OFF)
    return Reading(f"{value:g} {entry.unit}".strip(), Level.OFF)


def _sample_rate(status: EngineStatus) -> Reading:
    error = abs(status.frame_rate_hz - SAMPLE_RATE_HZ) / SAMPLE_RATE_HZ
    level = judge(status.taxels_connected and error <= RATE_TOLERANCE)
    return Reading(f"{status.frame_rate_hz:.0f} Hz", level)


def _poll(status: EngineStatus) -> Reading:
    """Return the age and the retries; only the age is judged, as a retry loses no data."""
    reading = age_reading(status.poll_age_s, POLL_AGE_LIMIT_S, status.drum_connected)
    retries = f", {status.poll_retries}×" if status.poll_retries else ""
    return Reading(f"{reading.text}{retries}", reading.level)


def _loadcell(status: EngineStatus) -> Reading:
    """Return the lost samples and, where the board has seen any, the spikes."""
    lost = loss_reading(status.loadcell_lost, status.loadcell_lost_age_s, status.drum_connected)
    spikes = status.boards["drum"].loadcell_spikes if "drum" in status.boards else None
    if not spikes or lost.level is Level.BAD:
        return lost
    return Reading(f"{spikes} spike{'s' if spikes > 1 else ''}", Level.WARN)


def _clock(ppm: Mapping[str, float | None]) -> Reading:
    errors = [error for error in (ppm.get("drum"), ppm.get("taxels")) if error is not None]
    if not errors:
        return Reading("–", Level.OFF)
    text = ", ".join(f"{error:+.0f}" for error in errors).replace("-", "−")
    return Reading(text, judge(max(map(abs, errors)) <= CLOCK_LIMIT_PPM))


def _boards(boards: Mapping[str, BoardStatus]) -> Reading:
    """Return the worst problem of the boards, else the supply."""
    supply_v = boards["taxels"].supply_v if "taxels" in boards else None
    if n_findings := sum(len(board.self_test or ()) for board in boards.values()):
        return Reading(f"{n_findings} finding{'s' if n_findings > 1 else ''}", Level.BAD)
    if any(board.unwanted for board in boards.values()):
        return Reading("restarted", Level.BAD)
    low_v, high_v = SUPPLY_LIMITS_V
    if supply_v is not None and not low_v <= supply_v <= high_v:
        return Reading(f"{supply_v:.2f} V", Level.BAD)
    stacks = [b.stack_free_percent for b in boards.values() if b.stack_free_percent is not None]
    if stacks and min(stacks) < MIN_FREE_STACK_PERCENT:
        return Reading(f"stack {min(stacks)} %", Level.WARN)
    return Reading("–", Level.OFF) if supply_v is None else Reading(f"{supply_v:.2f} V", Level.OK)


def _ticks(boards: Mapping[str, BoardStatus]) -> Reading:
    """Return the late ticks of both boards, and the longest interrupt of either."""
    late = [board.late_ticks for board in boards.values() if board.late_ticks is not None]
    longest = [board.longest_isr_us for board in boards.values() if board.longest_isr_us]
    if not late:
        return Reading("–", Level.OFF)
    interrupt = f", {max(longest):.0f} µs" if longest else ""
    return Reading(f"{sum(late)} late{interrupt}", Level.WARN if sum(late) else Level.OK)


def taxel_loss_lines(status: EngineStatus) -> list[str]:
    """Return lines on all lost taxel samples and their gaps."""
    line = loss_line("taxel samples", status.lost_samples, status.lost_age_s)
    return [line, f"Gaps: {status.gaps}."] if status.gaps else [line]


def loadcell_loss_lines(status: EngineStatus) -> list[str]:
    """Return a line on all lost load-cell samples."""
    return [loss_line("load-cell samples", status.loadcell_lost, status.loadcell_lost_age_s)]


def board_lines(boards: Mapping[str, BoardStatus]) -> list[str]:
    """Return lines on each board's identity, reset, supply, stack and self-test."""
    lines = []
    for name, board in boards.items():
        supply = "" if board.supply_v is None else f", supply {board.supply_v:.2f} V"
        lines.append(
            f"{name}: firmware {board.firmware}, boot {board.boot_count} by {board.reset}{supply}"
        )
        if board.stack_free_percent is not None:
            lines.append(
                f"{name}: {board.free_stack_bytes} bytes of stack never used, "
                f"{board.stack_free_percent} % of its RAM"
            )
        if board.self_test is not None:
            lines += board.self_test or [f"{name}: the self-test found no fault"]
    return lines


def tick_lines(boards: Mapping[str, BoardStatus]) -> list[str]:
    """Return a line on the timing of each board."""
    return [
        f"{name}: {board.late_ticks} late ticks, longest interrupt {board.longest_isr_us:g} µs, "
        f"idle {board.idle_percent:g} %"
        for name, board in boards.items()
        if None not in (board.late_ticks, board.longest_isr_us, board.idle_percent)
    ]


def _trial(age_s: float | None, running: bool) -> Reading:
    if age_s is None:
        return Reading("–", Level.OFF)
    level = judge(age_s <= TRIAL_AGE_LIMIT_S) if running else Level.OFF
    return Reading(ago(age_s), level)


AGE_LIMIT_S = 0.3
TRACKER_AGE_LIMIT_S = 0.1
"""A scan with a longer time without a position does not count."""
LATENCY_LIMITS_MS = {FEATURES: 5.0, SCREEN: 50.0}
FINGER_CELLS = {
    "rate": CellSpec("Sample rate", 126, "Samples of the last second: 1000 Hz ± 2 %"),
    "lost": CellSpec(
        "Lost samples",
        110,
        "Samples that the board took and the computer never received since the engine started: "
        f"BAD for {RECENT_LOSS_S:g} s after each loss",
    ),
    "block": CellSpec("Block age", 118, "Time since the last samples arrived: at most 300 ms"),
    "tracker": CellSpec(
        "Tracker age", 128, "Time since the last position of the tracker: at most 100 ms, and valid"
    ),
    "dropouts": CellSpec("Dropouts", 118, "Gaps in the tracker's positions that were bridged"),
    "outliers": CellSpec("Outliers", 114, "Positions that no finger can reach, left out"),
    "late": CellSpec(
        "Late velocities", 128, "Velocities that reached the board after their batch: 0"
    ),
    FEATURES: CellSpec(
        "Features", 116, "From sending a velocity to its features, 99th percentile: at most 5 ms"
    ),
    SCREEN: CellSpec(
        "On screen",
        120,
        "From sending a velocity to the painted answer, 99th percentile: at most 50 ms",
    ),
    "disk": CellSpec(
        "Disk left", 130, "Free disk space, and how long it lasts at the present recording rate"
    ),
}


class FingerHealthStrip(HealthRow):
    """One cell per figure."""

    def __init__(self) -> None:
        super().__init__(FINGER_CELLS)

    def show_status(self, status: FingerEngineStatus) -> None:
        """Show and judge the figures of a status."""
        self.show_readings(finger_readings(status))
        line = loss_line("samples", status.lost_samples, status.lost_age_s)
        show_tooltip(self.cells["lost"], f"{FINGER_CELLS['lost'].tooltip}\n{line}")


def finger_readings(status: FingerEngineStatus) -> dict[str, Reading]:
    """Return the reading of each cell."""
    connected = status.finger_connected
    latencies = {
        kind: _latency(kind, status.latency_p99_ms.get(kind)) for kind in LATENCY_LIMITS_MS
    }
    return {
        "rate": _rate(status),
        "lost": loss_reading(status.lost_samples, status.lost_age_s, connected),
        "block": age_reading(status.block_age_s, AGE_LIMIT_S, connected),
        "tracker": _tracker(status),
        "dropouts": _noted(status.dropouts, status.tracker_connected),
        "outliers": _noted(status.outliers, status.tracker_connected),
        "late": _noted(status.late_velocities, connected),
        **latencies,
        "disk": disk_reading(status.recording),
    }


def _rate(status: FingerEngineStatus) -> Reading:
    error = abs(status.sample_rate_hz - SAMPLE_RATE_HZ) / SAMPLE_RATE_HZ
    level = judge(status.finger_connected and error <= RATE_TOLERANCE)
    return Reading(f"{status.sample_rate_hz:.0f} Hz", level)


def _tracker(status: FingerEngineStatus) -> Reading:
    connected, age_s = status.tracker_connected, status.position_age_s
    if connected and age_s is not None and not status.position_valid:
        return Reading("lost", Level.BAD)
    return age_reading(age_s, TRACKER_AGE_LIMIT_S, connected)


def _noted(count: int, connected: bool) -> Reading:
    """Return a number that is bridged or repeated: worth a look, no data are lost."""
    level = (Level.WARN if count else Level.OK) if connected else Level.OFF
    return Reading(f"{count}", level)


def _latency(kind: str, ms: float | None) -> Reading:
    if ms is None:
        return Reading("–", Level.OFF)
    return Reading(f"{ms:.1f} ms", judge(ms <= LATENCY_LIMITS_MS[kind]))
