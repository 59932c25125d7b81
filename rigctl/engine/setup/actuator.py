"""The actuator: nudged both ways while the drum is clear, beside what a person sees."""

from __future__ import annotations

from typing import NamedTuple

from rigctl.boards.drum_states import Fault
from rigctl.engine.setup.check_result import CheckResult, Question, Remedy
from rigctl.engine.setup.context import SetupContext
from rigctl.errors import BoardFault, WrongUse

CLEARANCE_MM = 5.0
NUDGES = 6
"""Each moves about 0.1 mm, so that all together show; less than the clearance either way."""
MOVED_UM = 40
BROKEN_LOW, BROKEN_HIGH = 22, 1000
"""Readings of the potentiometer beyond its series resistors (arduino/drum/board.h)."""
MOST_DUTY = 130
"""Permille at which the rod begins to move, in the mean; an actuator at its full supply needs
about 70."""
UP, DOWN, NOT_AT_ALL = "up", "down", "not at all"
OUT, CLEAR, NEITHER = "out", "clear", "neither"

MAKE_ROOM = Question(
    "make_room",
    f"Take the sensor out, or turn the actuator by hand until the drum is at least "
    f"{CLEARANCE_MM:g} mm clear of it: is the sensor out, or the drum clear?",
    (OUT, CLEAR, NEITHER),
)
WATCH_PRESS = Question(
    "watch_rod",
    "Lay a finger on the actuator's rod: after your answer it moves a little, in small jerks.",
)
WHICH_WAY_PRESS = Question("which_way_rod", "Which way did the drum move?", (UP, DOWN, NOT_AT_ALL))
WATCH_LIFT = Question("watch_rod", "The same once more, the other way.")
WHICH_WAY_LIFT = Question(
    "which_way_rod", "Which way did the drum move now?", (UP, DOWN, NOT_AT_ALL)
)


class Nudge(NamedTuple):
    """What some nudges one way did: the potentiometer's travel, + downwards, and what was seen.

    ``duty``: the mean duty at which they began to move, permille. ``fault``: what ended them.
    """

    travel_um: float
    seen: str
    duty: float = 0.0
    fault: Fault = Fault.NONE

    @property
    def text(self) -> str:
        """What happened in words."""
        travel = f"{self.travel_um / 1000:+.2f}".replace("-", "−")
        return f"{self.seen}, {travel} mm by the potentiometer"


class ActuatorReadings(NamedTuple):
    """The potentiometer's reading at rest, and the nudges that should press and lift."""

    position_raw: int
    press: Nudge
    lift: Nudge


async def check_actuator(context: SetupContext) -> CheckResult:
    """Nudge the actuator downwards and upwards, and ask each time which way it went."""
    has_position = context.rig.config.signals.position
    raw = round((await context.registers("position_raw"))["position_raw"])
    if has_position and not BROKEN_LOW < raw < BROKEN_HIGH:
        return judge_potentiometer(raw)
    if await context.ask(MAKE_ROOM) == NEITHER:
        raise WrongUse(
            f"the actuator may turn out to press when it should lift: take the sensor out, or make "
            f"{CLEARANCE_MM:g} mm of room, then check again"
        )
    press = await _nudge(context, True, (WATCH_PRESS, WHICH_WAY_PRESS))
    lift = await _nudge(context, False, (WATCH_LIFT, WHICH_WAY_LIFT))
    await context.clear()
    seen = ActuatorReadings(raw, press, lift)
    return judge_actuator(seen, has_position, context.rig.config.inverted.position)


async def _nudge(
    context: SetupContext, presses: bool, questions: tuple[Question, Question]
) -> Nudge:
    """Return what some nudges one way do, until a fault ends them."""
    await context.clear()
    await context.ask(questions[0])
    travel_um, duties, fault = 0.0, [0.0], Fault.NONE
    for _ in range(NUDGES):
        try:
            await context.motion.nudge(presses)
        except BoardFault:
            fault = Fault((await context.look()).fault)
        result = await context.registers("nudge_travel_um", "nudge_duty")
        travel_um += result["nudge_travel_um"]
        duties.append(result["nudge_duty"])
        if fault:
            break
    seen = await context.ask(questions[1])
    return Nudge(travel_um, seen, sum(duties) / max(1, len(duties) - 1), fault)


