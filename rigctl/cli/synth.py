"""Make a virtual data set.

Record the trials of a protocol on the simulated bench, without serial links and faster than
real time, into a session that is labelled as simulated.
"""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from rigctl.cli import INTERRUPTED
from rigctl.cli.arguments import (
    MAX_REPEATS,
    WORKERS,
    a_path,
    add_more_workers,
    add_option,
    add_seed,
    path_or_name,
    whole_number,
    workers_of,
)
from rigctl.cli.progress import Interrupts, Pace, ProgressLine, clock
from rigctl.cli.verify import print_missing, print_session
from rigctl.cli.world import add_world, chosen_world
from rigctl.config.resources import find_protocol
from rigctl.session.part import existing_parts

if TYPE_CHECKING:
    from rigctl.synth.dataset import DatasetProgress


MAX_SESSIONS = 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(
        parser,
        "--plan",
        path_or_name,
        "PROTOCOL",
        "a file, or the name of a built-in protocol",
        required=True,
    )
    add_option(
        parser,
        "--repeats",
        whole_number(1, MAX_REPEATS),
        "N",
        "number of repeats, instead of the protocol's",
    )
    add_seed(parser, "seed of the simulated bench and of the trial order", required=True)
    add_world(parser)
    add_option(parser, "--out", a_path, "DIR", "the new session", required=True)
    add_option(
        parser,
        "--sessions",
        whole_number(1, MAX_SESSIONS),
        "N",
        "spread the repeats over N sessions below DIR, each with its own gains",
    )
    add_option(parser, "--workers", WORKERS, "N", "processors to use (default 2)", default=2)
    add_more_workers(parser, default=2)
    parser.add_argument(
        "--resume", action="store_true", help="continue the data set in DIR, if there is one"
    )


def run(args: argparse.Namespace) -> int:
    """Make the data set and return 0 if every trial is committed, 1 if some are not."""
    from rigctl.bench.world_file import NOMINAL_WORLD
    from rigctl.synth.dataset import (
        DatasetRequest,
        generate,
        generate_sessions,
        load_plan,
        split_request,
    )

    workers = workers_of(args)
    protocol = find_protocol(args.plan)
    world = chosen_world(args.world) or NOMINAL_WORLD
    plan = load_plan(protocol, args.repeats, args.seed, world)
    for folder in (args.out, *sorted(args.out.glob("*/"))) if args.resume else ():
        if existing_parts(folder):
            print_missing(folder)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    order = DatasetRequest(plan, args.seed, args.out, now, args.resume, world)
    progress = SynthProgress(len(plan.trials), sum(trial.duration_s for trial in plan.trials))
    with Interrupts(limit=1) as interrupts:
        rest = (progress.show, interrupts.requested, workers)
        if args.sessions is None:
            whole = generate(order, *rest)
        else:
            split = split_request(protocol, args.repeats, order, args.sessions)
            whole = generate_sessions(split, *rest)
    progress.finish()
    for path in [args.out] if args.sessions is None else sorted(args.out.glob("*/")):
        print_session(path)
    if not whole:
        note = "interrupted; the trials so far are kept, add --resume to continue"
        print(f"rigctl: {note}", file=sys.stderr)
        return INTERRUPTED
    return 0 if progress.committed == len(plan.trials) else 1


class SynthProgress:
    """Shows how many trials are made, the pace and the time left."""

    def __init__(self, trials: int, trial_s: float) -> None:
        self._trials = trials
        self._trial_s = trial_s
        self._line = ProgressLine(sys.stderr)
        self._pace = Pace()
        self.committed = 0

    def show(self, progress: DatasetProgress) -> None:
        """Keep the count of committed trials, and show the progress once its pace is known."""
        self.committed = progress.committed
        pace = self._pace.add(self._line.elapsed_s, progress.trial_s)
        if pace:
            left_s = (self._trial_s - progress.trial_s) / pace
            self._line.show(
                f"{progress.trials}/{self._trials} trials · "
                f"{pace:.0f} × real time · {clock(left_s)} left"
            )

    def finish(self) -> None:
        """End the line and print how many trials are committed."""
        self._line.end()
        print(f"{self.committed} of {self._trials} trials committed", file=sys.stderr)
