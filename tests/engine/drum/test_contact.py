"""A drum that an E-stop leaves on the sensor says so, and every refusal gives its reason."""

from __future__ import annotations

import pytest

from rigctl.boards.drum_states import State
from rigctl.engine import motion
from rigctl.errors import CommandRefused, WrongUse
from tests.engine.engine_harness import EngineHarness

LIFT = "off and still in contact with the sensor: arm it, which lifts it off"


async def press(harness: EngineHarness) -> None:
    """Press until the drum holds the force."""
    for command in ("arm", "tare", "approach"):
        await harness.handle(command, {})


async def press_and_release_estop(harness: EngineHarness) -> None:
    """Switch the pressing drum off by its E-stop."""
    await harness.handle("inject", {"fault": "press_estop"})
    await harness.until(lambda: harness.engine.status().state is State.FAULT_OFF)
    await harness.handle("inject", {"fault": "release_estop"})
    await harness.wait(0.2)


async def test_contact_after_an_estop_is_in_state_and_events_until_the_drum_is_lifted(
    harness: EngineHarness,
) -> None:
    handle, status = harness.handle, harness.engine.status
    assert status().state_words == "off, it may rest on the sensor"
    await press(harness)
    assert harness.texts("contact") == [] and "still" not in status().state_words
    await press_and_release_estop(harness)
    assert status().contact_may_stand
    assert status().state_words == "fault: switched off, still in contact with the sensor"
    assert harness.texts("contact")[0].endswith("clear the fault, then arm it, which lifts it off")
    await handle("clear_fault", {})
    await harness.wait(0.2)
    assert status().state_words == "off, still in contact with the sensor"
    assert LIFT in harness.texts("contact")[1]
    with pytest.raises(CommandRefused, match=r"refused TARE .*arm it or retract, so that it lifts"):
        await handle("tare", {})
    with pytest.raises(WrongUse, match="in contact: lift the drum first"):
        await handle("plate", {"texture": "K"})
    await handle("arm", {})
    await handle("disarm", {})
    assert status().state_words == "off" and not status().contact_may_stand
    assert len(harness.texts("contact")) == 2


async def test_every_refusal_of_a_move_gives_its_reason(harness: EngineHarness) -> None:
    with pytest.raises(CommandRefused, match="possible in ARMED only: arm the drum first"):
        await harness.handle("home", {})
    await press(harness)
    with pytest.raises(CommandRefused, match="possible in IDLE or ARMED only"):
        await harness.handle("tare", {})
    with pytest.raises(WrongUse, match="plate cannot change while the drum is in contact"):
        await harness.handle("plate", {"texture": "K"})
    await harness.handle("set", {"speed_mm_s": 150, "run_in_mm": 1})
    with pytest.raises(CommandRefused, match="run-in is too short for this speed: lower"):
        await harness.handle("run", {})


def test_a_tare_that_the_board_gives_up_is_refused(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motion, "TARE_TIMEOUT_S", 30.0)

    async def scenario(harness: EngineHarness) -> None:
        await harness.handle("arm", {})
        harness.engine.spawn(swing(harness))
        with pytest.raises(CommandRefused, match="tare failed, and the zero is as before"):
            await harness.handle("tare", {})
        assert not harness.engine.status().tared

    async def swing(harness: EngineHarness) -> None:
        while not harness.has_ended():
            for force_g in (0.0, 40.0):
                await harness.handle("inject", {"fault": "push", "force_g": force_g})
                await harness.wait(0.1)

    harness.run(scenario)


async def test_the_plate_of_a_simulated_rig_and_the_limits_are_in_the_status(
    harness: EngineHarness,
) -> None:
    assert harness.engine.status().texture == "A"
    await harness.handle("plate", {"texture": "K"})
    assert harness.engine.status().texture == "K"
    assert harness.engine.status().limits == harness.rig.config.limits


async def test_the_age_of_the_load_cell_grows_while_the_drum_still_answers(
    harness: EngineHarness,
) -> None:
    await harness.wait(1)
    age_s = harness.engine.status().loadcell_age_s
    assert age_s is not None and age_s < 0.1
    await harness.handle("inject", {"fault": "loadcell_silent", "on": True})
    await harness.wait(2)
    age_s, poll_age_s = (
        harness.engine.status().loadcell_age_s,
        harness.engine.status().poll_age_s,
    )
    assert age_s is not None and age_s > 1.5
    assert poll_age_s is not None and poll_age_s < 0.1