def judge_potentiometer(raw: int) -> CheckResult:
    """Judge a reading of the potentiometer that only a broken or shorted wire gives."""
    expected = f"the potentiometer between {BROKEN_LOW} and {BROKEN_HIGH} of 1023"
    found = f"{raw} of 1023"
    if raw <= BROKEN_LOW:
        return CheckResult(
            expected,
            found,
            "the potentiometer reads ground: its wiper's wire to A0 is open or touches ground, or "
            "the wire from its lower end to 5 V is open, which read alike; measure at A0's plug: "
            "5 kΩ to 5 V means that the wires are whole, and then look for the touch",
            (
                "potentiometer wiper open",
                "potentiometer shorted to ground",
                "potentiometer 5 V end open",
            ),
        )
    return CheckResult(
        expected,
        found,
        "the potentiometer reads 5 V: its wiper's wire to A0 touches 5 V, or the wire from its "
        "upper end to GND is open; measure from A0's plug to GND: 5 kΩ means that the wire to GND "
        "is whole, and then look for the touch",
        ("potentiometer shorted to 5 V", "potentiometer ground end open"),
    )


def judge_actuator(
    seen: ActuatorReadings, has_position: bool = True, is_inverted: bool = False
) -> CheckResult:
    """Judge actuator and potentiometer together by nudges both ways."""
    expected = "down, then up" + (", and the potentiometer agrees" if has_position else "")
    found = f"{seen.press.text}; then {seen.lift.text}"
    problem, causes, remedy = _problem(seen, has_position, is_inverted)
    return CheckResult(expected, found, problem, causes, remedy)


def _problem(
    seen: ActuatorReadings, has_position: bool, is_inverted: bool
) -> tuple[str, tuple[str, ...], Remedy | None]:
    ways = seen.press.seen, seen.lift.seen
    follows = [(abs(n.travel_um) >= MOVED_UM) == (n.seen != NOT_AT_ALL) for n in seen[1:]]
    if NOT_AT_ALL in ways and (all(follows) or not has_position):
        return (*_missing_way(ways), None)
    if has_position and not all(follows):
        return (
            "the potentiometer says something else than the eye: its wiper's wire to A0 is open "
            "and nothing holds the input, or it is not coupled to the rod; connect the wiper with "
            "its pull-down of 1 MΩ, and check the coupling",
            ("potentiometer wiper open, no pull-down",),
            None,
        )
    if ways[0] == ways[1]:
        return (
            "the actuator moved the same way twice: the wires to the bridge's two inputs, D6 and "
            "D7, are not each on its own; check them, and nudge again",
            (),
            None,
        )
    return _direction_problem(seen, has_position, is_inverted)


def _missing_way(ways: tuple[str, str]) -> tuple[str, tuple[str, ...]]:
    if ways == (NOT_AT_ALL, NOT_AT_ALL):
        return (
            "the actuator did not move: its bridge has no supply, or a wire between bridge and "
            "actuator is open, which look alike; look at the lamp of its supply, then measure at "
            "the actuator's plug during a nudge: no voltage means supply or bridge, a voltage its "
            "wire",
            ("actuator supply missing", "actuator unplugged"),
        )
    lacks_press = ways[0] == NOT_AT_ALL
    never, does, wire = ("presses", "lifts", "D6") if lacks_press else ("lifts", "presses", "D7")
    return (
        f"the actuator {does} and never {never}: the half of the bridge that {never} is dead, or "
        f"its wire to {wire} is open; connect the wire, else change the bridge",
        (f"bridge never {never}",),
    )


def _direction_problem(
    seen: ActuatorReadings, has_position: bool, is_inverted: bool
) -> tuple[str, tuple[str, ...], Remedy | None]:
    goes_down, rises = seen.press.seen == DOWN, seen.press.travel_um > 0 or not has_position
    if not goes_down and (not rises or not has_position):
        return (
            "the actuator lifts when it should press: swap its two wires at the bridge",
            ("actuator swapped",),
            None,
        )
    if not goes_down:
        return (
            "the actuator and its potentiometer are both the wrong way round, so that each hides "
            "the other: swap the actuator's two wires, and the potentiometer's two outer wires",
            ("actuator swapped", "potentiometer reversed"),
            None,
        )
    if not rises:
        text = f"[inverted] position = {str(not is_inverted).lower()}"
        return (
            "the actuator moves rightly and its potentiometer counts backwards: swap the "
            f"potentiometer's two outer wires, or let rig.toml say {text}",
            ("potentiometer reversed",),
            Remedy("inverted", {"position": not is_inverted}, text),
        )
    if seen.press.duty > MOST_DUTY:
        dead_band = min(500, round(seen.press.duty))
        text = f"[actuator] dead_band_permille = {dead_band}"
        return (
            f"the actuator needs a duty of {seen.press.duty / 10:.0f} % to move at all: its supply "
            "is half of what it is made for, such as 12 V for 24 V, or it rubs; measure the "
            "bridge's supply against the actuator's label and free the rod, or let rig.toml say "
            f"{text}",
            ("actuator supply half",),
            Remedy("actuator", {"dead_band_permille": dead_band}, text),
        )
    return "", (), None
