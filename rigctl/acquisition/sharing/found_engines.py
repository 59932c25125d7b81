"""The running engines of this user with what each does, for people who choose one of them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from rigctl.acquisition.rpc.client import EngineClient
from rigctl.acquisition.rpc.engine_files import EngineFile, running_engines
from rigctl.acquisition.rpc.runtime_folder import runtime_folder
from rigctl.acquisition.sharing.control import parse_control
from rigctl.errors import RigctlError

ASK_TIMEOUT_S = 3.0
_ACTIVE = ("running", "paused", "prompt")


@dataclass(frozen=True, slots=True)
class FoundEngine:
    """A running engine. ``run``: its run as the status has it, empty where it did not answer.

    ``holder``: the name of the client that has control, empty for nobody. ``failure``: why it did
    not answer, empty where it did.
    """

    engine: EngineFile
    run: dict[str, Any]
    holder: str = ""
    failure: str = ""

    @property
    def has_run(self) -> bool:
        """Whether it runs a protocol."""
        return self.run.get("state") in _ACTIVE

    @property
    def name(self) -> str:
        """The rig and the process."""
        return f"{self.engine.rig} (process {self.engine.pid})"

    def describe(self) -> str:
        """Return one sentence on what it does and who has control."""
        if self.failure:
            return f"does not answer ({self.failure})"
        what = self._run_words() if self.has_run else "no run"
        return f"{what}; {self.holder or 'nobody'} has control"

    def _run_words(self) -> str:
        run = self.run
        word = {"paused": "paused run", "prompt": "run that waits for an answer"}
        state = word.get(str(run["state"]), "run")
        done, planned = run.get("trials_committed"), run.get("trials_planned")
        return f"{state}, {done} of {planned} trials, into {run.get('session')}"


def find_engines() -> list[FoundEngine]:
    """Return the running engines, newest first.

    Waits for the slowest, a few seconds at most. Raises WrongUse where there can be no folder for
    engines.
    """
    engines = running_engines(runtime_folder())
    with ThreadPoolExecutor(len(engines) or 1, "find-engines") as executor:
        return list(executor.map(_ask, engines))


def _ask(engine: EngineFile) -> FoundEngine:
    try:
        with closing(EngineClient(engine)) as client:
            status = client.request("status", timeout_s=ASK_TIMEOUT_S)
            control = parse_control(client.request("clients", timeout_s=ASK_TIMEOUT_S))
    except (RigctlError, OSError) as error:
        return FoundEngine(engine, {}, failure=str(error))
    return FoundEngine(engine, dict(status["run"]), control.holder_name)
