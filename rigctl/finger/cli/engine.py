"""``rigctl finger-engine``: the process that holds a rig of the moving finger."""

from __future__ import annotations

import argparse
from contextlib import closing

from rigctl.cli.arguments import about_of, add_about, add_option, number, path_or_name, whole_number
from rigctl.cli.engine_process import EngineProcess, add_engine_arguments, utc_now
from rigctl.cli.world import chosen_world
from rigctl.experiments import FINGER_EXPERIMENT
from rigctl.finger.analysis.classifier import COVERAGE, ERROR_RATE
from rigctl.finger.commands import FingerCommands
from rigctl.finger.engine import FingerEngine
from rigctl.finger.live_file import FingerLiveWriter
from rigctl.finger.open_rig import open_finger_rig
from rigctl.finger.run_request import DEFAULT_PROTOCOL, FingerRunRequest


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_engine_arguments(parser, protocol=DEFAULT_PROTOCOL)
    add_option(parser, "--session", whole_number(0), default=0)
    add_option(parser, "--first-slide", whole_number(0), default=0)
    parser.add_argument("--stage", action="append", default=[])
    add_option(parser, "--model", path_or_name, default=None)
    add_option(parser, "--error-rate", number(0, 1), default=ERROR_RATE)
    add_option(parser, "--coverage", number(0, 1), default=COVERAGE)
    add_about(parser)


def run(args: argparse.Namespace) -> int:
    """Open the rig, announce the engine, wait for its first client, serve."""
    rig = open_finger_rig(
        args.rig,
        seed=args.seed,
        session=args.session,
        first_slide=args.first_slide,
        paced=args.paced,
        world=chosen_world(args.world),
    )
    with closing(rig):
        process = EngineProcess(args.name, args.rig, FINGER_EXPERIMENT, not rig.simulated)
        with closing(FingerLiveWriter(process.live_path)) as live:
            engine = FingerEngine(rig, live, utc_now)
            return process.serve(engine, FingerCommands(engine).handle, _request(args))


def _request(args: argparse.Namespace) -> FingerRunRequest | None:
    if not args.stage and args.resume is None:
        return None
    return FingerRunRequest(
        tuple(args.stage),
        args.protocol,
        args.model,
        args.out,
        args.resume,
        args.order_seed,
        args.yes,
        args.error_rate,
        args.coverage,
        **about_of(args),
    )
