"""What the virtual drum's controller waits for, and which of it comes first."""

from __future__ import annotations

import math

from rigctl.world.drum_tables import Timer


class Waits:
    """World times at which waits are over. Looked at at every event: the first is remembered."""

    def __init__(self) -> None:
        self._until_us: dict[Timer, int] = {}
        self._first_loud_us = math.inf

    def __contains__(self, timer: Timer) -> bool:
        return timer in self._until_us

    @property
    def next_us(self) -> float:
        """When the first is over."""
        return min(self._first_loud_us, self._until_us.get(Timer.SILENCE, math.inf))

    @property
    def next_but_silence_us(self) -> float:
        """When the first is over while the load cell speaks in time."""
        return self._first_loud_us

    def next_us_without(self, tended: frozenset[Timer]) -> float:
        """When the first is over but those that others wind up in time."""
        waits = (at_us for timer, at_us in self._until_us.items() if timer not in tended)
        return min(waits, default=math.inf)

    def start(self, timer: Timer, at_us: int) -> None:
        """Wait until then, and no more until another time."""
        self._until_us[timer] = at_us
        if timer is not Timer.SILENCE:
            self._look()

    def stop(self, timer: Timer) -> None:
        """Wait no more; harmless where it was not waited for."""
        self._until_us.pop(timer, None)
        self._look()

    def over(self, now_us: int) -> list[Timer]:
        """Waits that are over by now, in the order in which they were begun."""
        if self.next_us > now_us:
            return []
        return [timer for timer, at_us in self._until_us.items() if at_us <= now_us]

    def is_over(self, timer: Timer, now_us: int) -> bool:
        """Whether this one is waited for and over by now."""
        return self._until_us.get(timer, math.inf) <= now_us

    def _look(self) -> None:
        self._first_loud_us = self.next_us_without(_SILENCE)


_SILENCE = frozenset({Timer.SILENCE})
