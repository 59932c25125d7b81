"""The boards themselves: which port, which firmware, which drum, which wires are fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rigctl.config.resources import checkout, flash_image
from rigctl.config.rig_config import RigConfig, Signals
from rigctl.config.toml_edit import replace_file
from rigctl.engine.setup.check_result import YES, YES_OR_NO, CheckResult, Question
from rigctl.errors import WrongUse
from rigctl.host_build import image_hash
from rigctl.values import DRUM, TAXELS

if TYPE_CHECKING:  # the window judges boards without their drivers
    from rigctl.boards.port_discovery import PortReport
    from rigctl.engine.rig import Rig
    from rigctl.engine.setup.context import SetupContext

SAME_SHARE = 0.005
MOTOR_STEPS = 200
NEW_FILE = "# Written by rigctl setup; your own comments and changes stay.\n\n"
BOARD_NAMES = {DRUM: "drum board", TAXELS: "taxel board"}
CIRCUMFERENCE = Question(
    "circumference",
    "Lay a strip of paper around the drum with its plates on, mark where it meets, and measure "
    "it: how long is one turn?",
    (),
    "mm",
    50,
    5000,
)
MICROSTEPS = Question(
    "microsteps", "To how many microsteps is the stepper's driver set?", (), "microsteps", 1, 256
)


class OptionalWire(NamedTuple):
    """A wire that a rig may do without: its name, where it is, and its part of the drawing."""

    name: str
    where: str
    picture: str


WIRES = {
    "estop": OptionalWire("emergency stop", "its contact on D3", "mega#emergency-stop"),
    "index": OptionalWire(
        "index mark", "its sensor on D2 and the Uno's D9", "mega#index-sensor-at-the-drum"
    ),
    "end_switches": OptionalWire(
        "end switches", "of the actuator, on D30 and D31", "mega#actuator-position-and-ends"
    ),
    "position": OptionalWire(
        "position", "the actuator's potentiometer, on A0", "mega#actuator-position-and-ends"
    ),
    "sync": OptionalWire("sync", "from the Mega's D24 to the Uno's D8", "mega#arduino-uno"),
}
"""The optional wires by their keys in ``[signals]``."""


class DrumReadings(NamedTuple):
    """A turn in mm and the microsteps as a person says, and what the board is built for."""

    turn_mm: float
    microsteps: float
    built_turn_mm: float
    built_steps: int


async def check_ports(context: SetupContext) -> CheckResult:
    """Say which board is where, and keep the ports of a bench."""
    rig = context.rig
    ports = {"drum": rig.drum.link.name, "taxels": rig.taxels.link.name}
    if rig.path is not None and not rig.config.ports.simulate:
        context.keep("ports", ports)
    found = ", ".join(f"{BOARD_NAMES[board]} on {port}" for board, port in ports.items())
    return CheckResult("a drum board and a taxel board", found)


def write_rig_file(path: Path, ports: Mapping[str, str]) -> None:
    """Write the ports of the boards into ``rig.toml``; one with every key where there is none.

    Raises ConfigError for a file that is no rig's, DiskFault.
    """
    if not path.exists():
        replace_file(path, NEW_FILE + RigConfig().to_toml())
    if ports:
        from rigctl.engine.calibrator import edited_rig_file

        replace_file(path, edited_rig_file(path, "ports", ports))


async def check_firmware(context: SetupContext) -> CheckResult:
    """Compare the firmware of both boards with the images of this installation.

    The board of a sensor's driver has neither.
    """
    rig = context.rig
    found = {DRUM: rig.drum.identity.build_hash, TAXELS: rig.taxels.identity.build_hash}
    ours = {board: installed_build(board) if build else "" for board, build in found.items()}
    return judge_firmware(found, ours)


def installed_build(board: str) -> str:
    """Return the build that this installation would flash, empty where it has no image."""
    if checkout() is not None:
        return image_hash(board)
    try:
        return flash_image(board)[1]
    except WrongUse:
        return ""


def judge_firmware(found: Mapping[str, str], installed: Mapping[str, str]) -> CheckResult:
    """Judge the builds of the boards; an installation without an image has none to compare."""
    expected, has = (
        ", ".join(f"{board} {build or 'unknown'}" for board, build in builds.items())
        for builds in (installed, found)
    )
    other = next((b for b in found if installed[b] and found[b] != installed[b]), "")
    problem = ""
    if other:
        problem = (
            f"the {BOARD_NAMES[other]} runs another build than this installation brings: load it "
            f"with {_flash(other)}, then check again"
        )
    return CheckResult(f"builds: {expected}", f"builds: {has}", problem)


async def check_drum(context: SetupContext) -> CheckResult:
    """Ask for the drum's size and its driver's microsteps, and compare with the firmware."""
    turn_mm = await context.number(CIRCUMFERENCE)
    microsteps = await context.number(MICROSTEPS)
    details = context.rig.drum.identity.details
    built_mm = details["steps_per_turn"] * details["nm_per_step"] / 1e6
    result = judge_drum(DrumReadings(turn_mm, microsteps, built_mm, details["steps_per_turn"]))
    if result.passed:
        context.keep("drum", {"circumference_mm": round(built_mm, 3)})
    return result


async def find_boards(rig: Rig) -> CheckResult:
    """Say which board answers at which port of a rig that could not connect."""
    rig.drum.close()
    rig.taxels.close()
    from rigctl.boards.port_discovery import probe_link

    links = {DRUM: rig.drum.link, TAXELS: rig.taxels.link}
    reports = {board: await probe_link(link, rig.loop) for board, link in links.items()}
    return judge_reports(list(reports.values()), list(reports))


def judge_reports(reports: Sequence[PortReport], expected: Sequence[str] = ()) -> CheckResult:
    """Judge what answered on the ports: one board of each kind; ``expected``: which on which."""
    kinds = [report.identity.board if report.identity else "" for report in reports]
    found = "; ".join(
        f"{report.port}: {BOARD_NAMES.get(kind, f'{kind} board') if kind else report.error}"
        for report, kind in zip(reports, kinds, strict=True)
    )
    twice = next((kind for kind in (DRUM, TAXELS) if kinds.count(kind) > 1), "")
    missing = next((kind for kind in (DRUM, TAXELS) if kind not in kinds), "")
    problem, *causes = _ports_problem(twice, missing, reports)
    if not problem and expected and kinds != list(expected):
        problem = (
            "the two boards are exchanged: exchange their cables, or the ports drum and taxels in "
            "rig.toml"
        )
        causes = ["boards swapped"]
    return CheckResult("a drum board and a taxel board", found or "no port", problem, tuple(causes))


def _ports_problem(twice: str, missing: str, reports: Sequence[PortReport]) -> tuple[str, ...]:
    if twice:
        cure = f"flash one of them with {_flash(missing)}" if missing else "unplug one of them"
        return f"two boards answer as the {BOARD_NAMES[twice]}: {cure}", "two boards of one kind"
    if not missing:
        return ("",)
    if not reports:
        return ("there is no serial port: plug both boards in, and see what rigctl doctor says",)
    shut = next((r for r in reports if "in use" in r.error or "not be opened" in r.error), None)
    if shut is not None:  # the missing board may be behind it
        return (f"{shut.port}: {shut.error}",)
    return (
        f"no port answers as the {BOARD_NAMES[missing]}: plug it in; if it is, load its firmware "
        f"with {_flash(missing)}, and if that fails, see what rigctl doctor says",
    )


def _flash(board: str) -> str:
    return f"rigctl flash {board} (in the window: Flash)"


def judge_drum(seen: DrumReadings) -> CheckResult:
    """Judge a drum by what the firmware is built for."""
    expected = f"{seen.built_turn_mm:g} mm a turn, {seen.built_steps} microsteps a turn"
    ratio = seen.built_steps / (MOTOR_STEPS * seen.microsteps)
    found = (
        f"{seen.turn_mm:g} mm a turn, {seen.microsteps:g} microsteps a step, "
        f"which a belt of {ratio:g}:1 makes right"
    )
    if abs(seen.turn_mm / seen.built_turn_mm - 1) > SAME_SHARE:
        return CheckResult(
            expected,
            found,
            f"the firmware is built for a drum of {seen.built_turn_mm:g} mm around, and every "
            "speed and every plate would be off by as much: measure again, else set NM_PER_TURN "
            "in arduino/drum/board.h and circumference_mm in rig.toml, and flash",
            ("drum of 360 mm",),
        )
    if ratio < 1 or abs(ratio * 4 - round(ratio * 4)) > 0.01:
        return CheckResult(
            expected,
            found,
            "no usual belt makes these microsteps right: read the driver's switches again, and "
            "set MICROSTEPS and STEPS_PER_TURN in arduino/drum/board.h to them",
        )
    return CheckResult(expected, found)


async def check_fitted(context: SetupContext) -> CheckResult:
    """Ask which of the optional wires are fitted, and keep that."""
    answers = {
        field.name: await context.ask(_fitted_question(field.name)) == YES
        for field in fields(Signals)
    }
    if answers != {name: getattr(context.rig.config.signals, name) for name in answers}:
        context.keep("signals", answers)
        await context.configure()
    fitted = [WIRES[name].name for name, has in answers.items() if has]
    missing = [WIRES[name].name for name, has in answers.items() if not has]
    lost = f"; without {', '.join(missing)}, see arduino/README.md for what that costs"
    found = f"{', '.join(fitted) or 'none'}{lost if missing else ''}"
    return CheckResult(", ".join(wire.name for wire in WIRES.values()), found)


def _fitted_question(key: str) -> Question:
    wire = WIRES[key]
    text = f"Is this fitted: {wire.name}, {wire.where}?"
    return Question(f"fitted_{key}", text, YES_OR_NO, picture=wire.picture)
