"""Stop and lift every running rig.

Tell all engines of this user on this computer to stop, as Esc in a window does. The drum stops and
lifts, and a run ends; its session is whole. Exit code 0: every engine has stopped; 1: none is
running; 3: one does not answer, so press the emergency stop at its rig.
"""

from __future__ import annotations

import argparse

from rigctl.engine.rpc.client import StopResult, stop_engines
from rigctl.errors import CheckFailed, RigFault


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the command has no options."""


def run(args: argparse.Namespace) -> int:
    """Stop every engine. Raises RigFault with the name of each that does not answer."""
    failures: list[str] = []

    def report(stopped: StopResult) -> None:
        if stopped.failure:
            failures.append(f"{stopped.name}: {stopped.failure}")
        else:
            print(f"stopped: {stopped.name}", flush=True)

    if not stop_engines(report):
        raise CheckFailed("no engine is running, so there is nothing to stop")
    if failures:
        raise RigFault("; ".join(failures))
    return 0
