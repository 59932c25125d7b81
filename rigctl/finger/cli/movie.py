"""Make a movie of a recorded scan: plate, velocity, readings, spikes, features and the answer."""

from __future__ import annotations

import argparse
import sys

from rigctl.analysis.movies import check_movie_file
from rigctl.cli.arguments import a_path, add_option, whole_number
from rigctl.cli.progress import ProgressLine
from rigctl.cli.verify import print_missing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the part."""
    add_option(parser, "session", a_path, "SESSION", "session folder")
    add_option(
        parser, "--trial", whole_number(0), "N", "number of the trial (the last committed one)"
    )
    add_option(
        parser,
        "--out",
        a_path,
        "FILE",
        "new .gif or .mp4 that plays in real time, or .png of its last frame",
        required=True,
    )


def run(args: argparse.Namespace) -> int:
    """Read the scan and write its movie."""
    from rigctl.finger.analysis.movie import read_timeline, write_movie

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
