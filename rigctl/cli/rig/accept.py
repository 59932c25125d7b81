"""Judge a rig by a session of the acceptance protocol.

Judge force, drift, speed, steps and losses of a rig from a session recorded with
protocols/acceptance.toml. Exit code 0: accepted; 1: not accepted; 2: not a session.
"""

from __future__ import annotations

import argparse
import json

from rigctl.cli.options.arguments import a_path

ACCEPTED, NOT_ACCEPTED = 0, 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("session", type=a_path("SESSION"), help="a session's folder")
    parser.add_argument(
        "--out",
        type=a_path("--out"),
        metavar="DIR",
        help="also write a report to this new folder",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print one line for each check, then the verdict; write a report with ``--out``."""
    from rigctl.analysis.acceptance.measurements import measure
    from rigctl.analysis.acceptance.report import as_dict, check_limits, is_accepted, write_report

    found = measure(args.session)
    checks = check_limits(found)
    page = write_report(found, checks, args.out) if args.out else None
    if args.json:
        print(json.dumps(as_dict(found, checks), ensure_ascii=False, allow_nan=False))
    else:
        for check in checks:
            verdict = {True: "pass", False: "FAIL", None: "????"}[check.passed]
            earlier = f"; earlier rig {check.earlier}" if check.earlier else ""
            print(f"{verdict}  {check.name}: {check.found} (limit {check.limit}{earlier})")
        whose = "the simulated rig" if found.simulated else "the rig"
        print(f"{whose} is {'accepted' if is_accepted(checks) else 'not accepted'}")
        if page is not None:
            print(f"report: {page}")
    return ACCEPTED if is_accepted(checks) else NOT_ACCEPTED
