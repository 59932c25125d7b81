"""The command line: one module for each command, with ``add_parser`` and ``run``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from rigctl import __version__
from rigctl.errors import RigctlError

MODULES = {
    "demo": "analysis.demo",
    "run": "rig.run",
    "synth": "data.synth",
    "import": "data.import_",
    "encode": "analysis.encode",
    "analyse": "analysis.analyse",
    "orders": "analysis.orders",
    "classify": "analysis.classify",
    "stop": "rig.stop",
    "check": "rig.check",
    "serve": "rig.serve",
    "world": "data.world",
    "info": "data.info",
    "verify": "data.verify",
    "accept": "rig.accept",
    "calibrate": "rig.calibrate",
    "ports": "rig.ports",
    "gui": "rig.gui",
    "engine": "rig.engine",
}
"""The module of each command, in the order of the help."""
COMMANDS = tuple(MODULES)

INTERRUPTED = 130


def parser(commands: Sequence[str] = COMMANDS) -> argparse.ArgumentParser:
    """Return the argument parser of these commands; one alone loads none of the others."""
    top = argparse.ArgumentParser(
        prog="rigctl", description="Drive the texture rig, record its taxels, watch its spikes."
    )
    top.add_argument("--version", action="version", version=f"rigctl {__version__}")
    subparsers = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in commands:
        _module(name).add_parser(subparsers)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code: 0 done, 1 answer is no, 2 wrong use, 3 rig fault."""
    words = list(sys.argv[1:] if argv is None else argv)
    named = words[:1] if words[:1] and words[0] in COMMANDS else COMMANDS
    args = parser(named).parse_args(words)
    command = _module(args.command)
    try:
        return int(command.run(args))
    except RigctlError as error:
        print(f"rigctl: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("rigctl: interrupted", file=sys.stderr)
        return INTERRUPTED


def _module(command: str) -> Any:
    return import_module(f"rigctl.cli.{MODULES[command]}")
