"""Turn, home, tare or press the drum by hand, or move a further axis.

jog turns the lifted drum, home finds its index mark, tare takes the lifted load cell's reading as
0 g, approach tares and presses; axis moves the further axis of rig.toml, with the drum lifted and
off. A running engine makes the move, under its rules on who has control; without one, an engine is
started for this move. A drum that was off is lifted and switched off again afterwards, an armed one
stays as the move leaves it; Ctrl-C stops and lifts it. Exit code 0: done; 2: refused; 3: rig fault.
"""

from __future__ import annotations

import argparse

from rigctl.api import ConnectedRig, connect
from rigctl.boards.drum_states import State
from rigctl.cli.arguments import add_option, number, path_or_name

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
    elif command == "axis":
        add_option(parser, "height_mm", number(-1000, 1000), "MM", "height, upwards positive")
    elif command == "approach":
        add_option(parser, "force_g", number(0, MAX_FORCE_G), "G", "force to press with")


def run(args: argparse.Namespace) -> int:
    """Make the move and print what came of it."""
    with connect(args.rig, paced=False) as rig:
        print(_move(rig, args))
    return 0


def _move(rig: ConnectedRig, args: argparse.Namespace) -> str:
    """Make the move; return a sentence on it. Raises the engine's refusal."""
    was_off = rig.status.state == State.IDLE
    try:
        if was_off:
            rig.arm()
        return _MOVES[args.command](rig, args)
    except KeyboardInterrupt:
        rig.stop()
        raise
    finally:
        if was_off:
            rig.disarm()


def _jog(rig: ConnectedRig, args: argparse.Namespace) -> str:
    return f"the drum turned by {rig.jog(args.mm):.2f} mm"


def _home(rig: ConnectedRig, args: argparse.Namespace) -> str:
    rig.home()
    return "the drum counts its steps from the index mark"


def _tare(rig: ConnectedRig, args: argparse.Namespace) -> str:
    rig.tare()
    return "what the lifted load cell reads now is 0 g"


def _approach(rig: ConnectedRig, args: argparse.Namespace) -> str:
    rig.tare()
    rig.set(force_g=args.force_g)
    rig.approach()
    return f"the drum has pressed, with {rig.status.force_g:.1f} g"


def _axis(rig: ConnectedRig, args: argparse.Namespace) -> str:
    rig.disarm()  # lifted by now, and the axis moves with the drum off
    return f"the axis is at {rig.move_axis(args.height_mm):g} mm"


_MOVES = {"jog": _jog, "home": _home, "tare": _tare, "approach": _approach, "axis": _axis}
