"""One line that says how far a run is, how long the rest takes, and that it is being recorded."""

from __future__ import annotations

from typing import TextIO

from rigctl.acquisition.rpc.messages import EngineStatus

LINE_EVERY_S = 5.0
REDRAW_EVERY_S = 0.1


class ProgressLine:
    """Redraws its line on a terminal; elsewhere writes one every few seconds. Times: wall, s."""

    def __init__(self, out: TextIO, quiet: bool = False) -> None:
        self._out = out
        self._quiet = quiet
        self._redraws = out.isatty()
        self._started_s: float | None = None
        self._shown_s = float("-inf")
        self._width = 0

    def show(self, status: EngineStatus, now_s: float) -> None:
        """Show an engine's status, if it is time to."""
        self._started_s = now_s if self._started_s is None else self._started_s
        period_s = REDRAW_EVERY_S if self._redraws else LINE_EVERY_S
        if self._quiet or now_s - self._shown_s < period_s:
            return
        self._shown_s = now_s
        line = progress_line(status, now_s - self._started_s)
        self._write(line, "" if self._redraws else "\n")

    def say(self, sentence: str) -> None:
        """Say something that stays."""
        if not self._quiet:
            self._write(sentence, "\n")

    def end(self) -> None:
        """Leave the line."""
        if self._redraws and self._width:
            self._write("", "")

    def _write(self, text: str, end: str) -> None:
        back = "\r" if self._redraws else ""
        self._out.write(
            f"{back}{text}{' ' * (self._width - len(text))}{back if not end else ''}{end}"
        )
        self._out.flush()
        self._width = len(text) if self._redraws and not end else 0


def progress_line(status: EngineStatus, elapsed_wall_s: float) -> str:
    """The line for one status; loop time is turned into wall time by the pace so far."""
    run = status.run
    parts = [f"{run.trials_committed}/{run.trials_planned} trials", run.state]
    if now := run.current:
        parts.append(f"{now.texture} {now.speed_mm_s:g} mm/s {now.force_g:g} g")
    if run.trials_rejected:
        parts.append(f"{run.trials_rejected} rejected")
    if run.eta_s is not None and run.elapsed_s > 0:
        parts.append(f"{clock(run.eta_s * elapsed_wall_s / run.elapsed_s)} left")
    parts.append(f"{status.recording.samples_on_disk} samples on disk")
    return " · ".join(parts)


def clock(seconds: float) -> str:
    """Hours, minutes and seconds: 1:02:03."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02}:{whole % 60:02}"
