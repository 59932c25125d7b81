"""The interface of a tracker: positions as they come, and a report when it is lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from rigctl.values import Position

OnPosition = Callable[[Position], None]
"""Called in the loop's thread with each position."""
OnTrackerLost = Callable[[str], None]
"""Called in the loop's thread, once, with a sentence: the tracker is gone and closed."""


class Tracker(Protocol):
    """A source of positions. All calls come from the loop's thread."""

    name: str

    def open(self, on_position: OnPosition, on_lost: OnTrackerLost) -> None:
        """Start to deliver positions. Raises LinkLost or RigFault with one sentence."""
        ...

    def close(self) -> None:
        """Stop; closing twice is harmless."""
        ...


@dataclass(slots=True)
class TrackerCounters:
    """Messages of a tracker since construction.

    ``positions`` were delivered, ``invalid`` of them flagged by the tracker. Not delivered are
    ``malformed`` messages, ``foreign`` ones from another sender, and those ``out_of_order``,
    whose number or time ran back. ``lost`` messages are missing in the numbering.
    ``clock_restarts`` counts how often the tracker's own clock began again.
    """

    positions: int = 0
    invalid: int = 0
    malformed: int = 0
    foreign: int = 0
    out_of_order: int = 0
    lost: int = 0
    clock_restarts: int = 0
