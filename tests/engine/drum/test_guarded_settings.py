"""Guarded settings, which the board takes only lifted and at rest, are written as soon as possible.

``tests/contract`` tests the board's own rules; here a patched driver refuses like the board.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.boards.drum_states import State
from rigctl.config.rig_config import LoadCell, RigConfig, RigLimits
from rigctl.engine.drum_commands import DrumCommands
from rigctl.engine.rig import Rig
from rigctl.engine.settings import GUARDED_SETTINGS
from rigctl.errors import CommandRefused, RigFault
from rigctl.rig import FIRMWARE, VIRTUAL
from tests.engine.engine_harness import EngineHarness, open_harness, until_ended

MINE = RigConfig(limits=RigLimits(over_force_g=1350), loadcell=LoadCell(scale_ug_per_count=2390))
REFUSED = "drum: the board refused, because its state does not allow it"


class Guard:
    """A patch of ``Drum.set`` that refuses guarded settings outside the allowed states."""

    def __init__(self, rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
        self.allowed = (State.IDLE, State.ARMED)
        self.sent: list[set[str]] = []
        self._drum = rig.drum
        self._set = rig.drum.set
        monkeypatch.setattr(rig.drum, "set", self.set)

    async def set(self, **values: float) -> dict[str, float]:
        """Write settings; see :meth:`Drum.set`."""
        guarded = set(values) & set(GUARDED_SETTINGS)
        state = State(int((await self._drum.get("state"))["state"]))
        changed = any(self._drum.settings[name] != values[name] for name in guarded)
        if changed and state not in self.allowed:
            raise CommandRefused(f"{REFUSED}: {', '.join(sorted(guarded))} not set")
        self.sent.append(set(values))
        return await self._set(**values)


async def taken(harness: EngineHarness) -> bool:
    found = await harness.rig.drum.get(*GUARDED_SETTINGS)
    return (found["over_force"], found["scale_ug_per_count"]) == (1350, 2390)


@pytest.mark.parametrize("kind", [VIRTUAL, FIRMWARE])
def test_a_rig_with_its_emergency_stop_pressed_gets_guarded_settings_when_armed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        ask = DrumCommands(harness.engine).handle
        assert not await taken(harness)
        (text,) = harness.texts("check")
        assert text.startswith(REFUSED) and "not set" in text
        assert text.endswith("arming the drum tries again")
        assert harness.rig.faults is not None
        harness.rig.faults.release_estop()
        await harness.wait(0.2)
        await ask("clear_fault", {})
        await harness.wait(0.2)
        await ask("arm", {})
        assert await taken(harness)
        await ask("tare", {})
        await ask("approach", {})

    with open_harness(tmp_path, config=MINE, rig_kind=kind) as harness:
        if kind == VIRTUAL:
            Guard(harness.rig, monkeypatch)  # the chips have one of their own
        assert harness.rig.faults is not None
        harness.rig.faults.press_estop()
        harness.run(scenario)
        assert harness.exit_code == 0


def test_unchanged_settings_are_not_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        ask = DrumCommands(harness.engine).handle
        assert await taken(harness)
        before = len([names for names in guard.sent if names & set(GUARDED_SETTINGS)])
        for command in ("arm", "tare", "approach", "retract"):
            await ask(command, {})
        assert len([names for names in guard.sent if names & set(GUARDED_SETTINGS)]) == before == 1

    with open_harness(tmp_path, config=MINE) as harness:
        guard = Guard(harness.rig, monkeypatch)
        harness.run(scenario)
    assert harness.texts("check") == []


def test_a_drum_that_takes_guarded_settings_only_lifted_is_armed_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        assert not await taken(harness)
        await DrumCommands(harness.engine).handle("arm", {})
        assert await taken(harness)

    with open_harness(tmp_path, config=MINE) as harness:
        Guard(harness.rig, monkeypatch).allowed = (State.ARMED,)
        harness.run(scenario)


def test_nothing_is_pressed_with_other_settings_than_described(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        ask = DrumCommands(harness.engine).handle
        for command in ("arm", "approach"):
            with pytest.raises(RigFault, match=r"scale_ug_per_count.* not set"):
                await ask(command, {})
        assert harness.engine.status().state == State.ARMED

    with open_harness(tmp_path, config=MINE) as harness:
        Guard(harness.rig, monkeypatch).allowed = ()
        harness.run(scenario)


def test_a_run_ends_with_the_boards_sentence_before_anything_is_pressed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_harness(tmp_path, config=MINE) as harness:
        Guard(harness.rig, monkeypatch).allowed = ()
        harness.run(until_ended, harness.request())
        run = harness.engine.run
        assert run is not None
        assert (run.outcome, run.status().trials_committed) == ("failed", 0)
        assert run.text.startswith(REFUSED)
    assert "pressing down" not in harness.texts("state")
