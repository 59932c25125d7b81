"""``rigctl stop``: stop every engine that runs here, from any terminal."""

from __future__ import annotations

import argparse

from rigctl.errors import NegativeAnswer, RigctlError, RigFault
from rigctl.run.client import EngineClient
from rigctl.run.runtime import Announcement, running_engines, runtime_folder

ANSWER_S = 5.0


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """``stop`` takes no arguments: in a hurry there is nothing to choose."""
    subparsers.add_parser("stop", help="stop the drum and lift off, whatever runs")


def run(args: argparse.Namespace) -> int:
    """Stop each engine; a run ends with its session whole."""
    engines = running_engines(runtime_folder())
    if not engines:
        raise NegativeAnswer("no engine is running: there is nothing to stop")
    failures = [failure for engine in engines if (failure := _stop(engine)) is not None]
    if failures:
        raise RigFault("; ".join(failures))
    return 0


def _stop(engine: Announcement) -> str | None:
    """What kept that engine from stopping, None where nothing did."""
    try:
        client = EngineClient.attach(engine)
        try:
            client.request("stop", limit_s=ANSWER_S)
        finally:
            client.close()
    except RigctlError as error:
        return f"{engine.rig} (process {engine.pid}): {error}"
    print(f"stopped: {engine.rig} (process {engine.pid})")
    return None
