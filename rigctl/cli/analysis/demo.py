"""``rigctl demo``: the main job with no hardware and no questions, from samples to figures."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from rigctl.acquisition.rpc.client import EngineClient
from rigctl.acquisition.rpc.messages import RunStatus
from rigctl.cli.data.world import add_world
from rigctl.cli.options.progress import ProgressLine, clock
from rigctl.cli.rig.run import EXIT_CODES, Watcher
from rigctl.errors import NegativeAnswer
from rigctl.session.verify.session import verify

PROTOCOL = "quick"
FIGURES = "figures"


def add_parser(subparsers: Any) -> None:
    """Describe the command line."""
    parser = subparsers.add_parser(
        "demo",
        help="record, verify, encode and classify on the simulated bench",
        description="Record a quick protocol on a simulated rig as fast as it goes, verify the "
        "session, encode it to spikes, tell its textures apart on held-out trials, draw a raster "
        "and an accuracy figure. Then open the window on a live rig where there is a display.",
    )
    parser.add_argument("--out", metavar="DIR", help="the folder that becomes the session")
    parser.add_argument("--seed", type=int, default=1, help="of the simulated rig (default 1)")
    parser.add_argument("--rig", choices=("virtual", "firmware"), default="virtual")
    add_world(parser)
    parser.add_argument("--no-window", action="store_true", help="do not open the window")


def run(args: argparse.Namespace) -> int:
    """Do it all; the last lines on standard output say where the results are."""
    from rigctl.analysis.report.demo import analyse_session

    _say(f"recording {PROTOCOL}.toml on the {args.rig} rig, seed {args.seed}, as fast as it goes")
    ended = _record(args)
    if ended.state != "done":
        print(f"the run ended early: {ended.text}\nsession: {ended.session}")
        return EXIT_CODES[ended.state]
    session = Path(ended.session or "")
    print(_verified(session))
    _say("encoding, classifying, drawing")
    answer = analyse_session(session, session / FIGURES, progress=_Stages().show)
    for remark in answer.remarks:
        print(f"note: {remark}")
    print(f"{answer.sentence}; everything from the simulated bench")
    print(f"session: {session}\nraster: {answer.raster}\naccuracy: {answer.accuracy}", flush=True)
    return 0 if args.no_window or not has_display() else _open_window(args.rig, _world_words(args))


def has_display() -> bool:
    """Whether a window could be seen by somebody."""
    named = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(named) or sys.platform in ("win32", "darwin")


def _record(args: argparse.Namespace) -> RunStatus:
    """Have an engine of our own run the protocol; the run's part of its last status."""
    order = ["--protocol", PROTOCOL, "--yes", *(["--out", args.out] if args.out else [])]
    order += _world_words(args)
    client = EngineClient.start(args.rig, paced=False, seed=args.seed, run=order)
    watcher = Watcher(client, ProgressLine(sys.stderr))
    with watcher.interruptible():
        try:
            return watcher.watch()
        finally:
            client.shut_down()


def _world_words(args: argparse.Namespace) -> list[str]:
    return [] if args.world is None else ["--world", str(args.world)]


def _verified(session: Path) -> str:
    report = verify(session)
    if not report.whole:
        raise NegativeAnswer(f"{session} is not whole: {report.problems[0]}")
    return (
        f"{session} is whole: {report.trials_committed:,} trials committed, "
        f"{report.samples:,} samples, {report.lost_samples:,} lost"
    )


def _open_window(rig: str, world: list[str]) -> int:
    """The window in a process of its own: the job is done, and whatever Qt meets leaves it so."""
    _say(f"opening the window on a live {rig} rig; close it to end (--no-window leaves it out)")
    command = [sys.executable, "-m", "rigctl", "gui", "--rig", rig, *world]
    code = subprocess.run(command, check=False).returncode
    if code:
        _say(
            f"the window ended with code {code}; the results above are complete. Where Qt's "
            "platform plugin does not load, on Debian install libxcb-cursor0 libxcb-icccm4 "
            "libxcb-keysyms1"
        )
    return 0


class _Stages:
    """Says a stage when it begins, with the time left reckoned from the share done."""

    def __init__(self) -> None:
        self._started_s = time.monotonic()

    def show(self, stage: str, share: float) -> None:
        """One stage; ``share`` of the classification is done."""
        left = ""
        if 0.0 < share < 1.0:
            elapsed_s = time.monotonic() - self._started_s
            left = f", {clock(elapsed_s * (1.0 - share) / share)} left"
        _say(f"  {stage}{left}")


def _say(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)
