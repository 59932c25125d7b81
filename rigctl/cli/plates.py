"""Write the texture plates as STL files to print.

Write the 16 drum plates, those that a world file adds, and the five flat plates of the moving
finger as STL files in mm, with the heights that the simulated bench presses. Exit code 2: a drum
that the bench cannot have.
"""

from __future__ import annotations

import argparse
from math import pi
from typing import TYPE_CHECKING

from rigctl.cli.arguments import a_path, add_option, number
from rigctl.cli.world import add_world, chosen_world
from rigctl.errors import WrongUse
from rigctl.experiments import EXPERIMENTS

if TYPE_CHECKING:
    from rigctl.bench.parameters import WorldParameters


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "--out", a_path, "DIR", "a new folder", required=True)
    add_option(
        parser,
        "--drum-radius",
        number(50, 92),
        "MM",
        "radius of your drum below its plates; default: that of the bench",
    )
    add_world(parser)


def run(args: argparse.Namespace) -> int:
    """Write the plates, and print what they make of a turn of the drum."""
    from rigctl.bench import plate_solids
    from rigctl.bench.world_file import NOMINAL_WORLD

    parameters = (chosen_world(args.world) or NOMINAL_WORLD).parameters
    if args.drum_radius is not None:
        parameters = plate_solids.fitted_to_drum(parameters, args.drum_radius)
    try:
        args.out.mkdir(parents=True)
    except FileExistsError:
        raise WrongUse(f"{args.out} exists: name a new folder") from None
    for experiment in EXPERIMENTS.values():
        for path in experiment.load("plates")(args.out, parameters):
            print(path)
    print(_advice(parameters))
    return 0


def _advice(parameters: WorldParameters) -> str:
    """Return what rig.toml and the firmware have to know of these plates."""
    from rigctl.bench.plate_solids import THICKNESS_MM, base_radius_mm

    radius_mm = base_radius_mm(parameters)
    turn_mm = 2.0 * pi * radius_mm
    return (
        f"For a drum of {radius_mm - THICKNESS_MM:.2f} mm radius: a turn is {turn_mm:.2f} mm of "
        f"texture. In rig.toml: [drum] circumference_mm = {turn_mm:.2f}, plate_length_mm = "
        f"{parameters.plate_length_mm:.0f}; in arduino/drum/board.h: NM_PER_TURN. "
        "The dimensions are this project's own, as the paper gives none for the drum."
    )
