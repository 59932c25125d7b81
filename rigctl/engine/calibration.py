"""The calibrations of an engine: what was measured of each part, until it is saved or discarded."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rigctl.config.rig_config import DrumGeometry
from rigctl.config.toml_edit import replace_file
from rigctl.encoder.reading import Reading
from rigctl.engine.calibration_values import (
    FORCE,
    IMBALANCE,
    LOADCELL,
    RANGE,
    WIRING,
    CalibrationStatus,
    ForceLoopGains,
    MassReading,
    TaxelRange,
)
from rigctl.engine.calibrator import (
    BOARD,
    RANGE_MM_S,
    CalibratedValues,
    Calibrator,
    force_values,
    loadcell_values,
    range_values,
    wiring_values,
)
from rigctl.engine.load_cell_scale import MassReadings
from rigctl.engine.rig import Rig
from rigctl.engine.rig_boards import RigBoards
from rigctl.engine.setup.progress import note_calibration
from rigctl.engine.wiring_steps import (
    WiringStep,
    WiringSteps,
    mean_readings,
    require_identifiable,
)
from rigctl.errors import CommandRefused, DiskFault, LinkLost, RigFault, WrongUse

BUSY = "a calibration measures now: wait for its end, or cancel it"
CANCELLED = "the calibration was cancelled"
_Measured = TypeVar("_Measured")


class Measurement:
    """Runs one measurement at a time; meanwhile no run begins.

    ``part``: the part of the calibration that is measured, empty while nothing is. ``usual_s``: how
    long that takes, 0 for what nobody waits for.
    """

    def __init__(self, calibrator: Calibrator, loop: asyncio.AbstractEventLoop) -> None:
        self._calibrator, self._loop = calibrator, loop
        self.part, self.usual_s = "", 0.0
        self._begun_s = 0.0
        self._task: asyncio.Task[object] | None = None
        self._is_cancelled = False
        self._ended = asyncio.Event()

    @property
    def elapsed_s(self) -> float:
        """Time since the measurement began, 0 without one."""
        return self._loop.time() - self._begun_s if self.part else 0.0

    def require_none(self) -> None:
        """Raise WrongUse while something is measured."""
        if self.part:
            raise WrongUse(BUSY)

    def require_ready(self) -> None:
        """Raise WrongUse while something is measured, CommandRefused while the drum presses."""
        self.require_none()
        self._calibrator.require_no_contact()

    async def run(
        self, part: str, work: Coroutine[Any, Any, _Measured], usual_s: float = 0.0
    ) -> _Measured:
        """Return the result of the work; then the drum is lifted and switched off.

        Raises what the work raises, CommandRefused where it was cancelled or a STOP came.
        """
        self.part, self.usual_s = part, usual_s
        self._begun_s, self._is_cancelled = self._loop.time(), False
        self._ended.clear()
        try:
            with self._calibrator.motion.by_hand():
                try:
                    return await self._finish(work)
                finally:
                    await self._calibrator.switch_off()
        finally:
            self.part, self.usual_s = "", 0.0
            self._ended.set()

    def cancel(self) -> None:
        """End the measurement, if there is one, and switch the drum off."""
        if self._task is not None:
            self._is_cancelled = True
            self._task.cancel()

    async def end(self) -> None:
        """Cancel the measurement, if there is one, and wait until the drum is switched off."""
        self.cancel()
        if self.part:
            await self._ended.wait()

    async def _finish(self, work: Coroutine[Any, Any, _Measured]) -> _Measured:
        task = self._loop.create_task(work)
        self._task = task
        try:
            return await task
        except asyncio.CancelledError:
            if self._is_cancelled:
                raise CommandRefused(CANCELLED) from None
            raise
        finally:
            self._task = None


HOMING_MM_S, TURN_MM_S = 60.0, 40.0
"""Speeds of the drum's firmware: to the index mark, and of the turn."""
PRESS_S = 14.0
"""To nudge, lift, tare, press, make the step, hold for a while and lift."""
LIFT_S = 3.0
UNTOUCHED_S = 2.0
"""In which the lifted drum shows how much each taxel moves by itself."""
READING_S = {LOADCELL: 2.1, WIRING: 1.7}


