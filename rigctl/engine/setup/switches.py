"""The switches that stop the drum: emergency stop with its second contact, and both ends."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

from rigctl.boards.drum_codes import Status
from rigctl.boards.drum_states import Fault
from rigctl.config.toml_edit import Value
from rigctl.engine.contact import has_status
from rigctl.engine.setup.check_result import YES, YES_OR_NO, CheckResult, Question, Remedy
from rigctl.engine.setup.context import SetupContext
from rigctl.errors import BoardFault

QUIET_S = 3.0
PRESS_STOP = Question("press_estop", "Press the emergency stop, and leave it pressed.")
IS_CUT = Question(
    "is_supply_cut",
    "Look at the stepper's driver and the actuator's bridge while the stop is pressed: are both "
    "without supply, their lamps dark or 0 V at their supply terminals?",
    YES_OR_NO,
)
IS_OFF = Question(
    "is_bridge_off",
    "The drum is switched off now: is the enable terminal of the actuator's bridge at 0 V?",
    YES_OR_NO,
)
RELEASE_STOP = Question("release_estop", "Release the emergency stop.")
HOLD_UPPER = Question("hold_upper", "Hold the upper end switch of the actuator down by hand.")
HOLD_LOWER = Question(
    "hold_lower", "Let it go, and hold the lower end switch of the actuator down by hand."
)
FREE_ENDS = Question("free_ends", "Let both end switches go.")


class StopReadings(NamedTuple):
    """Whether the board sees the stop's contact closed, before, while and after it is pressed."""

    before: bool
    pressed: bool
    after: bool


class EndReadings(NamedTuple):
    """What the board sees of (upper, lower) end: untouched, upper held, lower held."""

    free: tuple[bool, bool]
    upper: tuple[bool, bool]
    lower: tuple[bool, bool]


async def check_stop(context: SetupContext) -> CheckResult:
    """Press and release the emergency stop, then see that it does not trip by itself."""
    before = has_status(await context.look(), Status.ESTOP_CLOSED)
    await context.ask(PRESS_STOP)
    pressed = has_status(await context.look(), Status.ESTOP_CLOSED)
    await context.ask(RELEASE_STOP)
    after = has_status(await context.look(), Status.ESTOP_CLOSED)
    trips = False
    with suppress(BoardFault):  # of another part, whose step names it
        await context.clear()
        trips = any(state.fault == Fault.ESTOP for state in await context.watch(QUIET_S))
    return judge_stop(StopReadings(before, pressed, after), trips)


def judge_stop(seen: StopReadings, trips: bool = False) -> CheckResult:
    """Judge the first contact of the stop, which the board reads; ``trips``: by itself."""
    expected = "closed, open while pressed, closed"
    words = ["closed" if closed else "open" for closed in seen]
    found = f"{words[0]}, {words[1]} while pressed, {words[2]}"
    if seen == (True, False, True) and trips:
        return tripped(expected, found)
    if seen == (True, False, True):
        return CheckResult(expected, found)
    if seen == (False, True, False):
        problem, cause = (
            "the stop closes when it is pressed, so a broken wire would go unnoticed: use its "
            "normally closed contact between D3 and GND",
            "E-stop normally open",
        )
    elif seen == (True, True, True):
        problem, cause = (
            "the board does not see the stop: its contact is bridged, or its wires are on "
            "another input than D3; take the bridge out",
            "E-stop bridged",
        )
    elif seen == (False, False, False):
        problem, cause = (
            "the stop's contact never closes: a wire is off or broken, or the stop is still "
            "latched; turn it until it springs out, else connect its normally closed contact "
            "between D3 and GND",
            "E-stop unplugged",
        )
    else:
        problem, cause = (
            "the stop did not follow the hand: press it until it latches, release it fully, and "
            "check again; if it stays so, a wire at its contact is loose",
            "",
        )
    return CheckResult(expected, found, problem, (cause,) if cause else ())


def tripped(expected: str, found: str) -> CheckResult:
    """Return the result of a stop that has tripped while its contact is closed."""
    return CheckResult(
        expected,
        f"{found}, and then tripped by itself",
        "the stop trips though nobody touches it: spikes reach its input; solder its 1 kΩ and 1 nF "
        "at D3 (100 nF at the end switches), and lay its cable apart from the motor's",
        ("noise on switches",),
    )


