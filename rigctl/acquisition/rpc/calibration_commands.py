"""The commands that calibrate a drum rig, refused during a run; a STOP ends them."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from rigctl.acquisition.calibration.calibration import Calibration
from rigctl.acquisition.engine import Engine
from rigctl.acquisition.rpc.declared_commands import Result
from rigctl.acquisition.rpc.engine_commands import EngineCommands
from rigctl.errors import WrongUse

MAX_LOAD_G = 1e6
Mass = Annotated[float, Meta(ge=0, le=MAX_LOAD_G)]
Part = Literal["loadcell", "force", "imbalance", "wiring"]


class CalibrationCommands(EngineCommands[Engine]):
    """Executes the requests of a calibration; a drum's commands add the others."""

    async def on_calibrate_loadcell(self, mass_g: Mass) -> Result:
        """Read the lifted load cell with a known mass, 0 g first; return counts and spread."""
        return dict((await self._calibration().read_mass(mass_g))._asdict())

    async def on_forget_mass(self, mass_g: Mass) -> None:
        """Remove a reading of the load cell from the calibration."""
        self._calibration().forget_mass(mass_g)

    async def on_calibrate_force(self, force_g: Mass = 500.0) -> Result:
        """Press, make a small step, lift, and return the gains of the force loop that fit."""
        return dict((await self._calibration().tune_gains(force_g))._asdict())

    async def on_calibrate_imbalance(self) -> Result:
        """Turn the lifted drum once; return the load cell's error of each sixteenth of a turn."""
        return {"table_g": await self._calibration().measure_imbalance()}

    async def on_calibrate_wiring(self) -> Result:
        """Measure what the present step of the identification of the taxels asks for."""
        return {"found": await self._calibration().take_wiring_step()}

    async def on_repeat_press(self) -> None:
        """Ask for the last place of the identification again."""
        self._calibration().undo_press()

    async def on_save_calibration(self, part: Part) -> Result:
        """Save what was measured on the board and in ``rig.toml``; return where."""
        calibration = self._calibration()
        if self._engine.manual.is_recording:
            raise WrongUse("a recording by hand goes on: end it first, then save the calibration")
        places, remark = await calibration.save(part)
        return {"part": part, "kept_in": places, "remark": remark}

    async def on_discard_calibration(self, part: Part) -> None:
        """Forget what was measured; the board uses its imbalance table from before."""
        await self._calibration().discard(part)

    async def on_cancel_calibration(self) -> None:
        """End the measurement; the drum is lifted and switched off."""
        self._engine.calibration.measurement.cancel()

    def _calibration(self) -> Calibration:
        """Return the calibrations. Raises WrongUse during a run and during a move by hand."""
        self._refuse_during_run()
        self._engine.calibration.measurement.require_none()
        if self._engine.boards.motion.is_moved_by_hand:
            raise WrongUse("the drum is moved by hand: wait until that has ended, then calibrate")
        return self._engine.calibration