def usual_duration_s(part: str, drum: DrumGeometry) -> float:
    """Return the usual time of a measurement; the index mark is half a turn away on average."""
    home_s = drum.circumference_mm / 2 / HOMING_MM_S
    if part == FORCE:
        return PRESS_S + home_s
    if part == RANGE:
        return UNTOUCHED_S + PRESS_S + home_s + drum.plate_length_mm / RANGE_MM_S
    if part == IMBALANCE:
        return LIFT_S + home_s + drum.circumference_mm * 17 / 16 / TURN_MM_S
    return READING_S[part]


NO_RIG_FILE = "a simulated rig has no rig.toml: {what} is not saved"
OTHER_ORDER = (
    "the order of the taxels was saved since: disconnect, connect again, measure the range, "
    "then save it"
)
NO_COUNTS = (
    "rig.toml has ranges in counts and these are of conductance: they hold until the rig "
    "disconnects"
)
_Result = TypeVar("_Result")
CONNECT_AGAIN = "the order holds from the next connection on: disconnect, then connect again"


class Calibration:
    """Measures with the boards of one engine and holds the results.

    ``today`` returns the date that goes into ``rig.toml``.
    """

    def __init__(self, rig: Rig, boards: RigBoards, today: Callable[[], str]) -> None:
        self._rig, self._boards, self._today = rig, boards, today
        self._calibrator = Calibrator(rig, boards.motion)
        self.measurement = Measurement(self._calibrator, rig.loop)
        self._masses = MassReadings()
        self._gains: ForceLoopGains | None = None
        self._range: TaxelRange | None = None
        self._range_force_g = 0.0
        self._imbalance_g: list[float] = []
        self._tare_places: dict[str, float] = {}
        self._places_before: dict[str, float] = {}
        """What the board had before a table that is not saved."""
        self._steps = self._new_steps()
        self._saved: dict[str, str] = {}
        self._has_saved_order = False

    @property
    def has_taxel_order(self) -> bool:
        """Whether rig.toml says which reading is which taxel; without one, they are identified."""
        is_rehearsed = self._rig.path is None and bool(self._steps.wiring)
        return bool(self._rig.config.taxels.wiring) or self._has_saved_order or is_rehearsed

    async def read_mass(self, mass_g: float) -> MassReading:
        """Read the load cell with a mass on the lifted drum, without one first.

        The first reading lifts the drum and switches it off.
        """
        self.measurement.require_ready()
        self._masses.validate_next(mass_g)
        if self._masses.readings:
            self._calibrator.require_off("calibrate the load cell")
        reading = await self._measure(LOADCELL, self._read_mass(mass_g))
        self._masses.add(reading)
        self._saved.pop(LOADCELL, None)
        return reading

    def forget_mass(self, mass_g: float) -> None:
        """Remove the reading with a mass. Raises WrongUse where there is none."""
        self.measurement.require_none()
        self._masses.remove(mass_g)
        self._saved.pop(LOADCELL, None)

    async def tune_gains(self, force_g: float) -> ForceLoopGains:
        """Press, make a small step, lift, and return the gains that fit."""
        self.measurement.require_ready()
        self._gains = await self._measure(FORCE, self._calibrator.tune_gains(force_g))
        self._saved.pop(FORCE, None)
        return self._gains

    async def measure_range(self, force_g: float) -> TaxelRange:
        """Press and turn over the plate once; encode with the range of each taxel, and return it.

        Raises RigFault where a taxel moved too little for a range; the one before then stays.
        """
        self.measurement.require_ready()
        self._check_taxels()
        self._calibrator.require_force(force_g)
        self._range, self._range_force_g = None, force_g
        self._saved.pop(RANGE, None)
        return await self._measure(RANGE, self._measure_range(force_g))

    async def measure_imbalance(self) -> list[float]:
        """Turn the lifted drum once; return the error of each sixteenth of the turn in g."""
        self.measurement.require_ready()
        table_g = await self._measure(IMBALANCE, self._measure_imbalance())
        self._imbalance_g = [round(value, 3) for value in table_g]
        self._saved.pop(IMBALANCE, None)
        return self._imbalance_g

    async def take_wiring_step(self) -> str:
        """Measure what the present step of the identification asks for; return what was found."""
        self.measurement.require_ready()
        require_identifiable(self._rig.config.taxels, "this sensor")
        if self._steps.step is WiringStep.DONE:
            raise WrongUse("all taxels are identified: save the order, or discard it")
        if self._steps.step is not WiringStep.UNPLUG:
            self._calibrator.require_off("identify the taxels")
        return await self._measure(WIRING, self._take_wiring_step())

    def undo_press(self) -> None:
        """Ask for the last place again. Raises WrongUse where none was pressed."""
        self.measurement.require_none()
        self._steps.undo_press()
        self._saved.pop(WIRING, None)

    async def discard(self, part: str) -> None:
        """Forget what was measured of a part; the board uses its imbalance table from before."""
        self.measurement.require_none()
        if part == IMBALANCE and self._places_before:
            self.measurement.require_ready()
            before = self._calibrator.write_lifted(**self._places_before)
            await self.measurement.run(part, before)
            self._places_before = {}
        if part == LOADCELL:
            self._masses = MassReadings()
        elif part == FORCE:
            self._gains = None
        elif part == IMBALANCE:
            self._imbalance_g = []
        else:
            self._steps.end()
            self._steps = self._new_steps()
            self._boards.followed_range.release()
        self._saved.pop(part, None)

    async def save(self, part: str) -> tuple[list[str], str]:
        """Save the result of a part on the board and in ``rig.toml``; return where, and a remark.

        Raises WrongUse where there is no plausible result, CommandRefused while the drum presses,
        DiskFault where rig.toml cannot be written.
        """
        self.measurement.require_none()
        values = self._values(part)
        path = self._rig.path if values.keys else None
        text = values.edited(path) if path else ""
        places, remark = [] if part in (WIRING, RANGE) else [BOARD], values.remark
        if places:
            self.measurement.require_ready()
            saving = self._calibrator.save_settings(**values.settings)
            remark = "; ".join(filter(None, (remark, await self.measurement.run(part, saving))))
            self._use(values)
        if path:
            _write(path, text, places)
            if part == RANGE:
                self._use(values)
            places.append(str(path))
            if part != LOADCELL or await self._boards.motion.is_commissioned():
                note_calibration(path, values.table, values.keys)
        self._saved[part] = " and ".join(places)
        if part == IMBALANCE:
            self._places_before = {}
        self._has_saved_order |= part == WIRING
        return places, remark

    def status(self) -> CalibrationStatus:
        """Return what clients see."""
        scale, steps = self._masses.scale, self._steps
        return CalibrationStatus(
            measuring=self.measurement.part,
            elapsed_s=self.measurement.elapsed_s,
            usual_s=self.measurement.usual_s,
            masses=self._masses.readings,
            scale_ug_per_count=scale.ug_per_count if scale else None,
            nonlinearity_share=scale.nonlinearity_share if scale else None,
            scale_problem=self._masses.problem,
            gains=self._gains,
            taxel_range=self._range,
            imbalance_g=tuple(self._imbalance_g),
            wiring_step=steps.number,
            wiring_question=steps.question,
            wiring_place=steps.place,
            wiring_pressed=steps.pressed,
            wiring=steps.wiring,
            saved=dict(self._saved),
            rig_file=str(self._rig.path or ""),
        )

    async def _measure(self, part: str, work: Coroutine[Any, Any, _Result]) -> _Result:
        usual_s = usual_duration_s(part, self._rig.config.drum)
        return await self.measurement.run(part, work, usual_s)

    def _new_steps(self) -> WiringSteps:
        return WiringSteps(self._rig, partial(mean_readings, self._rig, self._check_taxels))

    async def _read_mass(self, mass_g: float) -> MassReading:
        if not self._masses.readings:
            await self._calibrator.lift()
        self._rig.lay_mass(mass_g)
        try:
            return await self._calibrator.read_mass(mass_g)
        finally:
            self._rig.lay_mass(0.0)

    async def _measure_range(self, force_g: float) -> TaxelRange:
        observe = self._boards.observe_range
        await self._calibrator.lift()
        untouched = await observe(asyncio.sleep(UNTOUCHED_S))
        found = await observe(self._calibrator.press_and_turn(force_g))
        rest = untouched.high.astype(int) - untouched.low
        self._range = TaxelRange(*(tuple(v.tolist()) for v in (found.low, found.high, rest)))
        self._check_taxels()
        if problem := self._range.problem:
            raise RigFault(f"the ranges are not used: {problem}")
        self._boards.use_range(found)
        return self._range

    async def _measure_imbalance(self) -> list[float]:
        before = self._places_before or await self._calibrator.tare_places()
        table_g = await self._calibrator.measure_imbalance()
        self._tare_places = await self._calibrator.tare_places()
        self._places_before = before
        return table_g

    async def _take_wiring_step(self) -> str:
        if self._steps.step is WiringStep.UNPLUG:
            await self._calibrator.lift()  # hands come near the drum
        self._boards.followed_range.hold()
        said = await self._steps.take()
        if self._steps.step is WiringStep.DONE:
            self._boards.followed_range.release()
        return said

    def _check_taxels(self) -> None:
        if not self._boards.taxels_connected:
            raise LinkLost("the taxel board is lost: check its cable")

    def _values(self, part: str) -> CalibratedValues:
        """Return what is saved of a part. Raises WrongUse without a result."""
        if part == LOADCELL:
            scale = self._masses.fitted_scale()
            return loadcell_values(scale, self._masses.masses_g, self._today())
        if part == FORCE and self._gains is not None:
            return force_values(self._gains)
        if part == IMBALANCE and self._imbalance_g:  # also where the board has restarted since
            return CalibratedValues(self._tare_places)
        if part == WIRING and self._steps.wiring:
            return self._wiring_values()
        if part == RANGE and self._range is not None and not self._range.problem:
            return self._range_values(self._range)
        raise WrongUse(f"nothing of {part} has been measured: measure it first, then save it")

    def _range_values(self, found: TaxelRange) -> CalibratedValues:
        if self._rig.path is None:
            raise WrongUse(NO_RIG_FILE.format(what="the range"))
        if self._has_saved_order:
            raise WrongUse(OTHER_ORDER)
        if self._boards.encoder.parameters.reading is not Reading.COUNTS:
            raise WrongUse(NO_COUNTS)
        return range_values(found, self._range_force_g, self._today())

    def _wiring_values(self) -> CalibratedValues:
        if self._rig.path is None:
            raise WrongUse(NO_RIG_FILE.format(what="the order"))
        values = wiring_values(self._rig.config.taxels, self._steps.wiring)
        return replace(values, remark="; ".join(filter(None, (values.remark, CONNECT_AGAIN))))

    def _use(self, values: CalibratedValues) -> None:
        """Let the engine use from now on what is saved."""
        if not values.keys:
            return
        config = self._rig.config
        keys = {name: tuple(v) if isinstance(v, list) else v for name, v in values.keys.items()}
        table = replace(getattr(config, values.table), **keys)
        changed: Any = {values.table: table}
        self._rig.config = self._boards.motion.config = replace(config, **changed)


def _write(path: Path, text: str, places: list[str]) -> None:
    """Write rig.toml. Raises DiskFault, which says where else the values are."""
    try:
        replace_file(path, text)
    except DiskFault as fault:
        has = f": {places[0]} has the new values, rig.toml the old ones" if places else ""
        raise DiskFault(f"{fault}{has}; make it writable, then save again") from fault
