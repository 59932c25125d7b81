"""Calibration of load cell, force loop and imbalance, with the drum board alone."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from typing import NamedTuple

import numpy as np

from rigctl.acquisition.drum.motion import DrumMotion
from rigctl.acquisition.drum.poller import DrumPoller
from rigctl.acquisition.drum.settings import press_settings
from rigctl.acquisition.rig import Rig
from rigctl.errors import RigFault, WrongUse
from rigctl.values import SCALE_BAND_UG_PER_COUNT
from rigctl.wire.drum.codes import Command
from rigctl.wire.drum.register_table import BY_NAME
from rigctl.wire.drum.states import State

READINGS = 80
"""A second of the load cell, after a second in which it comes to rest."""
REST_S = 1.0
MIN_SPAN_COUNTS = 500
MAX_SPREAD_SHARE = 0.01
MAX_NONLINEARITY_SHARE = 0.02
FULL_SCALE_COUNTS = 8_388_607
TUNE_TIMEOUT_S, TURN_TIMEOUT_S = 10.0, 120.0


class MassReading(NamedTuple):
    """A known mass with the mean and standard deviation of the load cell's raw counts."""

    mass_g: float
    mean_counts: float
    sd_counts: float


class LoadCellScale(NamedTuple):
    """Slope with its sign; ``nonlinearity_share``: largest deviation over the largest mass."""

    ug_per_count: int
    nonlinearity_share: float


class ForceLoopGains(NamedTuple):
    """Gains that a step test proposes, with the measured stiffness and delay."""

    gain_p_per_s: float
    gain_i_per_s: float
    stiffness_g_per_mm: float
    delay_ms: float


def fit_scale(readings: Sequence[MassReading]) -> LoadCellScale:
    """Return the scale that fits an empty reading and one of each mass.

    Raises WrongUse for implausible readings.
    """
    masses = np.array([reading.mass_g for reading in readings])
    counts = np.array([reading.mean_counts for reading in readings])
    _validate_readings(readings, abs(float(counts[masses.argmax()] - counts[masses.argmin()])))
    g_per_count, offset = np.polyfit(counts, masses, 1)
    residual = np.abs(masses - (g_per_count * counts + offset))
    nonlinearity = float(residual.max() / masses.max())
    if nonlinearity > MAX_NONLINEARITY_SHARE:
        raise WrongUse(
            f"the readings are not proportional to the masses ({100 * nonlinearity:.1f} % off): "
            "check the masses, and that nothing touches the drum"
        )
    ug_per_count = round(float(g_per_count) * 1e6)
    low, high = SCALE_BAND_UG_PER_COUNT
    if not low <= abs(ug_per_count) <= high:
        raise WrongUse(
            f"a scale of {ug_per_count} µg per count is impossible ({low} to {high} are possible): "
            "check the masses and the wiring"
        )
    return LoadCellScale(ug_per_count, nonlinearity)


def _validate_readings(readings: Sequence[MassReading], span_counts: float) -> None:
    if max(abs(reading.mean_counts) for reading in readings) >= FULL_SCALE_COUNTS - 1:
        raise WrongUse("the load cell is at the end of its range: take a smaller mass")
    if span_counts < MIN_SPAN_COUNTS:
        raise WrongUse(
            f"the reading changed by only {span_counts:.0f} counts: check that the mass is on the "
            "drum and that the load cell is wired"
        )
    noisiest = max(readings, key=lambda reading: reading.sd_counts)
    if noisiest.sd_counts > MAX_SPREAD_SHARE * span_counts:
        raise WrongUse(
            f"the reading at {noisiest.mass_g:g} g is unstable (± {noisiest.sd_counts:.0f} of "
            f"{span_counts:.0f} counts): let the drum come to rest, then calibrate again"
        )


def validate_masses(masses_g: Sequence[float]) -> None:
    """Raise WrongUse for masses that cannot calibrate the load cell."""
    if not masses_g or min(masses_g) <= 0 or len(set(masses_g)) < len(masses_g):
        raise WrongUse("give each known mass once, in grams above 0: --mass 500")


class Calibrator:
    """One drum board, connected and polled during a calibration."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._poller = DrumPoller(rig.drum, rig.loop)
        self.motion = DrumMotion(self._poller, rig.config)

    async def run(self, work: Callable[[], Awaitable[object]]) -> None:
        """Connect, do the work, and always leave the drum lifted and switched off."""
        await self._poller.connect()
        polling = asyncio.ensure_future(self._poller.run())
        try:
            await self._poller.wait_cycle()
            await self.motion.configure()
            await work()
        finally:
            try:
                if self._poller.connected and not self._poller.fault_latched:
                    await self.motion.disarm()
            finally:
                polling.cancel()
                await asyncio.gather(polling, return_exceptions=True)

    async def read_mass(self, mass_g: float) -> MassReading:
        """Return a reading at rest. Raises RigFault while the drum is not switched off."""
        if self._poller.healthy_state().state != State.IDLE:
            raise RigFault("calibrate the load cell with the drum lifted and switched off")
        await asyncio.sleep(REST_S)
        counts: list[int] = []
        unsubscribe = self._poller.subscribe(
            lambda state: counts.extend(sample.raw_counts for sample in state.loadcell)
        )
        try:
            while len(counts) < READINGS:
                await self._poller.wait_cycle()
                self._poller.healthy_state()
        finally:
            unsubscribe()
        return MassReading(mass_g, float(np.mean(counts)), float(np.std(counts)))

    async def lift(self) -> None:
        """Lift off, so that only a mass loads the load cell."""
        await self.motion.arm()
        await self.motion.disarm()

    async def tune_gains(self, force_g: float) -> ForceLoopGains:
        """Press, hold, step and lift; return the gains. Raises RigFault for a bad response."""
        await self.motion.arm()
        await self.motion.tare()
        await self.motion.home()
        await self.motion.write_settings(**press_settings(force_g))
        await self.motion.approach()
        if not await self.motion.execute(Command.TUNE, TUNE_TIMEOUT_S, "the step test"):
            raise RigFault(
                "the force did not respond to the step as expected: check the plate, "
                "the mechanics and the load cell's scale"
            )
        found = await self._poller.drum.get(
            "proposed_gain_p", "proposed_gain_i", "tuned_stiffness_g_per_mm", "tuned_delay"
        )
        return ForceLoopGains(*(round(value, 2) for value in found.values()))

    async def tare(self, anyway: bool) -> int:
        """Tare the lifted drum and return the counts; ``anyway`` allows any zero."""
        await self.motion.arm()
        await self.motion.tare(anyway)
        return round((await self._poller.drum.get("tare_counts"))["tare_counts"])

    async def measure_imbalance(self) -> list[float]:
        """Tare over a turn and return the table in grams. Raises RigFault where it failed."""
        await self.motion.arm()
        await self.motion.home()
        if not await self.motion.execute(Command.TARE_TURN, TURN_TIMEOUT_S, "the turn"):
            raise RigFault("the tare over a turn failed: check that the drum turns freely")
        names = [name for name in BY_NAME if name.startswith("tare_place_")]
        counts = await self._poller.drum.get(*names)
        scale = self._rig.config.loadcell.scale_ug_per_count
        return [counts[name] * scale * 1e-6 for name in names]

    async def save_settings(self, **settings: float) -> None:
        """Write settings to the board and store them in its EEPROM."""
        await self.motion.disarm()
        await self.motion.write_settings(**settings)
        if not await self.motion.execute(Command.SAVE, TUNE_TIMEOUT_S, "saving"):
            raise RigFault("the board did not save its settings: try again")
