"""Turn, home, tare or press the drum by hand.

jog turns the lifted drum, home finds its index mark, tare takes the lifted load cell's reading as
0 g, approach tares and presses. A running engine makes the move, under its rules on who has
control; without one, an engine is started for this move. A drum that was off is lifted and switched
off again afterwards, an armed one stays as the move leaves it; Ctrl-C stops and lifts it. Exit code
0: done; 2: refused; 3: rig fault.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rigctl.boards.drum_states import State
from rigctl.cli.arguments import add_option, number, path_or_name
from rigctl.engine.motion import MOVE_TIMEOUT_S
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import EngineFile, rig_name, running_engines, runtime_folder
from rigctl.errors import WrongUse
from rigctl.experiments import DRUM_EXPERIMENT

MAX_FORCE_G, MAX_JOG_MM = 100_000, 10_000
"""What a request may hold; the rig's limits are narrower."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command that the parser is of."""
    words = "virtual, firmware, or a rig.toml (default: that of the running engine)"
    add_option(parser, "--rig", path_or_name, help_text=words)
    command = parser.prog.split()[-1]
    if command == "jog":
        words = "way of the surface, forwards where positive"
        add_option(parser, "mm", number(-MAX_JOG_MM, MAX_JOG_MM), "MM", words)
    elif command == "approach":
        add_option(parser, "force_g", number(0, MAX_FORCE_G), "G", "force to press with")


def run(args: argparse.Namespace) -> int:
    """Make the move and print what came of it."""
    with _client(args.rig) as client:
        print(_move(client, args))
    return 0


@contextmanager
def _client(rig: str | None) -> Iterator[EngineClient]:
    """Join the engine of the rig, or start one, which ends afterwards unless others use it."""
    engine = _running_engine(rig)
    if engine is None and rig is None:
        raise WrongUse("no engine is running: name the rig, such as --rig rig.toml")
    client = (
        EngineClient.start(str(rig), paced=False) if engine is None else EngineClient.join(engine)
    )
    try:
        yield client
    finally:
        if engine is None:
            client.leave()
        else:
            client.close()


def _running_engine(rig: str | None) -> EngineFile | None:
    """Return the engine of this rig, or the only one. Raises WrongUse where several fit."""
    drums = [e for e in running_engines(runtime_folder()) if e.experiment == DRUM_EXPERIMENT]
    fitting = [engine for engine in drums if rig is None or engine.rig == rig_name(rig)]
    if len(fitting) > 1:
        rigs = ", ".join(f"{engine.rig} (process {engine.pid})" for engine in fitting)
        raise WrongUse(f"several engines are running: {rigs}: name one rig with --rig, or end one")
    return fitting[0] if fitting else None


def _move(client: EngineClient, args: argparse.Namespace) -> str:
    """Make the move; return a sentence on it. Raises the engine's refusal."""
    was_off = client.request("status")["state"] == State.IDLE
    try:
        if was_off:
            _wait_for(client, "arm")
        return _MOVES[args.command](client, args)
    except KeyboardInterrupt:
        client.request("stop")
        raise
    finally:
        if was_off:
            _wait_for(client, "disarm")


def _jog(client: EngineClient, args: argparse.Namespace) -> str:
    moved_mm = _wait_for(client, "jog", mm=args.mm)["moved_mm"]
    return f"the drum turned by {moved_mm:.2f} mm"


def _home(client: EngineClient, args: argparse.Namespace) -> str:
    _wait_for(client, "home")
    return "the drum counts its steps from the index mark"


def _tare(client: EngineClient, args: argparse.Namespace) -> str:
    _wait_for(client, "tare")
    return "what the lifted load cell reads now is 0 g"


def _approach(client: EngineClient, args: argparse.Namespace) -> str:
    _wait_for(client, "tare")
    _wait_for(client, "set", force_g=args.force_g)
    _wait_for(client, "approach")
    return f"the drum has pressed, with {client.request('status')['force_g']:.1f} g"


_MOVES = {"jog": _jog, "home": _home, "tare": _tare, "approach": _approach}


def _wait_for(client: EngineClient, command: str, **args: Any) -> dict[str, Any]:
    """Send a request of a move and wait for its end, which the engine bounds."""
    return client.request(command, timeout_s=2 * MOVE_TIMEOUT_S, **args)
