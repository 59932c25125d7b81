"""The commands of clients: the drum's moves, and a method for each of the others.

Commands that move the rig are refused during a run; stop never is.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from functools import partial

from rigctl.acquisition.drum.motion import DrumMotion
from rigctl.acquisition.engine import Engine
from rigctl.acquisition.protocol.run_request import RunRequest
from rigctl.acquisition.rpc.engine_commands import EngineCommands, Result, validate_number
from rigctl.config.rig_config import RigLimits
from rigctl.errors import WrongUse
from rigctl.wire.drum.codes import Command

OPERATOR_SETTINGS = {
    "speed_mm_s": "speed_set",
    "force_g": "force_set",
    "acceleration_mm_s2": "acceleration_set",
    "travel_mm": "travel_set",
    "run_in_mm": "run_in_set",
}
"""Settings of an operator, with their registers. All others decide what a force means, what stops
the drum or how it is built; they come from ``rig.toml``, a protocol or a calibration."""


MOVES: dict[str, Callable[[DrumMotion], Awaitable[object]]] = {
    "arm": DrumMotion.arm,
    "disarm": DrumMotion.disarm,
    "tare": DrumMotion.tare,
    "home": DrumMotion.home,
    "approach": DrumMotion.approach,
    "run": DrumMotion.run,
    "retract": DrumMotion.lift,
}
"""Commands that move the rig without an argument."""


class CommandHandler(EngineCommands[Engine]):
    """Executes requests to the engine of a drum rig."""

    def __init__(self, engine: Engine) -> None:
        super().__init__(engine, RunRequest, lambda: engine.rig.faults)
        self._commands |= {name: partial(self._move, move) for name, move in MOVES.items()}

    async def on_jog(self, mm: float) -> Result:
        """Turn the lifted drum, forwards where ``mm`` is positive; return the true travel."""
        motion = self._motion_outside_runs()
        return {"moved_mm": await motion.jog(validate_number("mm", mm))}

    async def on_set(self, **values: float) -> Result:
        """Write an operator's settings; return the values that the board took."""
        motion = self._motion_outside_runs()
        for name, value in values.items():
            _validate_setting(name, value, motion.config.limits)
        registers = {OPERATOR_SETTINGS[name]: value for name, value in values.items()}
        written = await motion.poller.drum.set(**registers)
        motion.settings.update(written)
        return {name: written[OPERATOR_SETTINGS[name]] for name in values}

    async def on_stop(self) -> None:
        """Stop and lift immediately; a run ends."""
        await self._engine.send_stop("stopped by a client")

    async def on_clear_fault(self) -> None:
        """Clear the latched fault, where its cause is gone."""
        await self._engine.rig.drum.command(Command.CLEAR)

    async def on_plate(self, texture: str) -> Result:
        """Store which plate is mounted; a simulated rig mounts it itself."""
        self._refuse_during_run()
        return {"changed": self._engine.set_plate(texture)}

    async def on_calibrate_range(self, seconds: float = 10.0) -> Result:
        """Observe the taxels and set the observed range in the encoder."""
        found = await self._engine.boards.calibrate_range(float(seconds))
        return {"low": found.low.tolist(), "high": found.high.tolist()}

    async def on_test_taxels(self) -> Result:
        """Start the taxel board's self-test; return one sentence per finding."""
        self._refuse_during_run()
        taxels = self._engine.boards.taxels
        await taxels.test()
        return {"found": taxels.findings}

    async def _move(self, move: Callable[[DrumMotion], Awaitable[object]]) -> None:
        await move(self._motion_outside_runs())

    def _motion_outside_runs(self) -> DrumMotion:
        """Return the drum's motion. Raises WrongUse during a run."""
        self._refuse_during_run()
        return self._engine.boards.motion


def _validate_setting(name: str, value: object, limits: RigLimits) -> None:
    """Raise WrongUse for a setting that is not the operator's, or outside this rig's limits."""
    if name not in OPERATOR_SETTINGS:
        raise WrongUse(
            f"{name} is not an operator's setting, which are {', '.join(OPERATOR_SETTINGS)}: "
            "change it in rig.toml or in the protocol, or calibrate the rig"
        )
    number = validate_number(name, value)
    bounds = {
        "speed_mm_s": (limits.speed_min_mm_s, limits.speed_max_mm_s),
        "force_g": (limits.force_min_g, limits.force_max_g),
    }
    low, high = bounds.get(name, (-math.inf, math.inf))
    if not low <= number <= high:
        raise WrongUse(
            f"{name} {number:g} is outside this rig's limits, {low:g} to {high:g}: choose one "
            "within them, or change [limits] in rig.toml"
        )
