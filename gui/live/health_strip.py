"""The health strip: the figures that show whether a recording is good, each with a verdict."""

from __future__ import annotations

from collections.abc import Mapping

from gui.live.health_cell import (
    RECENT_LOSS_S,
    CellSpec,
    HealthRow,
    Reading,
    age_reading,
    disk_reading,
    judge,
    loss_line,
    loss_reading,
)
from gui.widgets.data_ages import DataAges, stale_words
from gui.widgets.formatting import ago
from gui.widgets.status_lamp import Level
from rigctl.acquisition.rpc.messages import BoardStatus, EngineStatus
from rigctl.values import SAMPLE_RATE_HZ
from rigctl.wire.drum_registers import SHOWN, Register

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
            self.cells[key].setToolTip("\n".join([CELLS[key].tooltip, *lines]))

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
