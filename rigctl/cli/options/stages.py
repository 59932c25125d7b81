"""One line for work in stages: what is being done, how far it is, how long that still takes."""

from __future__ import annotations

import time
from typing import TextIO

from rigctl.cli.options.progress import clock

EVERY_S = 5.0
REDRAW_EVERY_S = 0.2


class StageLine:
    """A line that says what is being done, how far it is and how long the stage still takes."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._redraws = out.isatty()
        self._stage = ""
        self._began_s = self._shown_s = 0.0
        self._width = 0

    def show(self, stage: str, done: int, all_: int) -> None:
        """One step of a stage; drawn when the stage is new or some time has passed."""
        now_s = time.monotonic()
        if stage != self._stage:
            self.end()
            self._stage, self._began_s, self._shown_s = stage, now_s, float("-inf")
        period_s = REDRAW_EVERY_S if self._redraws else EVERY_S
        if now_s - self._shown_s < period_s and (done < all_ or not self._redraws):
            return
        self._shown_s = now_s
        left = ""
        if 0 < done < all_:
            left = f", {clock((now_s - self._began_s) * (all_ - done) / done)} left"
        self._write(f"{stage}: {done} of {all_}{left}")

    def end(self) -> None:
        """Leave the line."""
        if self._redraws and self._width:
            self._out.write("\n")
            self._width = 0

    def _write(self, text: str) -> None:
        if self._redraws:
            self._out.write(f"\r{text}{' ' * (self._width - len(text))}")
            self._width = len(text)
        else:
            self._out.write(text + "\n")
        self._out.flush()
