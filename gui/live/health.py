"""The health strip: the numbers that tell a good recording from a bad one, each with a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QWidget

from gui.widgets.formatting import age, duration, size
from gui.widgets.labels import elastic, label, set_property
from gui.widgets.status_lamp import Level, StatusLamp
from gui.widgets.theme import Theme
from rigctl.acquisition.rpc.messages import BoardStatus, EngineStatus, RecordingStatus
from rigctl.values import SAMPLE_RATE_HZ

RATE_TOLERANCE = 0.02
BLOCK_AGE_LIMIT_S = 0.3
POLL_AGE_LIMIT_S = 0.3
CLOCK_LIMIT_PPM = 5000.0
DISK_HOURS_LIMIT = 1.0
DISK_FREE_LIMIT_BYTES = 2_000_000_000
TRIAL_AGE_LIMIT_S = 180.0
SUPPLY_LIMITS_V = (4.6, 5.4)
STACK_LEAST_PERCENT = 25
"""Of a chip's RAM that its program never used; below it the next call may write over data."""


class Reading(NamedTuple):
    """One cell: what it shows and how well that is."""

    text: str
    level: Level


CELLS = {
    "rate": ("Frame rate", "Taxel frames received in the last second; 1000 Hz within 2 %"),
    "gaps": ("Gaps", "Places in the taxel stream where samples are missing, since connecting"),
    "lost": ("Lost", "Taxel samples taken by the board that never arrived"),
    "block": ("Block age", "Time since the last taxel samples arrived; up to 300 ms"),
    "poll": (
        "Poll age",
        "Time since the drum answered; up to 300 ms; 3×: polls asked again",
    ),
    "loadcell": ("Cell lost", "Load-cell samples that never arrived"),
    "disk": ("Disk left", "Free space, and how long it lasts at the rate now being written"),
    "clock": ("Clock ppm", "How fast the clocks of drum and taxel board run; up to ±5000 ppm"),
    "boards": (
        "Boards",
        "Supply of the taxel board, its self-test, why the boards restarted, and the stack that "
        "their programs never used: at least 25 % of the RAM",
    ),
    "ticks": (
        "Ticks",
        "Ticks that both boards began late, since connecting: 0; and the longest interrupt",
    ),
    "trial": ("Last trial", "Time since a trial was committed; during a run up to 3 min"),
}

WIDTHS = {
    "rate": 124,
    "gaps": 90,
    "lost": 85,
    "block": 117,
    "poll": 107,
    "loadcell": 107,
    "disk": 120,
    "clock": 124,
    "boards": 113,
    "ticks": 118,
    "trial": 113,
}
"""Shares of the strip's width: its pixels where the window is at its smallest."""


