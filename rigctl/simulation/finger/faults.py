"""Faults of the finger's cable, of its tracker and of the person."""

from __future__ import annotations

from typing import Annotated, Protocol

from msgspec import Meta

from rigctl.errors import WrongUse
from rigctl.simulation.bench.textures import CATALOGUE
from rigctl.simulation.finger import hand
from rigctl.simulation.finger.tracker import SimulatedTracker
from rigctl.simulation.simulated_rig import Direction, Rate, SimulatedLink

FaultSeconds = Annotated[float, Meta(ge=0, le=60)]
PlateName = Annotated[str, Meta(max_length=16)]


class DisturbedFinger(Protocol):
    """What the faults act on."""

    time_us: int
    finger: SimulatedLink
    tracker: SimulatedTracker

    def change_slide(self, change: hand.Change) -> None:
        """Change the slide from now on, or in the middle of the next one if there is none."""

    def swap_plate(self, texture: str) -> None:
        """Lay this plate out for the next slide, whatever is announced."""

    def reset(self) -> None:
        """Boot the board."""


class FingerFaults:
    """Injects faults. Those of the person act on the slide that is under way, from now on; without
    one, they act in the middle of the next slide.
    """

    def __init__(self, disturbed: DisturbedFinger) -> None:
        self._disturbed = disturbed

    def unplug(self) -> None:
        """Unplug the board's cable, which also powers the board."""
        self._disturbed.finger.unplug()

    def replug(self) -> None:
        """Plug the cable in; the board boots."""
        self._disturbed.finger.replug()
        self._disturbed.reset()

    def reset(self) -> None:
        """Press the board's reset button."""
        self._disturbed.reset()

    def stall(self, on: bool = True) -> None:
        """Silence the cable in both directions without closing the port."""
        self._disturbed.finger.stalled = on

    def drop_bytes(self, direction: Direction, rate: Rate) -> None:
        """Drop this share of bytes; ``direction`` is ``"to_host"`` or ``"to_board"``."""
        self._disturbed.finger.noise[direction].drop_rate = rate

    def corrupt_bytes(self, direction: Direction, rate: Rate) -> None:
        """Flip one bit in this share of bytes."""
        self._disturbed.finger.noise[direction].corrupt_rate = rate

    def unplug_tracker(self) -> None:
        """Switch the tracker off."""
        self._disturbed.tracker.unplug()

    def replug_tracker(self) -> None:
        """Switch the tracker on."""
        self._disturbed.tracker.replug()

    def lose_tracker(self, seconds: FaultSeconds) -> None:
        """Hide the tracker from its base stations: it says that its positions are not valid."""
        self._disturbed.tracker.lose(self._disturbed.time_us, seconds)

    def lift(self, seconds: FaultSeconds) -> None:
        """Lift the finger for a time while the hand moves on."""
        self._disturbed.change_slide(hand.lift_for(seconds))

    def reverse(self) -> None:
        """Run back for about half a second, then go on."""
        self._disturbed.change_slide(hand.reverse)

    def stand_still(self, seconds: FaultSeconds) -> None:
        """Stop for a time with the finger on the plate, then go on."""
        self._disturbed.change_slide(hand.stand_still(seconds))

    def too_fast(self) -> None:
        """Make the rest of the slide at 600 mm/s."""
        self._disturbed.change_slide(hand.too_fast)

    def short_scan(self) -> None:
        """Stop and lift the finger before the end."""
        self._disturbed.change_slide(hand.stop_early)

    def wrong_plate(self, texture: PlateName) -> None:
        """Lay another plate out for the next slide. Raises WrongUse for an unknown one."""
        if texture not in CATALOGUE:
            raise WrongUse(f"no plate {texture!r}: the catalogue has A to P")
        self._disturbed.swap_plate(texture)
