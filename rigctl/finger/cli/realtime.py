"""Recognise textures with the moving finger: train, calibrate, run.

The real-time experiment of the paper. A person (or the virtual finger) slides the sensor over flat
plates; the finger board encodes and scales the spikes by the tracked velocity. `train` records the
normalisation and training scans and trains a classifier, `calibrate` records the scans that centre
it in a new session, `run` names the texture while the finger moves, and `demo` does all three with
the virtual finger. `frame` finds the place of the plate from its touched corners, `board` writes a
model for the classifier on the board, `import` makes a session from recordings of another program,
`movie` shows a recorded scan as an animation. Exit code 0: every scan is committed; 1: some scans
are missing; 2: wrong use; 3: board, tracker or disk failed; 130: interrupted. The session is whole
in every case.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rigctl.cli.arguments import (
    a_path,
    add_about,
    add_lsl,
    add_option,
    add_seed,
    number,
    path_or_name,
    whole_number,
)
from rigctl.cli.world import add_world
from rigctl.finger.cli import board_model, import_scans, movie, plate_frame, stages
from rigctl.finger.model_files import REPRESENTATIONS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parts = parser.add_subparsers(dest="part", required=True, metavar="PART")
    train = parts.add_parser("train", help="record normalisation and training scans, and train")
    _add_recording(train)
    add_option(train, "--components", whole_number(1), "K", "principal components (25)", default=25)
    calibrate = parts.add_parser("calibrate", help="record the scans that centre the classifier")
    _add_recording(calibrate)
    _add_model(calibrate, "session of `rigctl realtime train`, or a model file")
    run_part = parts.add_parser("run", help="name the texture while the finger moves")
    _add_recording(run_part)
    _add_model(run_part, "session of `rigctl realtime calibrate`, or a model file")
    run_part.add_argument(
        "--representation",
        choices=REPRESENTATIONS,
        help="what names the scans (speed-scaled, or that of the model file); with a gain for the "
        "force, the board has it",
    )
    add_option(
        run_part,
        "--error-rate",
        number(0, 1),
        "SHARE",
        "share of wrong answers among those given before the end (0.05)",
    )
    add_option(
        run_part,
        "--coverage",
        number(0, 1),
        "SHARE",
        "share of the texture sets that hold the true texture (0.95)",
    )
    demo = parts.add_parser("demo", help="train, calibrate and run with the virtual finger")
    add_option(
        demo, "--protocol", path_or_name, help_text="built-in name or file (quick)", default="quick"
    )
    add_option(demo, "--rig", path_or_name, help_text="virtual or firmware", default="virtual")
    add_seed(demo, "seed of the virtual finger (0)", default=0)
    add_option(demo, "--out", a_path, "DIR", default=Path("realtime-demo"))
    plate_frame.add_arguments(
        parts.add_parser("frame", help="find the place of the plate from its touched corners")
    )
    board_model.add_arguments(
        parts.add_parser("board", help="write a model as the header of the board's classifier")
    )
    import_scans.add_arguments(
        parts.add_parser("import", help="make a session from recordings of another program")
    )
    movie.add_arguments(parts.add_parser("movie", help="make a movie of a recorded scan"))


def run(args: argparse.Namespace) -> int:
    """Run one part."""
    parts = {
        "train": stages.train,
        "calibrate": stages.calibrate,
        "run": stages.classify,
        "demo": stages.demo,
        "frame": plate_frame.run,
        "board": board_model.run,
        "import": import_scans.run,
        "movie": movie.run,
    }
    return parts[args.part](args)


def _add_recording(parser: argparse.ArgumentParser) -> None:
    add_option(
        parser,
        "--rig",
        path_or_name,
        help_text="virtual, firmware, or a finger.toml",
        default="virtual",
    )
    add_option(parser, "--protocol", path_or_name, help_text="built-in name or file (paper)")
    add_option(parser, "--out", a_path, "DIR", "folder of the new session")
    add_option(parser, "--resume", a_path, "DIR", "continue a session")
    add_seed(parser, "seed of order and virtual finger")
    add_option(parser, "--session", whole_number(0), "N", "session of the virtual finger")
    add_lsl(parser)
    parser.add_argument("--yes", action="store_true", help="lay simulated plates without asking")
    parser.add_argument("--paced", action="store_true", help="simulate at the speed of real time")
    add_world(parser)
    add_about(parser.add_argument_group("kept in the session, shown by rigctl info"))


def _add_model(parser: argparse.ArgumentParser, text: str) -> None:
    add_option(parser, "--model", a_path, "PATH", text, required=True)
