"""A further vertical axis that a driver from outside moves, while the drum is off and lifted.

It is a positioner, and nothing of the drum's safety is in it: it never presses for a trial, and the
firmware's force limits hold whatever it does (decision 56).
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Protocol

from rigctl.boards.drum_states import STATE_TEXT, State
from rigctl.config.rig_config import AxisConfig
from rigctl.engine.contact import contact_words
from rigctl.engine.poller import DrumPoller
from rigctl.errors import CommandRefused, RigFault, WrongUse
from rigctl.plugins import Lookup, Plugin
from rigctl.values import DrumState, PluginUse

SIMULATED_PORT = "simulated"
"""The port of a board in memory, which is all that a simulated rig gives a driver."""
TOUCH_G = 20.0
"""The load cell's change at which the axis stops: nothing touches anything during its moves."""
MOVE_TIMEOUT_S = 300.0
ARRIVED_MM = 0.05


class Actuator(Protocol):
    """A vertical axis on a board of its own. All calls come from the loop's thread.

    A move goes to a height and ends there by itself, so that no lost program lets it run on; its
    board has end switches. ``height_mm``: where it is now, upwards positive, None before it is
    known. Failures are a RigFault with one sentence.
    """

    height_mm: float | None = None
    is_moving: bool = False

    def __init__(self, port: str, loop: asyncio.AbstractEventLoop) -> None:
        """Take the port, which is not opened yet; ``simulated`` is a board in memory."""

    async def connect(self) -> None:
        """Open the port and learn the height; nothing moves."""

    def move_to(self, height_mm: float) -> None:
        """Begin to move; return at once."""

    def stop(self) -> None:
        """Stop at once, without waiting for anything; a second stop is harmless."""

    def close(self) -> None:
        """Stop and free the port; closing twice is harmless."""


ACTUATORS: Lookup[type[Actuator]] = Lookup("actuator", {}, Actuator)
"""What ``[axis] driver`` names. The actuator that presses is the firmware's, and not among them."""


class Axis:
    """The axis of a rig. Every move is within ``[axis]``, with the drum off and lifted."""

    def __init__(self, plugin: Plugin, actuator: Actuator, limits: AxisConfig) -> None:
        self.plugin = plugin
        self._actuator = actuator
        self._limits = limits

    @property
    def height_mm(self) -> float | None:
        """Where it is, None where that is not known or its driver fails to say it."""
        height_mm = None
        with suppress(RigFault), self.plugin.blamed(RigFault):
            height_mm = self._actuator.height_mm
        return height_mm if isinstance(height_mm, float) else None

    @property
    def is_moving(self) -> bool:
        """Whether it moves now."""
        with self.plugin.blamed(RigFault):
            return self._actuator.is_moving

    def used(self) -> PluginUse:
        """Return what a session keeps of it."""
        return self.plugin.used(self.height_mm)

    async def connect(self) -> None:
        """Connect the axis. Raises RigFault."""
        with self.plugin.blamed(RigFault):
            await self._actuator.connect()

    async def move_to(self, height_mm: float, poller: DrumPoller) -> float:
        """Move, watch the drum meanwhile, and return the height.

        Raises WrongUse for a height out of range or a drum that is not off and lifted,
        CommandRefused where it was stopped, and RigFault where something touches, the drum changes
        or is lost, or the move does not end. It stands still then.
        """
        low, high = self._limits.low_mm, self._limits.high_mm
        if not low <= height_mm <= high:
            raise WrongUse(
                f"{height_mm:g} mm is outside [axis] of rig.toml, {low:g} to {high:g} mm: choose a "
                "height within"
            )
        before = poller.healthy_state()
        if reason := _reason_to_stand(before):
            raise WrongUse(f"{reason}: arm the drum, switch it off, then move the axis")
        end_s = poller.loop.time() + MOVE_TIMEOUT_S
        try:
            with self.plugin.blamed(RigFault):
                self._actuator.move_to(height_mm)
            while self.is_moving:
                await poller.wait_cycle()
                self._watch(poller, before.force_g, end_s)
        finally:
            self.stop()
        reached = self.height_mm
        if reached is None or abs(reached - height_mm) > ARRIVED_MM:
            raise CommandRefused(f"the axis was stopped at {reached} mm: move it again")
        return reached

    def _watch(self, poller: DrumPoller, before_g: float, end_s: float) -> None:
        """Raise RigFault for a reason to stop."""
        state = poller.healthy_state()
        touched_g = state.force_g - before_g
        if abs(touched_g) > TOUCH_G:
            raise RigFault(
                f"the load cell changed by {touched_g:.0f} g while the axis moved, and it was "
                "stopped: something touches, look before you move it again"
            )
        if reason := _reason_to_stand(state):
            raise RigFault(f"{reason}, and the axis was stopped")
        if poller.loop.time() > end_s:
            raise RigFault(f"the axis was stopped, its move took {MOVE_TIMEOUT_S:g} s: check it")

    def stop(self) -> None:
        """Stop it at once. Raises RigFault where its driver fails to."""
        with self.plugin.blamed(RigFault):
            self._actuator.stop()

    def close(self) -> None:
        """Stop it and free its port; a driver that fails to keeps nothing else from its end."""
        with suppress(RigFault), self.plugin.blamed(RigFault):
            self._actuator.close()


def open_axis(
    config: AxisConfig, loop: asyncio.AbstractEventLoop, *, simulated: bool
) -> Axis | None:
    """Return the axis that ``[axis]`` describes, not connected; None without one.

    Raises WrongUse for a plug-in that cannot be used.
    """
    if not config.driver:
        return None
    plugin, create = ACTUATORS.plugin(config.driver), ACTUATORS.load(config.driver)
    assert plugin is not None  # we have none of our own
    with plugin.blamed():
        actuator = create(SIMULATED_PORT if simulated else config.port, loop)
    return Axis(plugin, actuator, config)


def _reason_to_stand(drum: DrumState) -> str:
    """Return why the axis may not move, empty where it may."""
    if drum.state != State.IDLE:
        return f"the drum is not off ({STATE_TEXT[State(drum.state)]})"
    contact = contact_words(drum)
    return f"the drum is off, but {contact}" if contact else ""
