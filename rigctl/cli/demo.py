"""Record, verify, encode and classify on the simulated bench.

Record a quick protocol on a simulated rig faster than real time, verify the session, encode it
to spikes, classify held-out trials, and draw a raster and an accuracy figure. Then open the
window on a live rig if there is a display.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

from rigctl.cli.arguments import a_path, add_option, add_seed
from rigctl.cli.progress import ProgressLine
from rigctl.cli.run import EXIT_CODES, watch_run
from rigctl.cli.verify import print_session
from rigctl.cli.world import add_world
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.messages import RunStatus
from rigctl.errors import CheckFailed
from rigctl.session.verify import verify

PROTOCOL = "quick"
FIGURES = "figures"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "--out", a_path, "DIR", "folder of the new session")
    add_seed(parser, "seed of the simulated rig (1)", default=1)
    parser.add_argument("--rig", choices=("virtual", "firmware"), default="virtual")
    add_world(parser)
    parser.add_argument("--no-window", action="store_true", help="do not open the window")


def run(args: argparse.Namespace) -> int:
    """Run the demo; the last lines on standard output name the results."""
    from rigctl.analysis.report.demo import analyse_sessions

    line = ProgressLine(sys.stderr)
    rig = f"the {args.rig} rig, seed {args.seed}"
    line.say(f"recording {PROTOCOL}.toml on {rig}, faster than real time")
    status = _record(args, line)
    if status.state != "done":
        print(f"the run ended early: {status.text}\nsession: {status.session}")
        return EXIT_CODES[status.state]
    session = Path(status.session or "")
    report = verify(session)
    if not report.whole:
        raise CheckFailed(f"{session} is not whole: {report.problems[0]}")
    print(f"{session} is whole: {report.contents()}")
    line.say("encoding, classifying, drawing")
    result = analyse_sessions([session], session / FIGURES, progress=line.show_stage)
    line.end()
    for remark in result.remarks:
        print(f"note: {remark}")
    print(f"{result.sentence}; all data come from the simulated bench")
    print_session(session)
    print(f"raster: {result.raster}\naccuracy: {result.accuracy}", flush=True)
    if not args.no_window and has_display():
        _open_window(args, line)
    return 0


def has_display() -> bool:
    """Return whether there is a display for a window."""
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(display) or sys.platform in ("win32", "darwin")


def _record(args: argparse.Namespace, line: ProgressLine) -> RunStatus:
    """Run the protocol on a new engine and return the run's last status."""
    options = ["--protocol", PROTOCOL, "--yes", *([f"--out={args.out}"] if args.out else [])]
    options += _world_options(args)
    client = EngineClient.start(args.rig, paced=False, seed=args.seed, run=options)
    return watch_run(client, line)


def _world_options(args: argparse.Namespace) -> list[str]:
    return [] if args.world is None else [f"--world={args.world}"]


def _open_window(args: argparse.Namespace, line: ProgressLine) -> None:
    """Open the window in another process, so that no failure of Qt affects the results."""
    hint = "close it to end the demo (--no-window skips it)"
    line.say(f"opening the window on a live {args.rig} rig; {hint}")
    command = [sys.executable, "-m", "rigctl", "gui", "--rig", args.rig, *_world_options(args)]
    code = subprocess.run(command, check=False).returncode
    if code:
        line.say(
            f"the window ended with code {code}; the results above are complete. If Qt's "
            "platform plugin does not load on Debian, install libxcb-cursor0 libxcb-icccm4 "
            "libxcb-keysyms1"
        )
