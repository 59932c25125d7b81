"""Make a movie of a recorded scan: plate, velocity, readings, spikes, features and the answer."""

from __future__ import annotations

import argparse
import sys

from rigctl.analysis.finger.movie import read_timeline, write_movie
from rigctl.analysis.movies import check_movie_file
from rigctl.cli.arguments import a_path, whole_number
from rigctl.cli.progress import ProgressLine
from rigctl.cli.verify import print_missing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the part."""
    parser.add_argument("session", type=a_path("SESSION"), metavar="SESSION", help="session folder")
    parser.add_argument(
        "--trial",
        type=whole_number("--trial", 0),
        metavar="N",
        help="number of the trial (the last committed one)",
    )
    parser.add_argument(
        "--out",
        type=a_path("--out"),
        required=True,
        metavar="FILE",
        help="new .gif or .mp4 that plays in real time, or .png of its last frame",
    )


def run(args: argparse.Namespace) -> int:
    """Read the scan and write its movie."""
    check_movie_file(args.out)
    print_missing(args.session)
    timeline = read_timeline(args.session, args.trial)
    progress = ProgressLine(sys.stderr)
    try:
        write_movie(timeline, args.out, progress.show_stage)
    finally:
        progress.end()
    print(f"{args.out}: {args.out.stat().st_size / 1e6:.2f} MB")
    return 0
