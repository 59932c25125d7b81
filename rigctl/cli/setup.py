"""Set a rig up from wired parts to its first trial, one part at a time.

Check each part of a rig alone before anything may press, write rig.toml, and commission the
drum's board. It can be left and continued: what has passed lies beside rig.toml. Exit code 0: all
parts are right; 1: a part is wrong, or was left; 2: wrong use; 3: rig fault.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.boards.port_discovery import probe_ports
from rigctl.cli.arguments import add_option, add_seed, path_or_name
from rigctl.cli.progress import ProgressLine
from rigctl.cli.world import add_wirings, add_world, chosen_world
from rigctl.config.resources import part_title, wiring_drawing
from rigctl.config.rig_config import load_config
from rigctl.config.text_file import visible
from rigctl.engine.calibrator import Calibrator, calibrate_alone
from rigctl.engine.rig import Rig
from rigctl.engine.setup.boards import find_boards, judge_reports, write_rig_file
from rigctl.engine.setup.check_result import CheckResult, Question
from rigctl.engine.setup.context import SetupContext
from rigctl.engine.setup.setup import STEPS, Setup, SetupStep, TooEarly
from rigctl.engine.setup.setup_status import FORCE
from rigctl.errors import RigFault, WrongUse
from rigctl.rig import FIRMWARE, VIRTUAL, open_rig
from rigctl.values import DRUM, TAXELS

AGAIN, KEEP, FLASH, LEAVE = "again", "keep", "flash", "leave"
FIRMWARE_PART = "firmware"
NO_TERMINAL = (
    "there is no terminal to answer at: run this command at one, or open Set up in the window"
)
SET_UP = "the rig is set up: run a protocol, or protocols/acceptance.toml for rigctl accept"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(
        parser,
        "--rig",
        path_or_name,
        help_text="a rig.toml, written if there is none; virtual or firmware to rehearse",
        default="rig.toml",
    )
    add_world(parser)
    add_wirings(parser)
    add_seed(parser, "seed of a simulated rig", default=0)
    parser.add_argument(
        "--part", choices=[step.name for step in STEPS], help="check this part only, again"
    )
    parser.add_argument("--again", action="store_true", help="begin again with the first part")
    parser.add_argument(
        "--commission",
        action="store_true",
        help="commission the board without checks, and say which parts nobody has checked",
    )
    parser.add_argument(
        "--yes", action="store_true", help="take the answers of a simulated bench without asking"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end")


def run(args: argparse.Namespace) -> int:
    """Take the steps that are left; the last line says what is next."""
    _write_new_file(args)
    if not _find_boards(args):
        return 1
    world = chosen_world(args.world)
    rig = open_rig(args.rig, seed=args.seed, paced=not args.yes, world=world, wirings=args.wire)
    rig.commissions = False
    with closing(rig):
        if args.yes and not rig.simulated:
            raise WrongUse("a bench needs a person who presses and looks: leave out --yes")
        session = _SetupSession(args, rig)
        try:
            rig.loop.run_until_complete(calibrate_alone(rig, session.run))
        except KeyboardInterrupt:
            print()
            session.say_left()
            raise
        except RigFault:
            if session.is_connected:
                raise
            result = rig.loop.run_until_complete(find_boards(rig))
            if result.passed:
                raise
            _report_ports(args, result)
            return 1
    if session.ports_to_flash:
        for board, port in session.ports_to_flash.items():
            asyncio.run(_flash(board, port))
        return run(args)
    return session.report()


async def _flash(board: str, port: str) -> None:
    """Write the image of this installation, as ``rigctl flash`` does."""
    from rigctl.boards.flash import flash_board

    line = ProgressLine(sys.stderr)
    await flash_board(board, line.show_share, port)
    line.end()


def _write_new_file(args: argparse.Namespace) -> None:
    """Write a rig.toml with every key and its meaning where there is none."""
    path = Path(args.rig)
    if args.rig in (VIRTUAL, FIRMWARE) or path.suffix != ".toml" or path.exists():
        return
    write_rig_file(path, {})
    if not args.json:
        print(f"{path} is new: it has every key and its meaning")


def _find_boards(args: argparse.Namespace) -> bool:
    """Look for the boards where rig.toml does not name both ports; return whether all is well."""
    path = Path(args.rig)
    if args.rig in (VIRTUAL, FIRMWARE) or not path.is_file():
        return True
    ports = load_config(path).ports
    if ports.simulate or (ports.drum and ports.taxels):
        return True
    with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        result = judge_reports(runner.run(probe_ports(runner.get_loop())))
    if not result.passed:
        _report_ports(args, result)
    return result.passed


def _report_ports(args: argparse.Namespace, result: CheckResult) -> None:
    """Print what answered on the ports of a rig that is not connected."""
    if not args.json:
        _print_result(result)
        return
    first = STEPS[0]
    step = {"part": first.name, "title": first.title, "passed": False, **result._asdict()}
    print(json.dumps(_json_object([step], first.name, (), []), ensure_ascii=False))


class _NoTerminal(WrongUse):
    """Nobody can answer."""


class _SetupSession:
    """One sitting: a person at the terminal, or the hands of a simulated bench."""

    def __init__(self, args: argparse.Namespace, rig: Rig) -> None:
        self._args, self._rig = args, rig
        self._print: Callable[[str], None] = _no_print if args.json else print
        self._setup: Setup | None = None
        self._skipped: tuple[str, ...] = ()
        self.ports_to_flash: dict[str, str] = {}
        """Boards whose firmware the person wants to write, with their ports."""

    @property
    def is_connected(self) -> bool:
        """Whether both boards have answered."""
        return self._setup is not None

    async def run(self, calibrator: Calibrator) -> None:
        """Take the steps until all have passed or the person leaves."""
        rig = self._rig
        await rig.taxels.connect()
        context = SetupContext(rig, calibrator, self._ask, _today)
        setup = Setup(context, context.progress())
        self._setup = setup
        if self._args.again:
            setup.begin_again()
        for remark in setup.progress.remarks:
            self._print(remark)
        if self._args.commission:
            self._skipped = await setup.commission_without()
        elif self._args.part:
            await self._take(setup, setup.step(self._args.part))
        else:
            while (step := setup.next) is not None and await self._take(setup, step):
                pass

    def say_left(self) -> None:
        """Say at which part the person leaves, and what goes on there."""
        if self._setup is None or self._setup.next is None:
            return
        if self._setup.progress.path is None:
            goes_on = "a simulated rig is not remembered, so the next setup begins anew"
        else:
            goes_on = f"rigctl setup --rig {self._args.rig} goes on there"
        self._print(f"left at {self._setup.next.title}: {goes_on}")

    def report(self) -> int:
        """Print where the setup stands; return the exit code."""
        assert self._setup is not None
        setup, left = self._setup, self._setup.next
        if self._args.json:
            print(json.dumps(_as_dict(setup, self._skipped), ensure_ascii=False))
        if self._args.commission:
            self._print("the board is commissioned")
            self._print(f"nobody has checked: {', '.join(self._skipped) or 'nothing is left'}")
            return 0
        if self._args.part:
            result = setup.results.get(self._args.part)
            if left is not None and setup.progress.path is not None:
                self._print(f"next is {left.title}: rigctl setup --rig {self._args.rig}")
            return 0 if result is not None and result.passed else 1
        if left is None:
            self._print(SET_UP)
            return 0
        self.say_left()
        return 1

    async def _take(self, setup: Setup, step: SetupStep) -> bool:
        """Check a part until it is right; return False where the person leaves."""
        number = setup.steps.index(step) + 1
        self._print(f"\n{number}/{len(setup.steps)} {step.title}  ({_picture(step)})")
        while True:
            try:
                result = await setup.check(step.name)
            except _NoTerminal:
                raise
            except TooEarly as refusal:
                raise WrongUse(f"{refusal}; without --part, the setup goes on there") from None
            except WrongUse as refusal:
                result = CheckResult("", "", str(refusal))
            if not self._args.json:
                _print_result(result)
            if result.passed:
                return True
            answer = self._choose(step, result)
            if answer == FLASH:
                links = {DRUM: self._rig.drum.link, TAXELS: self._rig.taxels.link}
                self.ports_to_flash = {board: link.name for board, link in links.items()}
            if answer in (LEAVE, FLASH):
                return False
            if answer == KEEP:
                self._print(f"rig.toml says {await setup.keep(step.name)}")
                return True

    def _choose(self, step: SetupStep, result: CheckResult) -> str:
        """Ask what to do about a wrong part."""
        if self._args.yes:
            return LEAVE
        if step.name == FIRMWARE_PART:
            text = "Flash both boards now, or leave?"
            return _answer(Question("choose", text, (FLASH, LEAVE)), FLASH)
        if result.remedy is None:
            text = "Mend it and check again, or leave?"
            return _answer(Question("choose", text, (AGAIN, LEAVE)), AGAIN)
        text = "Mend it and check again, let rig.toml describe it, or leave?"
        return _answer(Question("choose", text, (AGAIN, KEEP, LEAVE)), AGAIN)

    async def _ask(self, question: Question) -> str:
        """Ask at the terminal; a simulated bench does what is asked and knows the answer."""
        known = self._rig.answer(question.key, question.low)
        if self._args.yes:
            self._print(f"  {question.text} [{known}]")
            return question.checked(known)
        return _answer(question, known)


def _answer(question: Question, known: str) -> str:
    """Return the answer of a person; Enter takes the one that is known."""
    hint = f"Enter: {known}" if known else "Enter when done"
    if len(question.choices) > 1:
        hint = f"{' / '.join(question.choices)}{f', Enter: {known}' if known else ''}"
    elif question.unit and not question.choices:
        hint = f"{question.unit}{f', Enter: {known}' if known else ''}"
    while True:
        try:
            given = input(visible(f"  {question.text} [{hint}; Ctrl-C leaves] "))
        except EOFError:
            if sys.stdin.isatty():  # Ctrl-D
                raise KeyboardInterrupt from None
            raise _NoTerminal(NO_TERMINAL) from None
        if given.strip().lower() == LEAVE and LEAVE not in question.choices:
            raise KeyboardInterrupt
        try:
            return question.checked(given or known)
        except WrongUse as impossible:
            print(f"  {impossible}")


def _print_result(result: CheckResult) -> None:
    if result.expected:
        print(f"  expected: {result.expected}")
        print(f"  found:    {result.found}")
    print(f"  {'right' if result.passed else f'WRONG: {result.problem}'}", flush=True)


def _picture(step: SetupStep) -> str:
    """Return where the drawing of a part is."""
    if step.picture == FORCE:
        return "the load cell"
    page = step.picture.partition("#")[0]
    return f"{part_title(step.picture)}, in {wiring_drawing(page)}"


def _as_dict(setup: Setup, skipped: tuple[str, ...]) -> dict[str, Any]:
    """Return the state of the setup as values for JSON."""
    left = setup.next
    steps = [
        {
            "part": step.name,
            "title": step.title,
            "passed": step.name in setup.progress.passed,
            **(setup.results[step.name]._asdict() if step.name in setup.results else {}),
        }
        for step in setup.steps
    ]
    return _json_object(steps, left.name if left else None, skipped, setup.progress.remarks)


def _json_object(
    steps: list[dict[str, Any]], left: str | None, skipped: tuple[str, ...], remarks: list[str]
) -> dict[str, Any]:
    return {"steps": steps, "next": left, "not_checked": list(skipped), "remarks": remarks}


def _no_print(_: str) -> None:
    """Print nothing: the JSON object follows."""


def _today() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%d")
