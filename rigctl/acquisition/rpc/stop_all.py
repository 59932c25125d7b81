"""Stop all engines of this user in parallel, so that one that hangs does not delay the others."""

from __future__ import annotations

from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing
from typing import NamedTuple

from rigctl.acquisition.rpc.client import COMMAND_LINE, EngineClient
from rigctl.acquisition.rpc.engine_files import EngineFile, running_engines
from rigctl.acquisition.rpc.runtime_folder import runtime_folder

STOP_TIMEOUT_S = 5.0


class StopResult(NamedTuple):
    """Result of STOP for one engine; ``failure``: why it did not stop, empty where it did."""

    rig: str
    pid: int
    failure: str

    @property
    def name(self) -> str:
        """The engine's name in a sentence."""
        return f"{self.rig} (process {self.pid})"


def stop_engines(
    report: Callable[[StopResult], None],
    exclude: Collection[str] = (),
    program: str = COMMAND_LINE,
) -> int:
    """Stop every engine but the excluded ones, report each result, return how many there were.

    ``program``: the caller, for the log of those engines. Waits for the slowest, at most a few
    seconds. Raises WrongUse where there can be no folder for engines.
    """
    engines = [engine for engine in running_engines(runtime_folder()) if engine.name not in exclude]
    with ThreadPoolExecutor(len(engines) or 1, "stop") as executor:
        for stop in as_completed([executor.submit(_stop, engine, program) for engine in engines]):
            report(stop.result())
    return len(engines)


def _stop(engine: EngineFile, program: str) -> StopResult:
    try:
        with closing(EngineClient(engine, program=program)) as client:
            client.request("stop", timeout_s=STOP_TIMEOUT_S)
    except Exception as error:  # noqa: BLE001 - top of a thread: the user must see every failure
        return StopResult(engine.rig, engine.pid, str(error))
    return StopResult(engine.rig, engine.pid, "")
