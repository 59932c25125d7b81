"""Jogging the lifted drum by millimetres of texture, on both kinds of boards."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import State
from rigctl.config.rig_config import DrumGeometry, RigConfig
from rigctl.engine.motion import DrumMotion
from rigctl.engine.poller import DrumPoller
from rigctl.engine.settings import jog_target_steps
from rigctl.errors import CommandRefused, WrongUse
from tests.contract.operator import Operator

STEP_MM = 0.03125
FORWARDS, BACKWARDS = RigConfig(), RigConfig(drum=DrumGeometry(backwards=True))

Work = Callable[[DrumMotion], Awaitable[None]]


def turned_mm(operator: Operator) -> float:
    """Return the travel of the texture since power-up, from the ground truth."""
    return float(operator.simulation.truth.arrays().speed_mm_s.sum()) * 1e-3


def by_hand(operator: Operator, work: Work, config: RigConfig = FORWARDS) -> None:
    """Do ``work`` with the drum armed and polled as in the engine."""

    async def main() -> None:
        await operator.reach(State.ARMED)
        poller = DrumPoller(operator.drum, operator.rig.loop)
        await poller.connect()
        polling = asyncio.ensure_future(poller.run())
        try:
            await poller.wait_cycle()
            await work(DrumMotion(poller, config))
        finally:
            polling.cancel()
            await asyncio.gather(polling, return_exceptions=True)

    operator.run(main())


@pytest.mark.parametrize("config", [FORWARDS, BACKWARDS], ids=["forwards", "backwards"])
def test_a_jog_turns_by_the_requested_travel_and_reports_it(
    operator: Operator, config: RigConfig
) -> None:
    sign = -1 if config.drum.backwards else 1

    async def work(motion: DrumMotion) -> None:
        for mm in (10.0, 1.0, -1.0, -10.0, 123.4):
            before_mm = turned_mm(operator)
            assert await motion.jog(mm) == pytest.approx(mm, abs=STEP_MM)
            await motion.poller.wait_cycle()
            assert sign * (turned_mm(operator) - before_mm) == pytest.approx(mm, abs=STEP_MM)

    by_hand(operator, work, config)


def test_a_jog_stays_within_one_turn_and_the_boards_limits(operator: Operator) -> None:
    async def work(motion: DrumMotion) -> None:
        for mm in (401.0, -401.0, float("nan")):
            with pytest.raises(WrongUse, match="more than a turn"):
                await motion.jog(mm)
        assert await motion.jog(0.01) == 0.0

    by_hand(operator, work)


def test_a_jog_is_refused_with_a_sentence_unless_armed(operator: Operator) -> None:
    async def work(motion: DrumMotion) -> None:
        for command, state, words in (
            (Command.TARE, State.ARMED, ""),
            (Command.APPROACH, State.HOLD, "in contact"),
            (Command.RETRACT, State.ARMED, ""),
            (Command.DISARM, State.IDLE, "the drum is 'off'"),
        ):
            await motion.reach(command, state, 15, command.name)
            if words:
                with pytest.raises(
                    CommandRefused, match=f"{words}.*only while it is armed and lifted"
                ):
                    await motion.jog(1.0)

    by_hand(operator, work)


def test_a_stop_ends_a_jog(operator: Operator) -> None:
    async def work(motion: DrumMotion) -> None:
        before_mm = turned_mm(operator)
        jogging = asyncio.ensure_future(motion.jog(300.0))
        await motion.poller.wait_until(lambda now: now.speed_mm_s > 100, 5, "getting going")
        await motion.poller.drum.stop()
        moved_mm = await jogging
        assert 0 < moved_mm < 200
        await motion.poller.wait_cycle()
        assert motion.poller.healthy_state().state == State.ARMED
        assert turned_mm(operator) - before_mm == pytest.approx(moved_mm, abs=STEP_MM)

    by_hand(operator, work)


def test_the_target_stays_within_the_registers_limits() -> None:
    most = BY_NAME["move_target"].high
    drum = FORWARDS.drum
    assert jog_target_steps(most - 10, 10.0, drum, STEP_MM) == most
    assert jog_target_steps(10 - most, -10.0, drum, STEP_MM) == -most
    assert jog_target_steps(0, 1.0, BACKWARDS.drum, STEP_MM) == -32
