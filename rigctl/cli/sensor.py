"""Show gain, noise and ageing of each taxel over the sessions of a sensor.

Compare the trials on the smooth plate at one force, which sessions have anyway, in order of time:
each taxel's mean reading over the first session's, how far equal trials differ, and the change in
30 days.
"""

from __future__ import annotations

import argparse
import json

from rigctl.analysis import published
from rigctl.cli.arguments import a_path, add_option, number
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.encoder.reading import Reading


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "sessions", a_path, "SESSION", "sessions of one sensor", nargs="+")
    smooth = published.SMOOTH
    parser.add_argument("--plate", default=smooth, metavar="NAME", help=f"the plate ({smooth})")
    add_option(parser, "--force", number(0, 1e6), "G", "the force", default=REFERENCE_FORCE_G)
    parser.add_argument(
        "--reading", type=Reading, choices=list(Reading), default=Reading.CONDUCTANCE,
        help="what a gain is of (conductance)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print the table."""
    from rigctl.analysis.sensor_history import as_dict, sensor_history, table_lines

    found = sensor_history(args.sessions, args.plate, args.force, args.reading)
    text = json.dumps(as_dict(found), ensure_ascii=False)
    print(text if args.json else "\n".join(table_lines(found)))
    return 0
