"""Judge a rig by a session of the acceptance protocol.

Judge force, drift, speed, steps and losses of a rig from a session recorded with
protocols/acceptance.toml; with --rig and --mass weigh a known mass again, and say how far the load
cell has drifted. Exit code 0: accepted; 1: not accepted; 2: not a session.
"""

from __future__ import annotations

import argparse
import json
from contextlib import closing
from typing import TYPE_CHECKING

from rigctl.cli.arguments import a_path, add_option, number, path_or_name
from rigctl.cli.progress import ask
from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from rigctl.analysis.acceptance import AcceptanceCheck

ACCEPTED, NOT_ACCEPTED = 0, 1
MAX_MASS_G = 1e5
ASK_FOR_MASS = (
    "the force is what the load cell reads: add --rig rig.toml --mass G to weigh a known mass, "
    "which shows how far the cell has drifted"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "session", a_path, help_text="a session's folder")
    add_option(parser, "--out", a_path, "DIR", "also write a report to this new folder")
    add_option(
        parser, "--rig", path_or_name, help_text="weigh a known mass on this rig: a rig.toml"
    )
    add_option(
        parser, "--mass", number(1, MAX_MASS_G), "G", "the known mass, in grams; it needs --rig"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print one line for each check, then the verdict; write a report with ``--out``."""
    from rigctl.analysis.acceptance import as_dict, check_limits, is_accepted, measure, write_report

    if (args.rig is None) != (args.mass is None):
        raise WrongUse("--rig and --mass belong together: which mass lies on which rig")
    found = measure(args.session)
    checks = check_limits(found)
    if args.rig is not None:
        checks = (*checks, _weigh(args))
    page = write_report(found, checks, args.out) if args.out else None
    if args.json:
        print(json.dumps(as_dict(found, checks), ensure_ascii=False, allow_nan=False))
    else:
        for check in checks:
            verdict = {True: "pass", False: "FAIL", None: "????"}[check.passed]
            earlier = f"; earlier rig {check.earlier}" if check.earlier else ""
            print(f"{verdict}  {check.name}: {check.found} (limit {check.limit}{earlier})")
        if args.rig is None and not found.simulated:
            print(ASK_FOR_MASS)
        whose = "the simulated rig" if found.simulated else "the rig"
        print(f"{whose} is {'accepted' if is_accepted(checks) else 'not accepted'}")
        if page is not None:
            print(f"report: {page}")
    return ACCEPTED if is_accepted(checks) else NOT_ACCEPTED


def _weigh(args: argparse.Namespace) -> AcceptanceCheck:
    """Read the load cell without and with the known mass."""
    from rigctl.analysis.acceptance import check_known_mass
    from rigctl.engine.calibrator import Calibrator, calibrate_alone
    from rigctl.rig import open_rig

    readings: list[float] = []
    with closing(open_rig(args.rig, paced=False)) as rig:

        async def weigh(calibrator: Calibrator) -> None:
            await calibrator.lift()
            for mass_g in (0.0, args.mass):
                if not rig.lay_mass(mass_g):
                    what = f"Lay {mass_g:g} g on" if mass_g else "Take everything off"
                    ask(f"{what} the drum and let it come to rest.", "run this command at one")
                readings.append((await calibrator.read_mass(mass_g)).mean_counts)

        rig.loop.run_until_complete(calibrate_alone(rig, weigh))
        cell = rig.config.loadcell
    read_g = (readings[1] - readings[0]) * cell.scale_ug_per_count * 1e-6
    return check_known_mass(args.mass, read_g, cell.calibrated)
