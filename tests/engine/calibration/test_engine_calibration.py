"""Calibrations through an engine on the virtual rig: measured, refused, cancelled, saved."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.boards.drum_states import State
from rigctl.config.rig_config import LoadCell, RigConfig, load_config
from rigctl.engine.calibration_values import LEAST_RATIO, TaxelRange
from rigctl.engine.rig_boards import RELEASE_S
from rigctl.engine.rpc.messages import (
    as_dict,
    decode_message,
    encode_message,
    parse_status,
)
from rigctl.errors import CommandRefused, DiskFault, RigFault, WrongUse
from rigctl.values import DRAWN_WIRING
from tests.engine.engine_harness import EngineHarness, open_harness

Handle = Callable[[str, dict[str, Any]], Awaitable[dict[str, Any]]]
RIDGED = "B"
"""Under a smooth plate some taxels carry too little for a range."""
BENCH_FILE = "# Mine.\n[loadcell]\nscale_ug_per_count = 2000  # old\n"


@pytest.fixture
def harness(tmp_path: Path) -> Iterator[EngineHarness]:
    with open_harness(tmp_path) as opened:
        yield opened


def play(harness: EngineHarness, scenario: Callable[[Handle], Awaitable[None]]) -> None:
    """Run a scenario with what executes the clients' commands."""

    async def act(harness: EngineHarness) -> None:
        await scenario(harness.handle)

    harness.run(act)


def state_of(harness: EngineHarness) -> State | None:
    return harness.engine.status().state


