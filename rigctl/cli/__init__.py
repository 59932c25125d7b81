"""The command line: a module for each command, with its help, ``add_arguments`` and ``run``."""

from __future__ import annotations

import argparse
import ast
import os
import sys
from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rigctl import __version__
from rigctl.cli.output import visible_output
from rigctl.config.text_file import shorten
from rigctl.errors import RigctlError, WrongUse

PACKAGE = "rigctl.cli"
MODULES = {
    "demo": ".demo",
    "run": ".run",
    "synth": ".synth",
    "import": ".import_",
    "export": ".export",
    "encode": ".encode",
    "analyse": ".analyse",
    "bundle": ".bundle",
    "orders": ".orders",
    "classify": ".classify",
    "stop": ".stop",
    "jog": ".move",
    "home": ".move",
    "tare": ".move",
    "approach": ".move",
    "axis": ".move",
    "check": ".check",
    "serve": ".serve",
    "world": ".world",
    "plates": ".plates",
    "info": ".info",
    "watch": ".watch",
    "lsl": ".lsl",
    "verify": ".verify",
    "copy": ".copy",
    "recover": ".recover",
    "note": ".note",
    "accept": ".accept",
    "setup": ".setup",
    "calibrate": ".calibrate",
    "sensor": ".sensor",
    "quality": ".quality",
    "ports": ".ports",
    "flash": ".flash",
    "doctor": ".doctor",
    "realtime": "rigctl.finger.cli.realtime",
    "gui": "gui.app",
    "engine": ".engine",
    "finger-engine": "rigctl.finger.cli.engine",
    "lsl-inlet": ".lsl_inlet",
}
"""The module of each command, in the order of the help. Its docstring is the command's help:
a summary, and after an empty line a description."""
HIDDEN = ("engine", "finger-engine", "lsl-inlet")
"""Commands that the help does not list: other commands start them."""

INTERRUPTED = 130
OUTPUT_CLOSED = 141
"""As a shell reports a process that SIGPIPE ended."""


class CommandParser(argparse.ArgumentParser):
    """The parser of a command, whose ``module`` adds its arguments when words are parsed.

    Without a module it is a plain parser, such as that of a part of a command.
    """

    def __init__(self, *args: Any, module: str = "", **options: Any) -> None:
        super().__init__(*args, **options)
        self._module = module
        self._is_intermixed = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Load the command, then parse its words.

        Options may stand between a word and an optional one: argparse by itself takes the latter
        for left out, and then refuses it.
        """
        self.load()
        words = [action.nargs for action in self._get_positional_actions()]
        if self._is_intermixed or len(words) < 2 or words[-1] != "?":
            return super().parse_known_args(args, namespace)
        self._is_intermixed = True  # it calls this method for the options, then for the words
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._is_intermixed = False

    def load(self) -> None:
        """Add the description and the arguments of the command, once."""
        if not self._module:
            return
        command: Any = import_module(self._module, PACKAGE)
        self._module = ""
        self.description = command.__doc__.partition("\n\n")[2] or None
        command.add_arguments(self)


def read_summary(module: str) -> str:
    """Return the first line of a module's docstring as it stands in a list, without loading it."""
    spec = find_spec(module, PACKAGE)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(module)
    source = Path(spec.origin).read_bytes()
    summary = (ast.get_docstring(ast.parse(source)) or "").partition("\n\n")[0]
    return summary[:1].lower() + summary[1:].rstrip(".")


def create_parser(
    commands: Iterable[str] = MODULES, *, loaded: bool = True
) -> argparse.ArgumentParser:
    """Return the argument parser of these commands.

    Unless ``loaded``, a command's module is imported when its words are parsed, and no other.
    """
    top = argparse.ArgumentParser(
        prog="rigctl", description="Drive the texture rig, record its taxels, watch its spikes."
    )
    top.add_argument("--version", action="version", version=f"rigctl {__version__}")
    subparsers = top.add_subparsers(
        dest="command", metavar="COMMAND", required=True, parser_class=CommandParser
    )
    for name in commands:
        shown: dict[str, Any] = {} if name in HIDDEN else {"help": read_summary(MODULES[name])}
        parser = subparsers.add_parser(name, module=MODULES[name], **shown)
        if loaded:
            parser.load()
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code: 0 done, 1 answer is no, 2 wrong use, 3 rig fault."""
    words = list(sys.argv[1:] if argv is None else argv)
    os.environ["PYTHONSAFEPATH"] = "1"  # no child imports from the working folder
    with visible_output():
        try:
            return _run(words)
        except RigctlError as error:
            # Libraries break their sentences into lines; a line of ours is one sentence.
            print("rigctl:", *str(error).split("\n"), file=sys.stderr)
            return error.exit_code
        except KeyboardInterrupt:
            print("rigctl: interrupted", file=sys.stderr)
            return INTERRUPTED
        except BrokenPipeError:  # the reader has gone: rigctl info … | head
            return OUTPUT_CLOSED


def _check_command(words: list[str]) -> None:
    """Raise WrongUse for a first word that is no command, with the one that looks like it."""
    if not words or words[0] in MODULES or words[0].startswith("-"):
        return
    from difflib import get_close_matches

    near = get_close_matches(words[0], MODULES.keys() - set(HIDDEN), 1)
    hint = f"did you mean {near[0]}? " if near else ""
    raise WrongUse(
        f"there is no command {shorten(words[0])}: {hint}`rigctl --help` lists all commands"
    )


def _run(words: list[str]) -> int:
    """Run the command that ``words`` name, and write what it printed."""
    try:
        _check_command(words)
        named = words[:1] if words and words[0] in MODULES else MODULES
        if named is not MODULES:  # else nothing is compiled
            from rigctl.engine.rpc.engine_files import place_machine_code

            place_machine_code()
        args = create_parser(named, loaded=False).parse_args(words)
        command: Any = import_module(MODULES[args.command], PACKAGE)
        return int(command.run(args))
    finally:
        sys.stdout.flush()
