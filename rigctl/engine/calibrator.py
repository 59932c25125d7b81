"""Calibration of load cell, force loop and imbalance, with the drum board alone."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rigctl.boards.drum_codes import Command, Status
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import State
from rigctl.config.rig_config import TaxelArray, parse_config
from rigctl.config.text_file import read_text
from rigctl.config.toml_edit import Value, set_keys
from rigctl.config.toml_reader import MAX_BYTES
from rigctl.engine.calibration_values import ForceLoopGains, LoadCellScale, MassReading, TaxelRange
from rigctl.engine.contact import PRESSING_STATES, has_status
from rigctl.engine.motion import DrumMotion
from rigctl.engine.poller import DrumPoller
from rigctl.engine.rig import Rig
from rigctl.engine.settings import press_settings, trial_settings
from rigctl.errors import CommandRefused, RigFault, WrongUse
from rigctl.values import PlannedTrial

BOARD = "the board's EEPROM"
RANGES_REMOVED = "low and high belong to an unknown order and were removed: calibrate them again"


@dataclass(frozen=True, slots=True)
class CalibratedValues:
    """The result of a calibration: settings of the board, and keys of a table of ``rig.toml``.

    ``remark``: a sentence on what else changes, empty where nothing does.
    """

    settings: Mapping[str, float] = field(default_factory=dict)
    table: str = ""
    keys: Mapping[str, Value] = field(default_factory=dict)
    remark: str = ""

    def edited(self, path: Path) -> str:
        """Return the text of ``rig.toml`` with the keys. Raises ConfigError if it is invalid."""
        return edited_rig_file(path, self.table, self.keys)


def edited_rig_file(path: Path, table: str, keys: Mapping[str, Value]) -> str:
    """Return the text of ``rig.toml`` with keys of a table. Raises ConfigError if it is invalid."""
    source = read_text(path, MAX_BYTES)
    parse_config(source, str(path))
    text = set_keys(source, table, keys)
    parse_config(text, str(path))
    return text


def loadcell_values(scale: LoadCellScale, masses_g: Iterable[float], day: str) -> CalibratedValues:
    """Return the scale that a calibration on ``day`` with these masses has found."""
    masses = ", ".join(f"{mass:g} g" for mass in sorted(masses_g) if mass)
    keys: dict[str, Value] = {
        "scale_ug_per_count": scale.ug_per_count,
        "calibrated": f"{day} with {masses}",
    }
    return CalibratedValues({"scale_ug_per_count": scale.ug_per_count}, "loadcell", keys)


def force_values(gains: ForceLoopGains) -> CalibratedValues:
    """Return the gains of the force loop."""
    gain_p, gain_i = gains.gain_p_per_s, gains.gain_i_per_s
    keys: dict[str, Value] = {"gain_p_per_s": gain_p, "gain_i_per_s": gain_i}
    return CalibratedValues({"gain_p": gain_p, "gain_i": gain_i}, "actuator", keys)


def range_values(found: TaxelRange, force_g: float, day: str) -> CalibratedValues:
    """Return the range of each taxel that a press with ``force_g`` on ``day`` has shown."""
    keys: dict[str, Value] = {
        "low": list(found.low),
        "high": list(found.high),
        "range_from": f"{day}, a press with {force_g:g} g over the plate",
    }
    return CalibratedValues(table="taxels", keys=keys)


def wiring_values(before: TaxelArray, wiring: tuple[int, ...]) -> CalibratedValues:
    """Return the order of the taxels; the ranges of a known order move with their readings."""
    keys: dict[str, Value] = {"wiring": list(wiring)}
    if not before.low:
        return CalibratedValues(table="taxels", keys=keys)
    if not before.wiring:
        keys |= {"low": [], "high": []}
        keys["range_from"] = ""
        return CalibratedValues(table="taxels", keys=keys, remark=RANGES_REMOVED)
    places = [before.wiring.index(reading) for reading in wiring]
    keys["low"] = [before.low[place] for place in places]
    keys["high"] = [before.high[place] for place in places]
    return CalibratedValues(table="taxels", keys=keys)


READINGS = 80
"""A second of the load cell, after a second in which it comes to rest."""
REST_S = 1.0
TUNE_TIMEOUT_S, TURN_TIMEOUT_S, NUDGE_TIMEOUT_S = 10.0, 120.0, 5.0
RANGE_MM_S, RANGE_SHARE = 60.0, 0.8
"""Speed over the plate, and the share of its length; the rest is for run-in and ramp."""
PRESS = 1
"""Direction of a nudge: the way in which the dead band matters, with the drum lifted."""
SETTLE_S, WATCH_S = 1.0, 3.0
GAINS = "proposed_gain_p", "proposed_gain_i", "tuned_stiffness_g_per_mm", "tuned_delay"
ACTUATOR = "tuned_dead_band", "tuned_stiction", "tuned_rate"
SCALE = "scale_ug_per_count"
NEAR_SHARE = 0.1
"""Cell, amplifier and mounting move a scale by some percent; a mistaken mass moves it by more."""
FAR_SCALE = (
    "this scale is {ratio:.2f} times the one before, so the board is not commissioned for it: "
    "check the masses and calibrate again, or go on with rigctl setup, which weighs once more and "
    "compares with the cell's label"
)


class Calibrator:
    """Measures with one drum board that is connected and polled."""

    def __init__(self, rig: Rig, motion: DrumMotion) -> None:
        self._rig = rig
        self._poller = motion.poller
        self.motion = motion

    async def switch_off(self) -> None:
        """Leave the drum lifted and switched off, unless it is lost or has lifted at a fault."""
        for _ in range(2):  # a poll that is under way may be older than a STOP
            await self._poller.wait_cycle()
        if self._poller.connected and not self._poller.fault_latched:
            await self.motion.disarm()

    async def read_mass(self, mass_g: float) -> MassReading:
        """Return a reading at rest. Raises RigFault while the drum is not switched off."""
        self.require_off("calibrate the load cell")
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

    def require_off(self, action: str) -> None:
        """Raise RigFault unless the drum is switched off; ``action`` begins its sentence."""
        if self._poller.healthy_state().state != State.IDLE:
            raise RigFault(f"{action} with the drum lifted and switched off")

    def require_no_contact(self) -> None:
        """Raise CommandRefused while the drum presses: no measurement ends a held force."""
        if self._poller.healthy_state().state in (*PRESSING_STATES, State.RETRACT):
            raise CommandRefused("the drum presses on the sensor: retract it, then calibrate")

    def require_force(self, force_g: float) -> None:
        """Raise WrongUse for a force outside the rig's limits."""
        limits = self._rig.config.limits
        if not limits.force_min_g <= force_g <= limits.force_max_g:
            raise WrongUse(
                f"{force_g:g} g: this rig presses with {limits.force_min_g:g} to "
                f"{limits.force_max_g:g} g"
            )

    async def press_and_turn(self, force_g: float) -> None:
        """Tare, home, press at the plate's beginning, turn over the plate once, and lift."""
        drum = self._rig.config.drum
        trial = PlannedTrial(0, "", RANGE_MM_S, force_g, 1, drum.plate_length_mm * RANGE_SHARE)
        await self.motion.arm()
        await self.motion.tare()
        await self.motion.home()
        await self.motion.write_settings(**trial_settings(trial, drum))
        await self.motion.move_to_start(trial)
        await self.motion.approach()
        await self.motion.run()
        await self.motion.lift()

    async def lift(self) -> None:
        """Lift off and switch off, unless that is so, so that only a mass loads the load cell."""
        state = self._poller.healthy_state()
        if state.state != State.IDLE or has_status(state, Status.CONTACT_MAY_STAND):
            await self.motion.arm()
            await self.motion.disarm()

    async def tune_gains(self, force_g: float) -> ForceLoopGains:
        """Nudge, press, hold, step and hold again; return the gains and what the actuator can hold.

        Raises WrongUse for a force outside the rig's limits, RigFault for a bad response.
        """
        self.require_force(force_g)
        await self.lift()
        await self.motion.write_settings(nudge_direction=PRESS)
        await self.motion.execute(Command.NUDGE, NUDGE_TIMEOUT_S, "moving the actuator a little")
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
        await asyncio.sleep(SETTLE_S)
        held_within_g = await self._watch_held_force()
        found = await self._poller.drum.get(*GAINS, *ACTUATOR)
        values = [found[name] for name in GAINS]
        values += [found[name] / 10 for name in ACTUATOR[:2]]
        values += [found[ACTUATOR[2]], held_within_g]
        return ForceLoopGains(*(round(value, 2) for value in values))

    async def _watch_held_force(self) -> float:
        """Return half of what the held force moves by in some seconds, g."""
        forces_g: list[float] = []
        unsubscribe = self._poller.subscribe(
            lambda state: forces_g.extend(sample.force_g for sample in state.loadcell)
        )
        try:
            end_s = self._poller.loop.time() + WATCH_S
            while self._poller.loop.time() < end_s:
                await self._poller.wait_cycle()
                self._poller.healthy_state()
                self.motion.check()
        finally:
            unsubscribe()
        return (max(forces_g) - min(forces_g)) / 2

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
        counts = await self.tare_places()
        scale = self._rig.config.loadcell.scale_ug_per_count
        return [value * scale * 1e-6 for value in counts.values()]

    async def tare_places(self) -> dict[str, float]:
        """Return the board's tare of each sixteenth of a turn, counts by the setting's name."""
        names = [name for name in BY_NAME if name.startswith("tare_place_")]
        return await self._poller.drum.get(*names)

    async def write_lifted(self, **settings: float) -> None:
        """Lift, switch off and write settings; the board has them until it is switched off."""
        await self.motion.disarm()
        await self.motion.write_settings(**settings)

    async def save_settings(self, **settings: float) -> str:
        """Write settings to the board and store them in its EEPROM; return a remark.

        A board that was commissioned is commissioned again for a scale near the one before, since
        nothing else of what it is bound to changes here. The remark is empty, or says that the
        board has to be commissioned.
        """
        before_ug = (await self._poller.drum.get(SCALE))[SCALE]
        ratio = settings.get(SCALE, before_ug) / before_ug
        was_commissioned = await self.motion.is_commissioned()
        await self.write_lifted(**settings)
        if not await self.motion.execute(Command.SAVE, TUNE_TIMEOUT_S, "saving"):
            raise RigFault("the board did not save its settings: try again")
        if was_commissioned and (self.motion.commissions or abs(ratio - 1) <= NEAR_SHARE):
            await self.motion.commission()
        elif was_commissioned:
            return FAR_SCALE.format(ratio=ratio)
        return ""


async def calibrate_alone(rig: Rig, work: Callable[[Calibrator], Awaitable[object]]) -> None:
    """Connect the drum board alone, do the work, and always leave the drum lifted and off."""
    poller = DrumPoller(rig.drum, rig.loop)
    calibrator = Calibrator(rig, DrumMotion(poller, rig.config, rig.commissions))
    await poller.connect()
    polling = asyncio.ensure_future(poller.run())
    try:
        await poller.wait_cycle()
        await calibrator.motion.configure()
        await work(calibrator)
    finally:
        try:
            await calibrator.switch_off()
        finally:
            polling.cancel()
            await asyncio.gather(polling, return_exceptions=True)
