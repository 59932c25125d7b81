"""An engine ends when it is told to, and says why where it goes on; of the drum and of the finger.

Its boards may not have answered yet, and another client may have control.
"""

from __future__ import annotations

import asyncio
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest

from rigctl.engine.rpc.client import (
    ENGINE_COMMAND,
    FINGER_ENGINE_COMMAND,
    EngineClient,
    EngineRefusal,
)
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from rigctl.engine.rpc.server import open_listener
from rigctl.experiments import DRUM_EXPERIMENT, FINGER_EXPERIMENT
from tests.engine.engine_harness import open_harness
from tests.engine.served_harness import ServedHarness
from tests.finger.harness import open_finger_harness

SOON_S = 0.001
"""Before any board has answered."""


@pytest.mark.parametrize("opened", [open_harness, open_finger_harness])
def test_an_engine_ends_before_its_boards_have_answered(opened: Any, tmp_path: Path) -> None:
    harnesses: AbstractContextManager[ServedHarness[Any, Any]] = opened(tmp_path)
    with harnesses as harness, open_listener() as listener:
        engine = harness.engine
        engine.loop.call_later(SOON_S, engine.shut_down, "a signal ended the engine")
        serving = engine.serve(listener, "token", harness.handle)
        assert engine.loop.run_until_complete(serving) == 0
        assert not engine.is_ready
        assert engine.loop.time() < 10 * SOON_S
        assert asyncio.all_tasks(engine.loop) == set()


@pytest.mark.parametrize(
    ("command", "experiment"),
    [(ENGINE_COMMAND, DRUM_EXPERIMENT), (FINGER_ENGINE_COMMAND, FINGER_EXPERIMENT)],
)
def test_who_watches_cannot_end_the_engine_and_is_told_so(
    command: str, experiment: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    starter = EngineClient.start("virtual", paced=True, command=command)
    assert starter.process is not None
    other = EngineClient.attach(experiment)
    other.request("introduce", name="window of Anna")
    with pytest.raises(EngineRefusal, match="window of Anna has control"):
        starter.shut_down()
    assert other.request("status")["simulated"]
    other.shut_down()
    assert starter.process.wait(60) == 0
