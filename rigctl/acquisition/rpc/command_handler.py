"""The commands of clients, one method each.

Commands that move the rig are refused during a run; stop never is.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Awaitable, Callable
from typing import Any

from rigctl.acquisition.drum.motion import DrumMotion
from rigctl.acquisition.engine import Engine
from rigctl.acquisition.protocol.run_request import RunRequest
from rigctl.acquisition.protocol.runner import Run
from rigctl.acquisition.rpc.messages import as_dict
from rigctl.config.rig_config import RigLimits
from rigctl.errors import WrongUse
from rigctl.wire.drum.codes import Command

Result = dict[str, Any]
TRAVEL_FACTOR = 1.5
TRAVEL_EXTRA_S = 10.0

OPERATOR_SETTINGS = {
    "speed_mm_s": "speed_set",
    "force_g": "force_set",
    "acceleration_mm_s2": "acceleration_set",
    "travel_mm": "travel_set",
    "run_in_mm": "run_in_set",
}
"""Settings of an operator, with their registers. All others decide what a force means, what stops
the drum or how it is built; they come from ``rig.toml``, a protocol or a calibration."""


class CommandHandler:
    """Executes requests. Every method returns the reply's result or raises RigctlError."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._commands: dict[str, Callable[..., Awaitable[Result]]] = {
            name.removeprefix("on_"): method
            for name, method in inspect.getmembers(self, inspect.iscoroutinefunction)
            if name.startswith("on_")
        }

    async def handle(self, command: str, args: dict[str, Any]) -> Result:
        """Execute one request. Raises WrongUse for an unknown command or wrong arguments."""
        method = self._commands.get(command)
        if method is None:
            names = ", ".join(sorted(self._commands))
            raise WrongUse(f"the engine has no command {command!r}: it has {names}")
        _validate_arguments(f"command {command}", method, args)
        return await method(**args)

    async def on_status(self) -> Result:
        """Return the data of the status event."""
        return as_dict(self._engine.status())

    async def on_arm(self) -> Result:
        """Power up and lift off."""
        await self._free_motion().arm()
        return {}

    async def on_disarm(self) -> Result:
        """Lift off and switch the drivers off."""
        await self._free_motion().disarm()
        return {}

    async def on_tare(self) -> Result:
        """Take the load cell's reading as no load."""
        await self._free_motion().tare()
        return {}

    async def on_home(self) -> Result:
        """Find the index mark."""
        await self._free_motion().home()
        return {}

    async def on_jog(self, mm: float) -> Result:
        """Turn the lifted drum by mm of texture, forwards where positive; return the real mm."""
        motion = self._free_motion()
        return {"moved_mm": await motion.jog(_validate_number("mm", mm))}

    async def on_set(self, **values: float) -> Result:
        """Write an operator's settings; return the values that the board took."""
        motion = self._free_motion()
        for name, value in values.items():
            _validate_setting(name, value, motion.config.limits)
        registers = {OPERATOR_SETTINGS[name]: value for name, value in values.items()}
        written = await motion.poller.drum.set(**registers)
        motion.settings.update(written)
        return {name: written[OPERATOR_SETTINGS[name]] for name in values}

    async def on_approach(self) -> Result:
        """Press until the force has settled."""
        await self._free_motion().approach()
        return {}

    async def on_run(self) -> Result:
        """Turn through run-in, window and ramp."""
        motion = self._free_motion()
        settings = motion.settings
        travel_mm = settings["run_in_set"] + settings["travel_set"]
        await motion.run(TRAVEL_EXTRA_S + TRAVEL_FACTOR * travel_mm / settings["speed_set"])
        return {}

    async def on_retract(self) -> Result:
        """Lift off from any state."""
        await self._free_motion().lift()
        return {}

    async def on_stop(self) -> Result:
        """Stop and lift at once; a run ends."""
        await self._engine.send_stop("stopped by a client")
        return {}

    async def on_clear_fault(self) -> Result:
        """Clear the latched fault, where its cause is gone."""
        await self._engine.rig.drum.command(Command.CLEAR)
        return {}

    async def on_start(
        self,
        protocol: str | None = None,
        out: str | None = None,
        seed: int | None = None,
        yes: bool = False,
        resume: str | None = None,
    ) -> Result:
        """Run a protocol into ``out``, or resume the session in ``resume``."""
        self._free_motion()
        run = self._engine.start(RunRequest(protocol, out, resume, seed, yes))
        return {"session": str(run.folder)}

    async def on_pause(self) -> Result:
        """Lift off and pause the run."""
        self._active_run().control.pause()
        return {}

    async def on_resume(self) -> Result:
        """Resume the run; the interrupted trial repeats."""
        self._active_run().control.resume()
        return {}

    async def on_abort(self) -> Result:
        """End the run safely."""
        self._active_run().control.abort("aborted by a client")
        return {}

    async def on_answer(self, prompt_id: int, answer: str) -> Result:
        """Answer a question: ``ok`` continues, ``abort`` ends the run."""
        if not self._active_run().control.answer(prompt_id, answer):
            raise WrongUse(f"question {prompt_id} is not the current one")
        return {}

    async def on_plate(self, texture: str) -> Result:
        """Note the mounted plate; a simulated rig mounts it by itself."""
        self._free_motion()
        return {"changed": self._engine.set_plate(texture)}

    async def on_calibrate_range(self, seconds: float = 10.0) -> Result:
        """Observe the taxels and set the observed range in the encoder."""
        found = await self._engine.boards.calibrate_range(float(seconds))
        return {"low": found.low.tolist(), "high": found.high.tolist()}

    async def on_test_taxels(self) -> Result:
        """Start the taxel board's self-test; return one sentence per finding."""
        self._free_motion()
        taxels = self._engine.boards.taxels
        await taxels.test()
        return {"found": taxels.findings}

    async def on_inject(self, fault: str, **args: Any) -> Result:
        """Inject a fault into a simulated bench."""
        faults = self._engine.rig.faults
        if faults is None:
            raise WrongUse("faults can be injected on a simulated rig only")
        method = getattr(faults, fault, None)
        if fault.startswith("_") or not callable(method):
            raise WrongUse(f"the simulated bench has no fault {fault!r}")
        _validate_arguments(f"fault {fault}", method, args)
        method(**args)
        return {}

    async def on_shutdown(self) -> Result:
        """End the engine; it makes the rig safe first."""
        self._engine.shut_down("a client ended the engine")
        return {}

    def _free_motion(self) -> DrumMotion:
        """Return the drum's motion. Raises WrongUse during a run."""
        if self._engine.is_running:
            raise WrongUse("a run is active: pause or abort it first")
        return self._engine.boards.motion

    def _active_run(self) -> Run:
        run = self._engine.run
        if run is None or run.ended:
            raise WrongUse("no run is active: start one first")
        return run


def _validate_setting(name: str, value: object, limits: RigLimits) -> None:
    """Raise WrongUse for a setting that is not the operator's, or outside this rig's limits."""
    if name not in OPERATOR_SETTINGS:
        raise WrongUse(
            f"{name} is not an operator's setting, which are {', '.join(OPERATOR_SETTINGS)}: "
            "change it in rig.toml or in the protocol, or calibrate the rig"
        )
    number = _validate_number(name, value)
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


def _validate_number(name: str, value: object) -> float:
    """Return the value. Raises WrongUse where it is not a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise WrongUse(f"{name} must be a number, not {value!r}")
    return value


def _validate_arguments(what: str, method: Callable[..., object], args: dict[str, Any]) -> None:
    try:
        inspect.signature(method).bind(**args)
    except TypeError as error:
        raise WrongUse(f"{what}: {error}") from error