def test_masses_one_after_another_give_a_scale_that_is_saved(
    harness: EngineHarness, tmp_path: Path
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(BENCH_FILE)
    harness.rig.path = path

    async def scenario(handle: Handle) -> None:
        with pytest.raises(WrongUse, match="without a mass first"):
            await handle("calibrate_loadcell", {"mass_g": 200})
        for mass_g in (0, 200, 500):
            reading = await handle("calibrate_loadcell", {"mass_g": mass_g})
            assert reading["mass_g"] == mass_g and reading["sd_counts"] < 1000
        found = harness.engine.status().calibration
        assert [reading.mass_g for reading in found.masses] == [0, 200, 500]
        assert found.scale_ug_per_count == pytest.approx(2400, rel=0.005)
        assert state_of(harness) is State.IDLE
        saved = await handle("save_calibration", {"part": "loadcell"})
        assert saved["kept_in"] == ["the board's EEPROM", str(path)]

    play(harness, scenario)
    status = harness.engine.status()
    assert status.loadcell_calibrated == "2026-01-02 with 200 g, 500 g"
    assert load_config(path).loadcell.scale_ug_per_count == status.scale_ug_per_count
    assert path.read_text().startswith("# Mine.\n[loadcell]\n")
    assert status.calibration.saved == {"loadcell": f"the board's EEPROM and {path}"}


def test_the_drum_arms_with_the_scale_that_was_found(tmp_path: Path) -> None:
    """Arming writes the rig's settings again: those of before would undo the calibration."""
    config = RigConfig(loadcell=LoadCell(scale_ug_per_count=2000))

    async def scenario(handle: Handle) -> None:
        for mass_g in (0, 300):
            await handle("calibrate_loadcell", {"mass_g": mass_g})
        await handle("save_calibration", {"part": "loadcell"})
        await handle("arm", {})
        found = await harness.rig.drum.get("scale_ug_per_count")
        assert found["scale_ug_per_count"] == pytest.approx(2400, rel=0.005)

    with open_harness(tmp_path, config=config) as harness:
        play(harness, scenario)


def test_an_implausible_scale_is_refused_until_the_reading_is_removed(
    harness: EngineHarness,
) -> None:
    async def scenario(handle: Handle) -> None:
        for mass_g in (0, 200, 500):
            await handle("calibrate_loadcell", {"mass_g": mass_g})
        calibration = harness.engine.calibration
        wrong = calibration._masses.readings[2]._replace(mass_g=900.0)
        calibration._masses.add(wrong)  # as if 500 g had been called 900 g
        assert "not proportional to the masses" in calibration.status().scale_problem
        with pytest.raises(WrongUse, match="not proportional to the masses"):
            await handle("save_calibration", {"part": "loadcell"})
        await handle("forget_mass", {"mass_g": 900})
        assert calibration.status().scale_problem == ""
        await handle("save_calibration", {"part": "loadcell"})

    play(harness, scenario)


def test_gains_and_imbalance_are_found_and_leave_the_drum_off(harness: EngineHarness) -> None:
    async def scenario(handle: Handle) -> None:
        measurement, begun_s = harness.engine.calibration.measurement, harness.rig.loop.time()
        measuring = asyncio.ensure_future(handle("calibrate_force", {"force_g": 400}))
        await harness.wait(1)
        usual_s = harness.engine.status().calibration.usual_s
        gains = await measuring
        assert harness.rig.loop.time() - begun_s == pytest.approx(usual_s, abs=4)
        assert measurement.usual_s == 0
        assert gains["gain_p_per_s"] == pytest.approx(7.5, abs=3.5)
        assert state_of(harness) is State.IDLE
        begun_s = harness.rig.loop.time()
        measuring = asyncio.ensure_future(handle("calibrate_imbalance", {}))
        await harness.wait(1)
        usual_s = harness.engine.status().calibration.usual_s
        table_g = (await measuring)["table_g"]
        assert harness.rig.loop.time() - begun_s == pytest.approx(usual_s, abs=4)
        assert (max(table_g) - min(table_g)) / 2 == pytest.approx(1.0, abs=0.3)
        assert state_of(harness) is State.IDLE
        assert await handle("save_calibration", {"part": "force"}) == {
            "part": "force", "kept_in": ["the board's EEPROM"], "remark": "",
        }  # fmt: skip
        assert harness.rig.config.actuator.gain_p_per_s == gains["gain_p_per_s"]
        await handle("save_calibration", {"part": "imbalance"})
        with pytest.raises(WrongUse, match="this rig presses with 50 to 1200 g"):
            await handle("calibrate_force", {"force_g": 5000})

    play(harness, scenario)


@pytest.mark.parametrize("ending", ["cancel_calibration", "stop"])
@pytest.mark.parametrize("state", [State.APPROACH, State.HOLD])
def test_a_calibration_ends_at_any_moment_with_the_drum_lifted_and_off(
    harness: EngineHarness, ending: str, state: State
) -> None:
    async def scenario(handle: Handle) -> None:
        tuning = asyncio.ensure_future(handle("calibrate_force", {}))
        await harness.until(lambda: state_of(harness) is state)
        with pytest.raises(WrongUse, match="a calibration measures now"):
            await handle("arm", {})
        with pytest.raises(WrongUse, match="a calibration measures now"):
            await handle("start", {"protocol": "paper", "out": str(harness.session)})
        await handle(ending, {})
        with pytest.raises(CommandRefused, match=r"cancelled|interrupted"):
            await tuning
        assert state_of(harness) is State.IDLE
        status = harness.engine.status()
        assert not status.calibration.measuring and not status.is_moved_by_hand
        await handle("arm", {})

    play(harness, scenario)


@pytest.mark.parametrize(
    ("command", "args"),
    [
        ("calibrate_loadcell", {"mass_g": 0}),
        ("calibrate_force", {}),
        ("calibrate_imbalance", {}),
        ("calibrate_wiring", {}),
    ],
)
def test_a_calibration_never_ends_a_held_force(
    harness: EngineHarness, command: str, args: dict[str, Any]
) -> None:
    async def scenario(handle: Handle) -> None:
        for name in ("arm", "tare", "home", "approach"):
            await handle(name, {})
        with pytest.raises(CommandRefused, match="presses on the sensor: retract it, then"):
            await handle(command, args)
        assert state_of(harness) is State.HOLD

    play(harness, scenario)


def test_saving_never_ends_a_held_force(harness: EngineHarness) -> None:
    async def scenario(handle: Handle) -> None:
        for mass_g in (0, 300):
            await handle("calibrate_loadcell", {"mass_g": mass_g})
        for name in ("arm", "tare", "home", "approach"):
            await handle(name, {})
        with pytest.raises(CommandRefused, match="presses on the sensor: retract it, then"):
            await handle("save_calibration", {"part": "loadcell"})
        assert state_of(harness) is State.HOLD

    play(harness, scenario)


def test_an_unwritable_rig_file_is_named_and_the_board_keeps_what_it_has(
    harness: EngineHarness, tmp_path: Path
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(BENCH_FILE)
    harness.rig.path = path
    obstacle = tmp_path / "rig.toml.partial"
    obstacle.mkdir()  # nothing can be written beside the file

    async def scenario(handle: Handle) -> None:
        for mass_g in (0, 300):
            await handle("calibrate_loadcell", {"mass_g": mass_g})
        with pytest.raises(DiskFault, match=r"rig\.toml cannot be written .*EEPROM has the new"):
            await handle("save_calibration", {"part": "loadcell"})
        assert path.read_text() == BENCH_FILE
        status = harness.engine.status()
        assert status.calibration.saved == {} and status.scale_ug_per_count != 2000
        await handle("arm", {})
        found = await harness.rig.drum.get("scale_ug_per_count")
        assert found["scale_ug_per_count"] == status.scale_ug_per_count
        obstacle.rmdir()
        await handle("save_calibration", {"part": "loadcell"})
        assert load_config(path).loadcell.scale_ug_per_count == status.scale_ug_per_count

    play(harness, scenario)


async def _tare_places(harness: EngineHarness) -> list[float]:
    names = [f"tare_place_{place:02}" for place in range(16)]
    return list((await harness.rig.drum.get(*names)).values())


def test_the_imbalance_is_saved_after_a_restart_of_the_board_and_forgotten_by_it(
    harness: EngineHarness,
) -> None:
    async def scenario(handle: Handle) -> None:
        before = await _tare_places(harness)
        for _ in range(2):
            await handle("calibrate_imbalance", {})
        assert await _tare_places(harness) != before
        await handle("discard_calibration", {"part": "imbalance"})
        assert await _tare_places(harness) == before and state_of(harness) is State.IDLE
        await handle("calibrate_imbalance", {})
        measured = await _tare_places(harness)
        harness.rig.faults.reset("drum")
        await harness.wait(5)
        assert await _tare_places(harness) == before
        await handle("save_calibration", {"part": "imbalance"})
        assert await _tare_places(harness) == measured
        await handle("discard_calibration", {"part": "imbalance"})
        assert await _tare_places(harness) == measured

    play(harness, scenario)


def test_a_reading_and_a_turn_can_be_cancelled(harness: EngineHarness) -> None:
    async def scenario(handle: Handle) -> None:
        for command, args in (("calibrate_loadcell", {"mass_g": 0}), ("calibrate_imbalance", {})):
            measuring = asyncio.ensure_future(handle(command, args))
            await harness.wait(1)
            assert not measuring.done()
            await handle("cancel_calibration", {})
            with pytest.raises(CommandRefused, match="the calibration was cancelled"):
                await measuring
            assert state_of(harness) is State.IDLE
        assert not harness.engine.status().calibration.masses

    play(harness, scenario)


async def _identify(handle: Handle, harness: EngineHarness) -> list[str]:
    """Take every step of the identification; return what was asked."""
    asked = []
    while question := harness.engine.status().calibration.wiring_question:
        asked.append(question)
        await handle("calibrate_wiring", {})
    return asked


def test_the_taxels_of_the_virtual_sensor_are_identified_as_drawn(harness: EngineHarness) -> None:
    async def scenario(handle: Handle) -> None:
        assert not harness.engine.status().has_taxel_order
        await harness.wait(1)
        high = harness.engine.boards.encoder.normalisation.high.astype(int)
        asked = await _identify(handle, harness)
        assert len(asked) == 12 and asked[0].startswith("Unplug")
        assert asked[-1].startswith("Press row 3, column 3")
        with pytest.raises(WrongUse, match=r"a simulated rig has no rig\.toml"):
            await handle("save_calibration", {"part": "wiring"})
        await handle("discard_calibration", {"part": "wiring"})
        assert harness.engine.status().calibration.wiring_step == 0
        await harness.wait(1)
        now = harness.engine.boards.encoder.normalisation.high
        assert (now - high).max() < 5, "but for noise it is the range from before"
        await harness.wait(RELEASE_S)
        await handle("set", {"force_g": 1000})
        for command in ("arm", "tare", "home", "approach"):
            await handle(command, {})
        now = harness.engine.boards.encoder.normalisation.high
        assert (now - high).max() > 20, "the range follows what the drum does"

    play(harness, scenario)


def test_the_order_of_a_bench_is_saved_and_a_press_is_repeated(
    harness: EngineHarness, tmp_path: Path
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("")
    harness.rig.path = path

    async def scenario(handle: Handle) -> None:
        with pytest.raises(WrongUse, match="no place has been pressed"):
            await handle("repeat_press", {})
        await _identify(handle, harness)
        await handle("repeat_press", {})
        assert harness.engine.status().calibration.wiring_place == 8
        await handle("calibrate_wiring", {})
        assert not harness.engine.status().has_taxel_order, "nothing has it yet"
        saved = await handle("save_calibration", {"part": "wiring"})
        assert saved["kept_in"] == [str(path)] and "connect again" in saved["remark"]
        await handle("discard_calibration", {"part": "wiring"})

    play(harness, scenario)
    assert load_config(path).taxels.wiring == DRAWN_WIRING
    assert harness.engine.status().has_taxel_order


def test_taxels_are_identified_only_while_the_drum_is_off(harness: EngineHarness) -> None:
    async def scenario(handle: Handle) -> None:
        await handle("calibrate_wiring", {})
        await handle("arm", {})
        with pytest.raises(RigFault, match="with the drum lifted and switched off"):
            await handle("calibrate_wiring", {})
        assert state_of(harness) is State.ARMED

    play(harness, scenario)


def test_nothing_is_saved_that_was_not_measured(harness: EngineHarness) -> None:
    async def scenario(handle: Handle) -> None:
        for part in ("force", "imbalance", "wiring"):
            with pytest.raises(WrongUse, match="measure it first"):
                await handle("save_calibration", {"part": part})
        with pytest.raises(WrongUse, match="give each known mass"):
            await handle("save_calibration", {"part": "loadcell"})
        with pytest.raises(WrongUse, match="there is no reading with 7 g"):
            await handle("forget_mass", {"mass_g": 7})

    play(harness, scenario)


def test_clients_get_what_was_measured(harness: EngineHarness) -> None:
    async def scenario(handle: Handle) -> None:
        for mass_g in (0, 300):
            await handle("calibrate_loadcell", {"mass_g": mass_g})
        await handle("calibrate_force", {})
        status = harness.engine.status()
        sent = decode_message(encode_message({"data": as_dict(status)}))
        received = parse_status(sent["data"])
        assert received.calibration == status.calibration
        assert received.loadcell_counts == status.loadcell_counts
        assert received.loadcell_sd_counts is not None

    play(harness, scenario)


def test_the_taxels_ranges_come_from_a_press_over_the_plate(harness: EngineHarness) -> None:
    async def scenario(handle: Handle) -> None:
        boards, states = harness.engine.boards, set()
        boards.drum_poller.subscribe(lambda state: states.add(State(state.state)))
        assert not harness.engine.status().has_taxel_range
        await handle("plate", {"texture": RIDGED})
        found = TaxelRange(**await handle("calibrate_range", {"force_g": 400.0}))
        assert {State.HOLD, State.RUN} <= states and state_of(harness) is State.IDLE
        spans = np.subtract(found.high, found.low)
        assert len(spans) == 18 and np.all(spans >= LEAST_RATIO * np.array(found.rest))
        assert np.array_equal(boards.encoder.normalisation.low, found.low)
        status = harness.engine.status()
        assert status.has_taxel_range and status.calibration.taxel_range == found
        await harness.wait(5)
        assert np.array_equal(boards.encoder.normalisation.high, found.high), "it stays"

    play(harness, scenario)


def test_the_ranges_are_saved_in_the_file_that_the_next_connection_begins_with(
    harness: EngineHarness, tmp_path: Path
) -> None:
    """They were lost with the engine: no session had them, and each day began with a press."""
    path = tmp_path / "rig.toml"
    path.write_text("# Mine.\n[taxels]\npressure_raises = true\n")

    async def scenario(handle: Handle) -> None:
        with pytest.raises(WrongUse, match="measure it first"):
            await handle("save_calibration", {"part": "range"})
        await handle("plate", {"texture": RIDGED})
        found = TaxelRange(**await handle("calibrate_range", {"force_g": 400.0}))
        with pytest.raises(WrongUse, match=r"no rig\.toml: the range is not saved"):
            await handle("save_calibration", {"part": "range"})
        harness.rig.path = path
        assert harness.engine.status().calibration.has_unsaved_range
        saved = await handle("save_calibration", {"part": "range"})
        assert saved["kept_in"] == [str(path)]
        status, taxels = harness.engine.status(), load_config(path).taxels
        assert (taxels.low, taxels.high) == (found.low, found.high)
        assert taxels.range_from == "2026-01-02, a press with 400 g over the plate"
        assert status.range_from == taxels.range_from
        assert not status.calibration.has_unsaved_range
        assert path.read_text().startswith("# Mine.\n[taxels]\npressure_raises = true\n")
        assert harness.rig.config.taxels.low == found.low, "the next session has it"
        await _identify(handle, harness)
        await handle("save_calibration", {"part": "wiring"})
        await handle("calibrate_range", {})
        with pytest.raises(WrongUse, match="the order of the taxels was saved since"):
            await handle("save_calibration", {"part": "range"})

    play(harness, scenario)


def test_ranges_of_a_press_that_does_not_reach_the_taxels_are_not_used(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(handle: Handle) -> None:
        calibrator = harness.engine.calibration._calibrator
        monkeypatch.setattr(calibrator, "press_and_turn", lambda force_g: asyncio.sleep(10))
        with pytest.raises(RigFault, match=r"ranges are not used.*T1 \(.*T18 \(.*Taxel test"):
            await handle("calibrate_range", {})
        seen = harness.engine.status()
        assert not seen.has_taxel_range and seen.calibration.taxel_range is not None
        for force_g in (1.0, 100_000.0):
            with pytest.raises(WrongUse, match="this rig presses with"):
                await handle("calibrate_range", {"force_g": force_g})

    play(harness, scenario)


def test_a_stop_ends_the_press_for_the_ranges(harness: EngineHarness) -> None:
    async def scenario(handle: Handle) -> None:
        measuring = asyncio.ensure_future(handle("calibrate_range", {}))
        await harness.until(lambda: state_of(harness) is State.RUN)
        assert harness.engine.status().calibration.measuring == "range"
        await handle("stop", {})
        with pytest.raises(CommandRefused):
            await measuring
        assert state_of(harness) is State.IDLE and not harness.engine.status().has_taxel_range

    play(harness, scenario)
