"""The drum, lifted, through two turns: its motor, its direction, its mark, its steps."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rigctl.boards.drum_codes import Status
from rigctl.engine.contact import has_status
from rigctl.engine.setup.check_result import CheckResult, Question, Remedy
from rigctl.engine.setup.context import SetupContext
from rigctl.values import Block, DrumState

TURNS = 2
TURN_MM_S = 80.0
MAX_LOST_STEPS = 4
BACK_TURNS = 1
FORWARD, BACKWARD, STOOD = "with the arrow", "against the arrow", "not at all"

MARK_DRUM = Question(
    "mark_drum",
    "Stick a piece of tape on the drum's rim beside something that stands still. The drum lifts "
    "and turns after your answer: count its turns.",
)
COUNT_TURNS = Question(
    "count_turns",
    "How many turns did the drum make? Count quarters too, such as 0.5.",
    (),
    "turns",
    0,
    64,
)
WHICH_WAY = Question(
    "which_way_drum",
    "Which way did its surface move over the sensor, compared with the arrow “forward” of the "
    "drawing?",
    (FORWARD, BACKWARD, STOOD),
)
WATCH_BACK = Question("mark_drum", "After your answer it turns back by one turn.")
CAME_BACK = Question("which_way_drum", "Which way did it turn now?", (FORWARD, BACKWARD, STOOD))


class TurnReadings(NamedTuple):
    """What the boards and a person saw of :data:`TURNS` commanded turns, and of one back.

    ``marks``, ``uno_marks``: index marks that the drum's and the taxel board counted.
    ``mark_share``: the share of polls in which the mark's sensor said that it sees the mark.
    """

    marks: int
    uno_marks: int
    mark_share: float
    turns: float
    seen: str
    seen_back: str = BACKWARD
    lost_steps: int = 0


async def check_turn(context: SetupContext) -> CheckResult:
    """Turn the lifted drum, count turns and marks, then home and count steps over a turn."""
    await context.clear()
    await context.ask(MARK_DRUM)
    readings = await _watched_turns(context)
    signals, inverted = context.rig.config.signals, context.rig.config.inverted
    result = judge_turn(readings, signals.index, inverted.index)
    if result.passed and signals.index:
        lost = await _lost_steps(context)
        result = judge_turn(readings._replace(lost_steps=lost), True, inverted.index)
    return result


async def _watched_turns(context: SetupContext) -> TurnReadings:
    """Turn forwards and back; a person watches."""
    polls, blocks = list[DrumState](), list[Block]()
    await context.motion.arm()
    ends = (
        context.motion.poller.subscribe(polls.append),
        context.rig.taxels.on_block(blocks.append),
    )
    try:
        await context.motion.turn(TURN_MM_S, TURNS)
    finally:
        for end in ends:
            end()
    await context.motion.disarm()
    turns = await context.number(COUNT_TURNS)
    seen = await context.ask(WHICH_WAY) if turns else STOOD
    back = await _seen_back(context) if turns else STOOD
    marks = count_marks(polls)
    return TurnReadings(marks, _uno_marks(blocks), _mark_share(polls), turns, seen, back)


async def _seen_back(context: SetupContext) -> str:
    await context.ask(WATCH_BACK)
    await context.motion.arm()
    await context.motion.turn(TURN_MM_S, -BACK_TURNS)
    await context.motion.disarm()
    return await context.ask(CAME_BACK)


def _uno_marks(blocks: Sequence[Block]) -> int:
    """Return the marks that the taxel board has counted; they come modulo 4."""
    if not blocks:
        return 0
    counts = np.concatenate([block.edges for block in blocks]) >> 2 & 3
    return int((np.diff(counts.astype(int)) % 4).sum())


async def _lost_steps(context: SetupContext) -> int:
    await context.motion.arm()
    await context.motion.home()
    await context.motion.turn(TURN_MM_S, 1)
    return await context.motion.index_error_steps()


def count_marks(polls: Sequence[DrumState]) -> int:
    """Return the marks that were seen in the course of these polls."""
    counts = [int(poll.values["index_count"]) for poll in polls]
    return sum((after - before) % 65536 for before, after in pairwise(counts))


def _mark_share(polls: Sequence[DrumState]) -> float:
    high = [has_status(poll, Status.INDEX_HIGH) for poll in polls]
    return sum(high) / max(1, len(high))


def judge_turn(
    seen: TurnReadings, has_index: bool = True, is_inverted: bool = False
) -> CheckResult:
    """Judge motor, direction, mark and steps by :data:`TURNS` commanded turns."""
    expected, found = f"{TURNS} turns {FORWARD}", f"{seen.turns:g} turns {seen.seen}"
    if has_index:
        expected += f", {TURNS} marks, less than half of the way"
        found += f", {seen.marks} marks, {seen.mark_share * 100:.0f} % of the way"
    problem, causes, remedy = _turn_problem(seen, has_index, is_inverted)
    return CheckResult(expected, found, problem, causes, remedy)


def _turn_problem(
    seen: TurnReadings, has_index: bool, is_inverted: bool
) -> tuple[str, tuple[str, ...], Remedy | None]:
    if seen.turns < 0.25:
        return (
            "the drum did not turn: its driver has no supply, is switched off when it should be "
            "on (an enable that is open or the other way round), gets no STEP, or its coils are "
            "crossed, which all look alike; arm the drum and turn it by hand: if it is held, "
            "check STEP (D11) and that each coil's two wires are a pair by the meter, else the "
            "supply and the enable (D23)",
            (
                "motor supply missing",
                "stepper enable inverted",
                "stepper enable unplugged",
                "step unplugged",
                "stepper coils crossed",
                "stepper unplugged",
            ),
            None,
        )
    if abs(seen.turns - TURNS) > 0.2:
        return (
            f"the drum turned {seen.turns / TURNS:.2g} times as far as commanded: its driver is "
            "set to other microsteps than arduino/drum/board.h, or the belt has another ratio, "
            "which look alike; read the driver's switches, and count the teeth of both pulleys: "
            "what differs from board.h is it, so set the switches, or MICROSTEPS and "
            "STEPS_PER_TURN there, and flash",
            ("8 microsteps", "32 microsteps", "belt 2:1", "belt 3:1"),
            None,
        )
    if seen.seen == seen.seen_back:
        return (
            f"the drum turns {seen.seen} both ways: the driver's DIR wire from D22 is open; "
            "connect it",
            ("direction stuck",),
            None,
        )
    if seen.seen == BACKWARD:
        return (
            "the drum turns backwards: two wires of one coil are swapped or DIR is inverted, "
            "which no sensor tells apart and either of which is mended alike; swap the two wires "
            "of one coil, or let rig.toml say [drum] backwards = true",
            ("stepper coil reversed", "direction reversed"),
            Remedy("drum", {"backwards": True}, "[drum] backwards = true"),
        )
    if not has_index:
        return "", (), None
    if seen.marks and seen.mark_share > 0.5:
        text = f"[inverted] index = {str(not is_inverted).lower()}"
        return (
            "the mark's sensor says “mark” for most of the turn: it switches the other way round; "
            f"use its other output, or let rig.toml say {text}",
            ("index inverted",),
            Remedy("inverted", {"index": not is_inverted}, text),
        )
    return _mark_problem(seen)


def _mark_problem(seen: TurnReadings) -> tuple[str, tuple[str, ...], Remedy | None]:
    if seen.marks == 0:
        return (
            "the drum turned and no mark was seen: the sensor's wire to D2 is off, or it never "
            "sees its mark, which read alike; hold the mark to the sensor: if its lamp changes, "
            "check the wire, else bring it nearer, or set [signals] index = false for a drum "
            "without one",
            ("index missing", "index stuck low"),
            None,
        )
    if seen.marks != TURNS:
        return (
            f"{seen.marks} marks in {TURNS} turns instead of one a turn: a second mark or a screw "
            "passes the sensor, or its edge chatters; cover all but one, and bring the sensor "
            "within 2 mm of it",
            ("index twice a turn",),
            None,
        )
    if seen.uno_marks != TURNS:
        return (
            f"the taxel board saw {seen.uno_marks} of {TURNS} marks: connect the index sensor with "
            "the Uno's D9 too, and GND with GND",
            ("index at Uno missing",),
            None,
        )
    if abs(seen.lost_steps) > MAX_LOST_STEPS:
        return (
            f"{seen.lost_steps} steps are missing from mark to mark: the motor slips; raise its "
            "driver's current, check the belt, and lower [drum] acceleration_mm_s2",
            (),
            None,
        )
    return "", (), None
