"""STOP for every engine of this user, all at once: one that hangs holds none of the others up."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection
from queue import SimpleQueue
from typing import NamedTuple

from rigctl.acquisition.rpc.client import EngineClient
from rigctl.acquisition.rpc.engine_files import EngineFile, running_engines, runtime_folder

ANSWER_S = 5.0


class StopResult(NamedTuple):
    """An engine that was told to stop; ``failure``: what kept it from that, empty where it did."""

    rig: str
    pid: int
    failure: str

    @property
    def name(self) -> str:
        """Which engine, for a sentence."""
        return f"{self.rig} (process {self.pid})"


def stop_engines(tell: Callable[[StopResult], None], but: Collection[str] = ()) -> int:
    """Stop each engine but those named, and tell of each as it answers; how many there were.

    Waits for the slowest, at most a few seconds. Raises WrongUse where no folder for engines can
    be had.
    """
    engines = [engine for engine in running_engines(runtime_folder()) if engine.name not in but]
    answers: SimpleQueue[StopResult] = SimpleQueue()
    threads = [
        threading.Thread(target=lambda e=engine: answers.put(_stop(e)), name="stop", daemon=True)
        for engine in engines
    ]
    for thread in threads:
        thread.start()
    for _ in engines:
        tell(answers.get())
    for thread in threads:
        thread.join()
    return len(engines)


def _stop(engine: EngineFile) -> StopResult:
    try:
        client = EngineClient.attach(engine)
        try:
            client.request("stop", limit_s=ANSWER_S)
        finally:
            client.close()
    except Exception as error:  # noqa: BLE001 - top of a thread: whoever stops must hear of it
        return StopResult(engine.rig, engine.pid, str(error))
    return StopResult(engine.rig, engine.pid, "")
