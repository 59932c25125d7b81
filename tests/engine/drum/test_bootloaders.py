"""An engine on boards with their factory bootloaders: it connects, and a reset is survived."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from rigctl.bench.chips import rig as chips
from rigctl.bench.simulated_rig import DRUM, TAXELS
from rigctl.session.verify import verify
from tests.engine.drum.test_drum_reset import ONE
from tests.engine.engine_harness import EngineHarness, open_harness, until_ended
from tests.engine.protocol.test_interruptions import until_turning, verdicts
from tests.firmware.bootloaders import MEGA, UNO
from tests.firmware.building import built


async def reset_both(harness: EngineHarness) -> None:
    """Press both reset buttons while the engine polls."""
    faults, boards = harness.rig.faults, harness.engine.boards
    assert faults is not None
    await harness.wait(1.0)
    faults.reset(DRUM)
    faults.reset(TAXELS)
    await harness.until(lambda: not boards.drum_poller.connected, 5.0)
    await harness.until(lambda: boards.drum_poller.connected and boards.taxels_connected, 20.0)
    await harness.wait(0.5)


async def reset_while_turning(harness: EngineHarness) -> None:
    """Press the drum's reset button while it turns in contact."""
    await until_turning(harness)
    assert harness.rig.faults is not None
    harness.rig.faults.reset(DRUM)
    await until_ended(harness)


def with_bootloaders(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the next chips have their factory bootloaders."""
    built("firmware/drum.elf"), built("firmware/taxels.elf"), built("sim/libchips.so")
    opened = partial(chips.open_chip_simulation, bootloaders={DRUM: MEGA, TAXELS: UNO})
    monkeypatch.setattr(chips, "open_chip_simulation", opened)


def test_a_run_waits_for_a_bootloader_and_repeats_the_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_bootloaders(monkeypatch)
    with open_harness(tmp_path, rig_kind="firmware") as harness:
        harness.run(reset_while_turning, harness.request(ONE))
        assert harness.engine.run is not None and harness.engine.run.complete
        assert verdicts(harness) == [(1, "aborted"), (1, "committed")]
        assert verify(harness.session).whole
    assert "drum: the board's bootloader may be listening: silent for 5 s" in harness.texts("link")


def test_an_engine_says_what_it_waits_for_and_is_back_after_resets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_bootloaders(monkeypatch)
    with open_harness(tmp_path, rig_kind="firmware") as harness:
        harness.run(reset_both)
    silent = "the board's bootloader may be listening: silent for"
    for board in (DRUM, TAXELS):
        assert f"{board}: {silent} 2 s" in harness.texts("log")
    assert f"drum: {silent} 5 s" in harness.texts("link")
    back = [text for text in harness.texts("board") if "rebooted and is back" in text]
    assert {text.split(" board")[0] for text in back} == {"drum", "taxel"}
