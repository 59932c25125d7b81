"""The clock of a replay."""

from __future__ import annotations

from PySide6.QtCore import QElapsedTimer

from rigctl.values import SAMPLE_RATE_HZ


class Player:
    """``position``: the sample that is shown last, from 0; ``speed``: times real time."""

    def __init__(self) -> None:
        self.length = 0
        self.speed = 1.0
        self.position = 0.0
        self._clock = QElapsedTimer()

    @property
    def is_playing(self) -> bool:
        """Whether time goes on."""
        return self._clock.isValid()

    @property
    def has_ended(self) -> bool:
        """Whether the last sample is shown."""
        return self.position >= self.length - 1

    def play(self) -> None:
        """Go on, from the beginning if the end is reached."""
        if self.has_ended:
            self.position = 0.0
        self._clock.start()

    def stop(self) -> None:
        """Stay where the replay is."""
        self._clock.invalidate()

    def advance(self) -> None:
        """Move on by the time that has passed; stop at the end."""
        if self.is_playing:
            passed_s = self._clock.restart() / 1000
            self.move_to(self.position + passed_s * self.speed * SAMPLE_RATE_HZ)
            if self.has_ended:
                self.stop()

    def move_to(self, position: float) -> None:
        """Show another moment."""
        self.position = min(max(position, 0.0), max(0.0, self.length - 1.0))
