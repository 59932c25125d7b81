"""A calibration after the setup: what stays commissioned, and what has to be checked again."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from rigctl.boards.drum_codes import Command
from rigctl.config.rig_config import RigConfig, load_config
from rigctl.config.toml_edit import replace_file
from rigctl.engine.calibrator import edited_rig_file
from rigctl.engine.setup.progress import COMMISSION, PassedStep, note_calibration
from rigctl.engine.setup.setup import Setup
from rigctl.errors import CommandRefused
from tests.engine.setup.simulated_setup import DAY, simulated_setup

SCALE = RigConfig().loadcell.scale_ug_per_count


def after_commissioning(work: Callable[[Setup], Awaitable[None]], path: Path | None = None) -> None:
    """Do ``work`` with a rig whose parts have all passed."""

    async def commissioned(setup: Setup) -> None:
        await setup.commission_without()
        for step in setup.steps:
            setup.progress.passed[step.name] = PassedStep(DAY, "")
        await work(setup)

    with simulated_setup() as setup:
        setup.rig.path = path
        setup.run(commissioned)


def test_a_scale_near_the_one_before_stays_commissioned() -> None:
    async def calibrate(setup: Setup) -> None:
        calibrator = setup.context.calibrator
        remark = await calibrator.save_settings(scale_ug_per_count=round(SCALE * 1.05))
        assert not remark and await calibrator.motion.is_commissioned()

    after_commissioning(calibrate)


@pytest.mark.parametrize("factor", [0.5, 1.2, 2.0, -1.0])
def test_another_scale_has_to_be_commissioned_and_says_so(factor: float) -> None:
    async def calibrate(setup: Setup) -> None:
        calibrator, motion = setup.context.calibrator, setup.context.motion
        remark = await calibrator.save_settings(scale_ug_per_count=round(SCALE * factor))
        assert f"is {factor:.2f} times the one before" in remark and "rigctl setup" in remark
        assert not await motion.is_commissioned()
        await setup.context.motion.poller.drum.command(Command.ARM)
        await setup.context.watch(3.0)
        with pytest.raises(CommandRefused, match="not commissioned for these settings"):
            await setup.context.motion.poller.drum.command(Command.APPROACH)

    after_commissioning(calibrate)


def test_a_board_that_was_not_commissioned_is_not_by_a_calibration() -> None:
    async def calibrate(setup: Setup) -> None:
        assert not await setup.context.calibrator.save_settings(scale_ug_per_count=SCALE + 20)
        assert not await setup.context.motion.is_commissioned()

    with simulated_setup() as setup:
        setup.run(calibrate)


def test_gains_leave_the_board_commissioned() -> None:
    async def calibrate(setup: Setup) -> None:
        assert not await setup.context.calibrator.save_settings(gain_p=9.0, gain_i=20.0)
        assert await setup.context.motion.is_commissioned()

    after_commissioning(calibrate)


def test_a_part_that_changes_the_wires_has_the_board_commissioned_again_and_no_other_part() -> None:
    async def invert(setup: Setup) -> None:
        setup.context.rig.faults.wire("end switches normally open")
        assert not (await setup.check("ends")).passed
        await setup.keep("ends")
        assert setup.next is not None and setup.next.name == COMMISSION

    after_commissioning(invert)


def test_the_setup_goes_on_with_nothing_after_a_calibration_that_it_agrees_with(
    tmp_path: Path,
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("# Mine.\n")

    async def weigh(setup: Setup) -> None:
        setup.context.kept.clear()
        setup.context.keep("loadcell", {"scale_ug_per_count": SCALE, "calibrated": DAY})
        kept = {table: dict(keys) for table, keys in setup.context.kept.items()}
        setup.progress.passed["scale"] = PassedStep(DAY, "", kept)
        setup.progress.save(setup.context.rig.drum.identity)
        keys = {"scale_ug_per_count": SCALE + 20, "calibrated": "later"}
        replace_file(path, edited_rig_file(path, "loadcell", keys))
        setup.context.rig.config = load_config(path)
        assert "scale: rig.toml says" in setup.context.progress().remarks[0]
        note_calibration(path, "loadcell", keys)
        progress = setup.context.progress()
        assert not progress.remarks and "scale" in progress.passed

    after_commissioning(weigh, path)


def test_a_sign_that_one_part_kept_agrees_with_the_scale_that_a_later_one_weighs(
    tmp_path: Path,
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("# Mine.\n")

    async def steps(setup: Setup) -> None:
        while (step := setup.next) is not None and step.name != "actuator":
            if not (await setup.check(step.name)).passed:
                assert await setup.keep(step.name) == f"scale_ug_per_count = {-SCALE}"
        assert not setup.context.progress().remarks

    with simulated_setup("cell reversed") as setup:
        setup.rig.path = path
        setup.run(steps)
        assert load_config(path).loadcell.scale_ug_per_count < 0


def test_a_calibration_without_a_setup_leaves_no_file(tmp_path: Path) -> None:
    note_calibration(tmp_path / "rig.toml", "loadcell", {"scale_ug_per_count": SCALE})
    assert not list(tmp_path.iterdir())
