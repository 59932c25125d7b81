"""Load cell, force loop and imbalance of a rig, calibrated with the drum board alone.

The load cell is read lifted and switched off, with nothing on it and with known masses. The
force loop is asked for gains at a force that it holds, the imbalance over a turn.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.acquisition.drum.motion import DrumMotion
from rigctl.acquisition.drum.poller import DrumPoller
from rigctl.acquisition.rig_interface import RigInterface
from rigctl.errors import RigFault, WrongUse
from rigctl.values import SCALE_BAND_UG_PER_COUNT, DrumState
from rigctl.wire.drum.codes import Command
from rigctl.wire.drum.register_table import BY_NAME
from rigctl.wire.drum.states import State

READINGS = 80
"""A second of the load cell, after a second in which it comes to rest."""
REST_S = 1.0
POLL_S = 0.04
LEAST_COUNTS = 500
MOST_SPREAD_SHARE = 0.01
MOST_CURVE_SHARE = 0.02
FULL_SCALE = 8_388_607
TUNE_LIMIT_S, TURN_LIMIT_S = 10.0, 120.0


@dataclass(frozen=True, slots=True)
class Point:
    """A known mass and what the load cell said: mean and standard deviation of raw counts."""

    mass_g: float
    mean_counts: float
    sd_counts: float


@dataclass(frozen=True, slots=True)
class Scale:
    """``ug_per_count`` with its sign; ``curve_share``: how far off a straight line, of the most."""

    ug_per_count: int
    curve_share: float


@dataclass(frozen=True, slots=True)
class Gains:
    """What a step test proposes, and what it found."""

    gain_p_per_s: float
    gain_i_per_s: float
    stiffness_g_per_mm: float
    delay_ms: float


def scale_of(points: Sequence[Point]) -> Scale:
    """The straight line through an empty reading and one of each mass.

    Raises WrongUse in a sentence for readings that cannot be right.
    """
    masses = np.array([p.mass_g for p in points])
    counts = np.array([p.mean_counts for p in points])
    span = abs(float(counts[masses.argmax()] - counts[masses.argmin()]))
    if np.abs(counts).max() >= FULL_SCALE - 1:
        raise WrongUse("the load cell is at the end of its range: take a smaller mass")
    if span < LEAST_COUNTS:
        raise WrongUse(
            f"the reading changed by {span:.0f} counts only: is the mass on the drum, and the "
            "load cell wired?"
        )
    restless = max(points, key=lambda p: p.sd_counts)
    if restless.sd_counts > MOST_SPREAD_SHARE * span:
        raise WrongUse(
            f"the reading at {restless.mass_g:g} g is restless (± {restless.sd_counts:.0f} of "
            f"{span:.0f} counts): let the drum come to rest, then calibrate again"
        )
    g_per_count, offset = np.polyfit(counts, masses, 1)
    curve = float(np.abs(masses - (g_per_count * counts + offset)).max() / masses.max())
    if curve > MOST_CURVE_SHARE:
        raise WrongUse(
            f"the masses do not lie on a line ({100 * curve:.1f} % off): check them, and that "
            "nothing touches the drum"
        )
    ug_per_count = round(float(g_per_count) * 1e6)
    low, high = SCALE_BAND_UG_PER_COUNT
    if not low <= abs(ug_per_count) <= high:
        raise WrongUse(
            f"a scale of {ug_per_count} µg a count cannot be, {low} to {high} can: check the "
            "masses and the wiring"
        )
    return Scale(ug_per_count, curve)


def check_masses(masses_g: Sequence[float]) -> None:
    """Raises WrongUse for masses that no calibration can be made with."""
    if not masses_g or min(masses_g) <= 0 or len(set(masses_g)) < len(masses_g):
        raise WrongUse("give each known mass once, in grams above 0: --mass 500")


class Calibrator:
    """One drum board, connected and watched, while something is calibrated."""

    def __init__(self, bench: RigInterface) -> None:
        self._bench = bench
        self._watch = DrumPoller(
            bench.drum, bench.loop, lambda: True, lambda reason: None, lambda who, anew: None
        )
        self.motion = DrumMotion(self._watch, bench.config)

    async def during(self, work: Callable[[], Awaitable[object]]) -> None:
        """Connect, do the work, and leave the drum lifted and off whatever happens."""
        await self._watch.connect()
        polling = asyncio.ensure_future(self._watch.run())
        try:
            await self._watch.turn()
            await self.motion.configure()
            await work()
        finally:
            try:
                if self._watch.connected and not self._watch.fault_latched:
                    await self.motion.disarm()
            finally:
                polling.cancel()
                await asyncio.gather(polling, return_exceptions=True)

    async def point(self, mass_g: float) -> Point:
        """Read the load cell at rest. Raises RigFault while the drum is not switched off."""
        if self._watch.healthy().state != State.IDLE:
            raise RigFault("the load cell is calibrated with the drum lifted and switched off")
        await self._pass(REST_S)
        counts: list[int] = []
        unwatch = self._watch.watch(lambda state: counts.extend(_raw(state)))
        try:
            while len(counts) < READINGS:
                await self._watch.turn()
                self._watch.healthy()
        finally:
            unwatch()
        return Point(mass_g, float(np.mean(counts)), float(np.std(counts)))

    async def lift(self) -> None:
        """Lift off, so that nothing but a mass is on the load cell."""
        await self.motion.arm()
        await self.motion.disarm()

    async def gains(self, force_g: float) -> Gains:
        """Press, hold, step, lift. Raises RigFault where the answer makes no sense."""
        await self.motion.arm()
        await self.motion.tare()
        await self.motion.home()
        await self.motion.set_press(force_g)
        await self.motion.approach()
        if not await self._ended(Command.TUNE, TUNE_LIMIT_S, "the step test"):
            raise RigFault(
                "the force did not answer the step as an actuator's should: check the plate, "
                "the mechanics and the load cell's scale"
            )
        found = await self._watch.drum.get(
            "proposed_gain_p", "proposed_gain_i", "tuned_stiffness_g_per_mm", "tuned_delay"
        )
        return Gains(*(round(value, 2) for value in found.values()))

    async def tare(self, anyway: bool) -> int:
        """Tare the lifted drum; counts. ``anyway`` takes a reading far from the zero before."""
        await self.motion.arm()
        await self.motion.tare(anyway)
        return round((await self._watch.drum.get("tare_counts"))["tare_counts"])

    async def imbalance(self) -> list[float]:
        """Tare over a turn; the table in grams. Raises RigFault where it failed."""
        await self.motion.arm()
        await self.motion.home()
        if not await self._ended(Command.TARE_TURN, TURN_LIMIT_S, "the turn"):
            raise RigFault("the tare over a turn failed: is the drum free to turn?")
        names = [name for name in BY_NAME if name.startswith("tare_place_")]
        counts = await self._watch.drum.get(*names)
        scale = self._bench.config.loadcell.scale_ug_per_count
        return [counts[name] * scale * 1e-6 for name in names]

    async def save(self, **settings: float) -> None:
        """Write settings to the board and keep them in its EEPROM."""
        await self.motion.disarm()
        await self.motion.apply(**settings)
        if not await self._ended(Command.SAVE, TUNE_LIMIT_S, "saving"):
            raise RigFault("the board did not save its settings: try again")

    async def _ended(self, command: Command, limit_s: float, what: str) -> bool:
        """Give a command and wait for its work; False where it failed."""
        await self.motion.command(command)
        state = await self._watch.until(self.motion.ended, limit_s, what)
        return bool(state.values["command_result"] == 1)

    async def _pass(self, seconds: float) -> None:
        end_s = self._bench.loop.time() + seconds
        while self._bench.loop.time() < end_s:
            await self._watch.turn()


def _raw(state: DrumState) -> list[int]:
    return [sample.raw_counts for sample in state.loadcell]
