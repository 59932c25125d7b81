"""Worked example: a vertical axis by step and direction is one file, and none of ours.

The package is ``tests/drivers/step_axis``. The axis moves while the drum is off and lifted; all
else stops it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rigctl.config.rig_config import parse_config
from rigctl.errors import CommandRefused, ConfigError, RigFault, WrongUse
from rigctl.exchange.export.selection import Representation, Selection
from rigctl.rig import open_rig
from rigctl.session.session import Session
from rigctl.values import PluginUse
from tests.engine.engine_harness import EngineHarness, engine_on
from tests.exchange.export.conftest import export

AXIS = '[axis]\ndriver = "step-axis"\nlow_mm = 0\nhigh_mm = 40\n'


@pytest.fixture
def harness(examples: Path, tmp_path: Path) -> Iterator[EngineHarness]:
    """Yield an engine on the virtual rig with that axis."""
    rig = open_rig("virtual", seed=3, paced=False, config=parse_config(AXIS))
    with engine_on(rig, tmp_path) as harness:
        yield harness


async def lift(harness: EngineHarness) -> None:
    """Arm and switch off: only then is it known that nothing is pressed."""
    await harness.handle("arm", {})
    await harness.handle("disarm", {})


def test_its_heights_are_recorded_shown_and_exported(
    harness: EngineHarness, tmp_path: Path
) -> None:
    async def move(harness: EngineHarness) -> None:
        await lift(harness)
        assert await harness.handle("axis", {"height_mm": 12.5}) == {"height_mm": 12.5}
        await harness.handle("record", {"out": str(harness.session)})
        await harness.handle("axis", {"height_mm": 14})
        await harness.handle("end_record", {})
        assert harness.engine.status().axis_mm == 14.0

    harness.run(move)
    with Session.open(harness.session) as session:
        assert session.header.plugins == (
            PluginUse("actuator", "step-axis", "rigctl-step-axis", "0.3.1", 12.5),
        )
    readings = Selection(representations=(Representation.READINGS,))
    export(harness.session, "csv", tmp_path / "csv", readings)
    assert "the axis is at 14.0 mm" in (tmp_path / "csv" / "events.csv").read_text("utf-8")


def test_a_run_goes_on_as_without_it(harness: EngineHarness) -> None:
    assert harness.record().outcome == "done"
    with Session.open(harness.session) as session:
        assert session.header.plugins[0].height_mm == 0.0


REFUSED: list[tuple[str, float, str]] = [
    ("arm", 5, "the drum is not off"),
    ("", 41, r"41 mm is outside \[axis\] of rig.toml, 0 to 40 mm"),
]


@pytest.mark.parametrize(("first", "height_mm", "reason"), REFUSED)
def test_a_move_is_refused(
    harness: EngineHarness, first: str, height_mm: float, reason: str
) -> None:
    async def move(harness: EngineHarness) -> None:
        await lift(harness)
        if first:
            await harness.handle(first, {})
        with pytest.raises(WrongUse, match=reason):
            await harness.handle("axis", {"height_mm": height_mm})
        assert harness.engine.status().axis_mm == 0.0

    harness.run(move)


def test_a_drum_that_may_rest_on_the_sensor_keeps_it_still(harness: EngineHarness) -> None:
    async def move(harness: EngineHarness) -> None:
        with pytest.raises(WrongUse, match="it may rest on the sensor: arm the drum"):
            await harness.handle("axis", {"height_mm": 5})

    harness.run(move)


async def stop(harness: EngineHarness) -> None:
    await harness.engine.send_stop("stopped by the test")


async def touch(harness: EngineHarness) -> None:
    harness.rig.faults.push(80.0)


STOPS: list[tuple[Any, type[Exception], str]] = [
    (stop, RigFault, "stopped"),
    (touch, RigFault, "the load cell changed by 79 g while the axis moved, and it was stopped"),
]


@pytest.mark.parametrize(("trouble", "error", "reason"), STOPS)
def test_a_stop_and_a_touch_stop_it(
    harness: EngineHarness, trouble: Any, error: type[Exception], reason: str
) -> None:
    async def move(harness: EngineHarness) -> None:
        await lift(harness)
        moving = asyncio.ensure_future(harness.handle("axis", {"height_mm": 30}))
        await harness.wait(1.0)
        for command, args in (("jog", {"mm": 1}), ("approach", {}), ("start", {})):
            with pytest.raises((WrongUse, CommandRefused)):
                await harness.handle(command, args)
        await trouble(harness)
        with pytest.raises(error, match=reason):
            await moving
        stands_mm = harness.engine.status().axis_mm
        await harness.wait(1.0)
        assert stands_mm is not None and 8 < stands_mm < 14
        assert harness.engine.status().axis_mm == stands_mm

    harness.run(move)


def test_a_driver_that_fails_to_stop_does_not_keep_the_drum_from_it(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    axis = harness.rig.axis
    assert axis is not None

    def fail() -> None:
        raise KeyError("no such relay")

    async def move(harness: EngineHarness) -> None:
        await lift(harness)
        await harness.handle("arm", {})
        with monkeypatch.context() as patch:
            patch.setattr(axis._actuator, "stop", fail)
            await harness.engine.send_stop("stopped by the test")
            await harness.wait(1.0)

    harness.run(move)
    said = [event.text for event in harness.events if event.kind == "fault"]
    assert said == [
        "actuator step-axis of rigctl-step-axis 0.3.1 failed (KeyError: 'no such relay'): install "
        "another version of rigctl-step-axis, or ask its author"
    ]
    assert any(event.kind == "stop" for event in harness.events)


def test_limits_that_leave_no_way_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"axis.low_mm.* must be below high_mm"):
        parse_config('[axis]\ndriver = "step-axis"\n')
