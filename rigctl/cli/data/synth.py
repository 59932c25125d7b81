"""``rigctl synth``: a virtual data set without waiting for time to pass."""

from __future__ import annotations

import argparse
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.cli import INTERRUPTED
from rigctl.cli.data.world import add_world, chosen_world
from rigctl.cli.options.interrupt import Interrupt
from rigctl.cli.options.progress import clock
from rigctl.config.resources import find_protocol
from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from rigctl.synth.dataset import DatasetRequest

TELL_EVERY_S = 2.0


def add_parser(subparsers: Any) -> None:
    """Describe the command line."""
    parser = subparsers.add_parser(
        "synth",
        help="make a virtual data set",
        description="Take the trials of a protocol at the simulated bench, without wires and "
        "without waiting, into a session that says that it is simulated.",
    )
    parser.add_argument("--plan", required=True, metavar="PROTOCOL", help="a file, or a name")
    parser.add_argument("--repeats", type=int, metavar="N", help="instead of the protocol's")
    parser.add_argument("--seed", type=int, required=True, help="of the world and the order")
    add_world(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the new session")
    parser.add_argument(
        "--sessions",
        type=int,
        metavar="N",
        help="spread the repeats over N sessions below DIR, each with its own gains",
    )
    parser.add_argument(
        "--workers", type=int, default=2, metavar="N", help="processors to use (default 2)"
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on with what is in DIR, if something is"
    )


def run(args: argparse.Namespace) -> int:
    """Make the data set; 0 when every trial is in it, 1 when some could not be committed."""
    from rigctl.simulation.bench.world_file import NOMINAL
    from rigctl.synth.dataset import DatasetRequest, plan_of

    path = find_protocol(args.plan)
    world = chosen_world(args.world) or NOMINAL
    plan = plan_of(path, args.repeats, args.seed, world)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    order = DatasetRequest(plan, args.seed, args.out, now, args.resume, world)
    teller = SynthProgress(len(plan.trials), sum(trial.duration_s for trial in plan.trials))
    with Interrupt() as interrupt:
        whole = _make(args, path, order, teller, interrupt)
    teller.finish()
    print(f"{'session' if args.sessions is None else 'sessions in'}: {args.out}")
    if not whole:
        print(
            "rigctl: interrupted; what was made is kept, the same command with --resume goes on",
            file=sys.stderr,
        )
        return INTERRUPTED
    return 0 if teller.committed == len(plan.trials) else 1


def _make(
    args: argparse.Namespace,
    path: Path,
    order: DatasetRequest,
    teller: SynthProgress,
    interrupt: Interrupt,
) -> bool:
    from rigctl.synth.dataset import generate
    from rigctl.synth.sessions import generate_all, orders

    if args.workers < 1:
        raise WrongUse(f"--workers {args.workers}: at least one is needed")
    if args.sessions is None:
        return generate(order, teller.tell, interrupt.asked, args.workers)
    split = orders(path, args.repeats, order, args.sessions)
    return generate_all(split, teller.tell, interrupt.asked, args.workers)


class SynthProgress:
    """Says how far it is, on a terminal in one line, elsewhere a line now and then."""

    def __init__(self, trials: int, trial_s: float) -> None:
        self._trials = trials
        self._trial_s = trial_s
        self._began_s = self._told_s = time.monotonic()
        self._redraws = sys.stderr.isatty()
        self.committed = 0

    def tell(self, progress: Any) -> None:
        """Take note of progress; show it if it is time to."""
        self.committed = progress.committed
        now_s = time.monotonic()
        if now_s - self._told_s < (0.2 if self._redraws else TELL_EVERY_S):
            return
        self._told_s = now_s
        pace = progress.trial_s / (now_s - self._began_s)
        left_s = (self._trial_s - progress.trial_s) / pace
        line = f"{progress.trials}/{self._trials} trials · {pace:.0f} × real time · "
        line += f"{clock(left_s)} left"
        start, end = ("\r", "  ") if self._redraws else ("", "\n")
        print(f"{start}{line}", end=end, file=sys.stderr, flush=True)

    def finish(self) -> None:
        """Leave the line and say what came of it."""
        end = "\n" if self._redraws else ""
        print(f"{end}{self.committed} of {self._trials} trials committed", file=sys.stderr)
