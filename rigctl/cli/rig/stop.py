"""Stop and lift every running rig."""

from __future__ import annotations

import argparse

from rigctl.acquisition.rpc.stop_all import StopResult, stop_engines
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