async def check_supply_cut(context: SetupContext) -> CheckResult:
    """Ask whether the second contact of the stop cuts the supplies, and the board the bridge."""
    await context.ask(PRESS_STOP)
    is_cut = await context.ask(IS_CUT) == YES
    await context.ask(RELEASE_STOP)
    with suppress(BoardFault):
        await context.clear()
    return judge_supply_cut(is_cut, await context.ask(IS_OFF) == YES)


def judge_supply_cut(is_cut: bool, is_bridge_off: bool) -> CheckResult:
    """Judge what a person saw at the drivers."""
    expected = "no supply while the stop is pressed, and the bridge's enable at 0 V while off"
    found = (
        f"{'no supply' if is_cut else 'a driver with its supply'}, the enable "
        f"{'at 0 V' if is_bridge_off else 'not at 0 V'}"
    )
    if not is_cut:
        return CheckResult(
            expected,
            found,
            "the stop does not cut the motors' supply, so a hung board or a shorted bridge would "
            "go on pressing: put its second normally closed contact into the supply of both "
            "drivers",
            ("E-stop second contact not in the supply",),
        )
    if not is_bridge_off:
        return CheckResult(
            expected,
            found,
            "the bridge stays on whatever the board says, so nothing but the supply switches the "
            "actuator off: connect the bridge's enable to D8 with its resistor to ground, not to "
            "5 V",
            ("bridge enable stuck high",),
        )
    return CheckResult(expected, found)


async def check_ends(context: SetupContext) -> CheckResult:
    """Hold each end switch by hand."""
    free = await _ends(context)
    await context.ask(HOLD_UPPER)
    upper = await _ends(context)
    await context.ask(HOLD_LOWER)
    lower = await _ends(context)
    await context.ask(FREE_ENDS)
    return judge_ends(EndReadings(free, upper, lower), context.rig.config.inverted.end_switches)


async def _ends(context: SetupContext) -> tuple[bool, bool]:
    state = await context.look()
    return has_status(state, Status.END_UP), has_status(state, Status.END_DOWN)


def judge_ends(seen: EndReadings, is_inverted: bool = False) -> CheckResult:
    """Judge both end switches, read with the polarity of ``rig.toml``."""
    expected = "none; upper; lower"
    found = "; ".join(_ends_text(ends) for ends in seen)
    if seen == ((False, False), (True, False), (False, True)):
        return CheckResult(expected, found)
    problem, cause, remedy = _end_problem(seen, is_inverted)
    return CheckResult(expected, found, problem, (cause,) if cause else (), remedy)


def _ends_text(ends: tuple[bool, bool]) -> str:
    names = [name for name, on in zip(("upper", "lower"), ends, strict=True) if on]
    return " and ".join(names) or "none"


def _end_problem(seen: EndReadings, is_inverted: bool) -> tuple[str, str, Remedy | None]:
    if seen == ((False, False), (False, True), (True, False)):
        return "the two end switches are swapped: swap their wires", "end switches swapped", None
    if seen == ((True, True), (False, True), (True, False)):
        kind = "normally closed" if is_inverted else "normally open"
        keys: dict[str, Value] = {"end_switches": not is_inverted}
        text = f"[inverted] end_switches = {str(not is_inverted).lower()}"
        return (
            f"the end switches are {kind} ones, read the wrong way round: wire their other "
            f"contacts, or let rig.toml say {text}",
            "end switches normally open",
            Remedy("inverted", keys, text),
        )
    if all(ends == (True, True) for ends in seen):
        return (
            "both ends always read as reached: the common wire of the end switches is off; "
            "connect it to GND, or set [signals] end_switches = false for an actuator without any",
            "",
            None,
        )
    for index, name in enumerate(("upper", "lower")):
        others_right = [ends[1 - index] for ends in seen] == [False, index == 1, index == 0]
        if others_right and all(ends[index] for ends in seen):
            return (
                f"the {name} end always reads as reached: its wire is off, or the actuator stands "
                "there; connect the wire, or turn the actuator away from its end by hand",
                f"{name} end switch unplugged",
                None,
            )
        if others_right and not any(ends[index] for ends in seen):
            return (
                f"the {name} end switch does not respond: it is bridged, or was not held down; "
                "take the bridge out, and check again",
                "",
                None,
            )
    if all(ends == (False, False) for ends in seen):
        return (
            "neither end switch responds: they are bridged, or are not the ones on the board's "
            "inputs; check both wires",
            "end switches bridged",
            None,
        )
    return (
        "the end switches did not follow the hand: hold one at a time, fully down, and check "
        "again; if it stays so, a wire there is loose",
        "",
        None,
    )