class HealthStrip(QWidget):
    """One cell a figure: name, value with unit, a lamp whose shape tells as much as its colour."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        row = QHBoxLayout(self)
        row.setContentsMargins(8, 0, 8, 0)
        row.setSpacing(4)
        self.cells = {key: _Cell(name, hint, theme) for key, (name, hint) in CELLS.items()}
        for key, cell in self.cells.items():
            row.addWidget(cell, WIDTHS[key])

    def set_theme(self, theme: Theme) -> None:
        """Shine in other colours."""
        for cell in self.cells.values():
            cell.lamp.set_theme(theme)

    def show_nothing(self) -> None:
        """Nothing is known."""
        for cell in self.cells.values():
            cell.show_reading(Reading("–", Level.OFF))

    def show_status(self, status: EngineStatus, since_trial_s: float | None) -> None:
        """Judge a fresh status."""
        for key, reading in readings(status, since_trial_s).items():
            self.cells[key].show_reading(reading)
        for key, lines in (
            ("boards", board_lines(status.boards)),
            ("ticks", tick_lines(status.boards)),
        ):
            self.cells[key].show_hint("\n".join([CELLS[key][1], *lines]))


def readings(status: EngineStatus, since_trial_s: float | None) -> dict[str, Reading]:
    """What each cell shows for a status."""
    return {
        "rate": _frame_rate(status),
        "gaps": _count(status.gaps, status.taxels_connected),
        "lost": _count(status.lost_samples, status.taxels_connected),
        "block": _age(status.last_block_age_s, BLOCK_AGE_LIMIT_S, status.taxels_connected),
        "poll": _poll(status),
        "loadcell": _count(status.loadcell_lost, status.drum_connected),
        "disk": _disk(status.recording),
        "clock": _clock(status.clock_ppm),
        "boards": _boards(status.boards),
        "ticks": _ticks(status.boards),
        "trial": _trial(since_trial_s, status.run.state == "running"),
    }


def _judge(good: bool) -> Level:
    return Level.OK if good else Level.BAD


def _frame_rate(status: EngineStatus) -> Reading:
    off = abs(status.frame_rate_hz - SAMPLE_RATE_HZ) / SAMPLE_RATE_HZ
    level = _judge(off <= RATE_TOLERANCE) if status.taxels_connected else Level.BAD
    return Reading(f"{status.frame_rate_hz:.0f} Hz", level)


def _count(count: int, connected: bool) -> Reading:
    return Reading(f"{count}", _judge(count == 0) if connected else Level.OFF)


def _age(seconds: float | None, limit_s: float, connected: bool) -> Reading:
    if seconds is None:
        return Reading("–", Level.BAD if not connected else Level.OFF)
    return Reading(age(seconds), _judge(connected and seconds <= limit_s))


def _poll(status: EngineStatus) -> Reading:
    """A poll asked again cost nothing: it is told, and judged by the age alone."""
    text, level = _age(status.poll_age_s, POLL_AGE_LIMIT_S, status.drum_connected)
    return Reading(f"{text}, {status.poll_retries}×" if status.poll_retries else text, level)


def _disk(recording: RecordingStatus) -> Reading:
    if not recording.disk_free_bytes:
        return Reading("–", Level.OFF)
    hours = recording.hours_left
    enough = recording.disk_free_bytes > DISK_FREE_LIMIT_BYTES
    if recording.active and hours is not None:
        left = f"{hours / 24:.0f} d" if hours >= 48 else f"{hours:.0f} h"
        text = f"{size(recording.disk_free_bytes)}, {left}"
        return Reading(text, _judge(hours > DISK_HOURS_LIMIT))
    return Reading(size(recording.disk_free_bytes), _judge(enough))


def _clock(ppm: Mapping[str, float | None]) -> Reading:
    known = [value for value in (ppm.get("drum"), ppm.get("taxels")) if value is not None]
    if not known:
        return Reading("–", Level.OFF)
    text = ", ".join(f"{value:+.0f}" for value in known).replace("-", "−")
    return Reading(text, _judge(max(map(abs, known)) <= CLOCK_LIMIT_PPM))


def _boards(boards: Mapping[str, BoardStatus]) -> Reading:
    """The worst that the boards say of themselves, else the supply."""
    supply_v = boards["taxels"].supply_v if "taxels" in boards else None
    if not boards:
        return Reading("–", Level.OFF)
    if found := sum(len(board.self_test or ()) for board in boards.values()):
        return Reading(f"{found} found", Level.BAD)
    if any(board.unwanted for board in boards.values()):
        return Reading("restarted", Level.BAD)
    low_v, high_v = SUPPLY_LIMITS_V
    if supply_v is not None and not low_v <= supply_v <= high_v:
        return Reading(f"{supply_v:.2f} V", Level.BAD)
    stacks = [b.stack_free_percent for b in boards.values() if b.stack_free_percent is not None]
    if stacks and min(stacks) < STACK_LEAST_PERCENT:
        return Reading(f"stack {min(stacks)} %", Level.WARN)
    return Reading("–", Level.OFF) if supply_v is None else Reading(f"{supply_v:.2f} V", Level.OK)


def _ticks(boards: Mapping[str, BoardStatus]) -> Reading:
    """Late ticks of both boards together, and the longest interrupt of either."""
    late = [board.late_ticks for board in boards.values() if board.late_ticks is not None]
    longest = [board.longest_isr_us for board in boards.values() if board.longest_isr_us]
    if not late:
        return Reading("–", Level.OFF)
    interrupt = f", {max(longest):.0f} µs" if longest else ""
    return Reading(f"{sum(late)} late{interrupt}", Level.WARN if sum(late) else Level.OK)


def board_lines(boards: Mapping[str, BoardStatus]) -> list[str]:
    """All that each board says of itself, and what its self-test found, a line each."""
    lines = []
    for name, board in boards.items():
        supply = "" if board.supply_v is None else f", supply {board.supply_v:.2f} V"
        lines.append(
            f"{name}: firmware {board.firmware}, start {board.boot_count} by {board.reset}{supply}"
        )
        if board.stack_free_percent is not None:
            lines.append(
                f"{name}: {board.free_stack_bytes} bytes of stack never used, "
                f"{board.stack_free_percent} % of its RAM"
            )
        if board.self_test is not None:
            lines += board.self_test or ["self-test: nothing found"]
    return lines


def tick_lines(boards: Mapping[str, BoardStatus]) -> list[str]:
    """How each board keeps time, a line each."""
    return [
        f"{name}: {board.late_ticks} late ticks, longest interrupt {board.longest_isr_us:g} µs, "
        f"idle {board.idle_percent:g} %"
        for name, board in boards.items()
        if board.late_ticks is not None and board.longest_isr_us is not None
    ]


def _trial(seconds: float | None, running: bool) -> Reading:
    if seconds is None:
        return Reading("–", Level.OFF)
    late = seconds > TRIAL_AGE_LIMIT_S
    return Reading(f"{duration(seconds)} ago", _judge(not late) if running else Level.OFF)


class _Cell(QFrame):
    def __init__(self, name: str, hint: str, theme: Theme) -> None:
        super().__init__()
        self.setProperty("role", "card")
        self.setToolTip(hint)
        self.lamp = StatusLamp(theme, 13)
        self.verdict = label("", "muted")
        self.value = elastic(label("–", "value"))
        grid = QGridLayout(self)
        grid.setContentsMargins(6, 3, 5, 3)
        grid.setVerticalSpacing(0)
        grid.setHorizontalSpacing(3)
        grid.addWidget(elastic(label(name, "muted")), 0, 0)
        grid.addWidget(self.verdict, 0, 1)
        grid.addWidget(self.lamp, 0, 2)
        grid.addWidget(self.value, 1, 0, 1, 3)
        grid.setColumnStretch(0, 1)

    def show_hint(self, hint: str) -> None:
        """Say more where the pointer rests."""
        if self.toolTip() != hint:
            self.setToolTip(hint)

    def show_reading(self, reading: Reading) -> None:
        """Show another value and verdict."""
        if self.value.text() != reading.text:
            self.value.setText(reading.text)
        self.lamp.set_level(reading.level)
        verdict = "" if reading.level is Level.OFF else reading.level.value.upper()
        if self.verdict.text() != verdict:
            self.verdict.setText(verdict)
        set_property(self, "level", reading.level.value)
        shouts = reading.level in (Level.WARN, Level.BAD)
        set_property(self.verdict, "role", reading.level.value if shouts else "muted")
        set_property(self.value, "level", reading.level.value)
