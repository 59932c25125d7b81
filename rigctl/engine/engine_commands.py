"""The commands of clients that every engine has: a method for each.

The annotations of a method declare the arguments of its command
(:mod:`rigctl.engine.rpc.commands`). It returns the reply's result, None for an empty one.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, ClassVar, Generic, Literal, TypeVar

import msgspec

from rigctl.config.text_file import shorten
from rigctl.engine.rpc.commands import (
    A_CLIENT,
    SENDER,
    EngineCommand,
    Number,
    Result,
    Word,
    arguments_by_name,
    declared_arguments,
    declared_methods,
    read_arguments,
    summary_of,
)
from rigctl.engine.rpc.messages import LslScope, as_dict
from rigctl.engine.run_reasons import RunReasons
from rigctl.engine.served_engine import ServedEngine
from rigctl.errors import WrongUse

_Engine = TypeVar("_Engine", bound=ServedEngine[Any, Any])


class Injection(msgspec.Struct, frozen=True):
    """The fault that the command ``inject`` names; the fault has arguments of its own."""

    fault: Word


class EngineCommands(Generic[_Engine]):
    """Executes requests to an engine; a subclass adds ``on_`` methods.

    ``request_type`` is the type of a run's request. ``faults()`` is the fault injection of a
    simulated rig, None for a real one.
    """

    request_type: ClassVar[type[msgspec.Struct]]

    def __init__(self, engine: _Engine, faults: Callable[[], Any]) -> None:
        self._engine = engine
        self._faults = faults
        self._commands = self.declared_commands()

    @classmethod
    def declared_commands(cls) -> dict[str, EngineCommand]:
        """Return all commands by name."""
        start = EngineCommand(summary_of(cls._start), cls.request_type, cls._start)
        return {**declared_methods(cls), "start": start}

    async def handle(self, command: str, args: dict[str, Any], by: str = A_CLIENT) -> Result:
        """Execute one request; ``by``: who sent it.

        Raises WrongUse for an unknown command or wrong arguments.
        """
        if command == "inject":
            self._inject(args)
            return {"injected": args}
        known = self._commands.get(command)
        if known is None:
            names = ", ".join(sorted((*self._commands, "inject")))
            raise WrongUse(f"the engine has no command {shorten(repr(command))}: it has {names}")
        arguments = read_arguments(f"command {command}", known.arguments, args)
        told = {SENDER: by} if known.names_sender else {}
        return await known.execute(self, arguments, **told) or {}

    async def on_status(self) -> Result:
        """Return the data of the status event."""
        return as_dict(self._engine.status())

    async def on_pause(self) -> None:
        """Pause the run."""
        self._control().pause()

    async def on_resume(self) -> None:
        """Resume the run; the interrupted trial repeats."""
        self._control().resume()

    async def on_abort(self, by: str) -> None:
        """End the run safely."""
        self._control().abort(f"aborted by {by}")

    async def on_answer(self, prompt_id: Number, answer: Literal["ok", "abort"]) -> None:
        """Answer a question: ``ok`` continues, ``abort`` ends the run."""
        if not self._control().answer(prompt_id, answer):
            raise WrongUse(f"question {prompt_id} is not the current one")

    async def on_lsl(self, scope: Literal["off", "computer", "network"]) -> Result:
        """Stream over the Lab Streaming Layer to programs of a circle, or switch that off."""
        try:
            self._engine.lsl.switch(LslScope(scope))
        except OSError as error:
            raise WrongUse(f"no process can stream ({error.strerror}): close programs") from error
        return {"scope": scope}

    async def on_shutdown(self, by: str) -> None:
        """End the engine; it makes the rig safe first."""
        self._engine.shut_down(f"{by} ended the engine")

    async def _start(self, request: Any) -> Result:
        """Run a protocol, or resume a session."""
        return self._begin(lambda: self._engine.start(request))

    def _begin(self, start: Callable[[], Any]) -> Result:
        """Let a run begin; return its session."""
        self._refuse_during_run()
        try:
            run = start()
        except OSError as error:  # a name that the file system does not take, a folder not ours
            raise WrongUse(
                f"the run cannot start: {error.filename}: {error.strerror}: choose another path"
            ) from error
        return {"session": str(run.folder)}

    def _inject(self, args: dict[str, Any]) -> None:
        """Inject a fault into a simulated bench."""
        faults = self._faults()
        if faults is None:
            raise WrongUse("faults can be injected on a simulated rig only")
        fault = read_arguments("command inject", Injection, args).fault
        method = getattr(faults, fault, None)
        if fault.startswith("_") or not inspect.ismethod(method):
            raise WrongUse(f"the simulated bench has no fault {fault!r}")
        given = {name: value for name, value in args.items() if name != "fault"}
        kind = declared_arguments(fault, method)
        method(**arguments_by_name(read_arguments(f"fault {fault}", kind, given)))

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
