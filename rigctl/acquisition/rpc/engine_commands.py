"""The commands of clients that every engine has: a method for each.

A command's method returns the reply's result, None for an empty one.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Awaitable, Callable
from typing import Any, Generic, TypeVar

from rigctl.acquisition.protocol.run_reasons import RunReasons
from rigctl.acquisition.rpc.messages import as_dict
from rigctl.acquisition.served_engine import ServedEngine
from rigctl.errors import WrongUse

Result = dict[str, Any]
_Engine = TypeVar("_Engine", bound=ServedEngine[Any, Any])


class EngineCommands(Generic[_Engine]):
    """Executes requests to an engine; a subclass adds ``on_`` methods.

    ``request_type``: the dataclass of a run's request. ``faults()`` is the fault injection of a
    simulated rig, None for a real one.
    """

    def __init__(
        self, engine: _Engine, request_type: Callable[..., Any], faults: Callable[[], Any]
    ) -> None:
        self._engine = engine
        self._request_type = request_type
        self._faults = faults
        self._commands: dict[str, Callable[..., Awaitable[Result | None]]] = {
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
        validate_arguments(f"command {command}", method, args)
        return await method(**args) or {}

    async def on_status(self) -> Result:
        """Return the data of the status event."""
        return as_dict(self._engine.status())

    async def on_start(self, **request: Any) -> Result:
        """Run a protocol or resume a session, as the request's dataclass says."""
        validate_arguments("command start", self._request_type, request)
        self._refuse_during_run()
        run = self._engine.start(self._request_type(**request))
        return {"session": str(run.folder)}

    async def on_pause(self) -> None:
        """Pause the run."""
        self._control().pause()

    async def on_resume(self) -> None:
        """Resume the run; the interrupted trial repeats."""
        self._control().resume()

    async def on_abort(self) -> None:
        """End the run safely."""
        self._control().abort("aborted by a client")

    async def on_answer(self, prompt_id: int, answer: str) -> None:
        """Answer a question: ``ok`` continues, ``abort`` ends the run."""
        if not self._control().answer(prompt_id, answer):
            raise WrongUse(f"question {prompt_id} is not the current one")

    async def on_inject(self, fault: str, **args: Any) -> None:
        """Inject a fault into a simulated bench."""
        faults = self._faults()
        if faults is None:
            raise WrongUse("faults can be injected on a simulated rig only")
        method = getattr(faults, fault, None)
        if fault.startswith("_") or not callable(method):
            raise WrongUse(f"the simulated bench has no fault {fault!r}")
        validate_arguments(f"fault {fault}", method, args)
        method(**args)

    async def on_shutdown(self) -> None:
        """End the engine; it makes the rig safe first."""
        self._engine.shut_down("a client ended the engine")

    def _refuse_during_run(self) -> None:
        if self._engine.is_running:
            raise WrongUse("a run is active: abort it first, or wait for its end")

    def _control(self) -> RunReasons:
        """Return the control of the active run. Raises WrongUse without one."""
        run = self._engine.run
        if run is None or run.ended:
            raise WrongUse("no run is active: start one first")
        control: RunReasons = run.control
        return control


def validate_number(name: str, value: object) -> float:
    """Return the value. Raises WrongUse where it is not a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise WrongUse(f"{name} must be a number, not {value!r}")
    return value


def validate_arguments(what: str, method: Callable[..., object], args: dict[str, Any]) -> None:
    """Raise WrongUse where a method does not take these arguments."""
    try:
        inspect.signature(method).bind(**args)
    except TypeError as error:
        raise WrongUse(f"{what}: {error}") from error
