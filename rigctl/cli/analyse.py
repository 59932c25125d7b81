"""``rigctl analyse``: recorded sessions to the paper's figures and table, in one report folder."""

from __future__ import annotations

import argparse
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TextIO

from rigctl.cli.progress import clock

EVERY_S = 5.0
REDRAW_EVERY_S = 0.2


def add_parser(subparsers: Any) -> None:
    """Describe the command line."""
    parser = subparsers.add_parser(
        "analyse",
        help="encode sessions and classify their textures as the paper does",
        description="Encode sessions in the paper's four representations and two whose force "
        "scaling knows no texture, tell textures apart over 1 to 50 principal components in many "
        "draws, and write a report: report.html, results.json, table1.csv and figures.",
    )
    parser.add_argument("sessions", nargs="+", metavar="SESSION", help="session folders")
    parser.add_argument("--out", required=True, metavar="REPORT", help="folder to be made")
    parser.add_argument("--iterations", type=int, default=20, metavar="N", help="draws (20)")
    parser.add_argument("--k-max", type=int, default=50, metavar="K", help="components (50)")
    parser.add_argument(
        "--engine",
        choices=("own", "sklearn"),
        default="own",
        help="own: one decomposition a fold; sklearn: a pipeline for each k (slow, equal)",
    )
    parser.add_argument(
        "--reference-force",
        type=float,
        default=500.0,
        metavar="G",
        help="force whose SA rates the others are scaled to (500)",
    )
    parser.add_argument("--preset", default="default", metavar="NAME", help="encoder preset")
    parser.add_argument(
        "--task",
        action="append",
        default=[],
        metavar="TASK",
        help="textures, groups, extrapolation, leave-speed-out or leave-force-out; may be "
        "repeated (default: all that fit the set)",
    )
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes (1)")
    parser.add_argument("--seed", type=int, default=0, help="of the draws (0)")
    parser.add_argument("--trial", type=int, metavar="ID", help="trial of the figure of one taxel")
    parser.add_argument("--taxel", type=int, metavar="N", help="its taxel, from 1")


def run(args: argparse.Namespace) -> int:
    """Make the report; the last lines on standard output say where it is."""
    from rigctl.analysis.engines import Engine
    from rigctl.analysis.jobs import processes
    from rigctl.analysis.report import Report, Request, make_report
    from rigctl.analysis.tasks import Settings
    from rigctl.encoding.presets import preset
    from rigctl.errors import WrongUse

    if args.workers < 1:
        raise WrongUse("--workers must be at least 1")
    engine = Engine(args.engine)
    request = Request(
        tuple(Path(name) for name in args.sessions),
        Path(args.out),
        Settings(args.iterations, args.k_max, args.seed, engine, tuple(args.task)),
        preset(args.preset),
        args.reference_force,
        args.trial,
        args.taxel,
    )
    line = StageLine(sys.stderr)
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    try:
        with processes(args.workers) as crew:
            report: Report = make_report(request, now, crew=crew, progress=line.show)
    finally:
        line.end()
    print(summary(report), flush=True)
    return 0


def summary(report: Any) -> str:
    """Remarks, one line a task, and where the files are."""
    lines = [f"note: {remark}" for remark in report.remarks]
    for result in report.results:
        shares = (
            f"{curve.representation.name} {curve.mean[result.shown - 1]:.1%}"
            for curve in result.curves
        )
        lines.append(f"{result.task.title} ({result.shown} components): {', '.join(shares)}")
    names = {"report": "report.html", "results": "results.json", "table": "table1.csv"}
    return "\n".join([*lines, *(f"{k}: {report.folder / v}" for k, v in names.items())])


class StageLine:
    """A line that says what is being done, how far it is and how long the stage still takes."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._redraws = out.isatty()
        self._stage = ""
        self._began_s = self._shown_s = 0.0
        self._width = 0

    def show(self, stage: str, done: int, all_: int) -> None:
        """One step of a stage; drawn when the stage is new or some time has passed."""
        now_s = time.monotonic()
        if stage != self._stage:
            self.end()
            self._stage, self._began_s, self._shown_s = stage, now_s, float("-inf")
        period_s = REDRAW_EVERY_S if self._redraws else EVERY_S
        if now_s - self._shown_s < period_s and (done < all_ or not self._redraws):
            return
        self._shown_s = now_s
        left = ""
        if 0 < done < all_:
            left = f", {clock((now_s - self._began_s) * (all_ - done) / done)} left"
        self._write(f"{stage}: {done} of {all_}{left}")

    def end(self) -> None:
        """Leave the line."""
        if self._redraws and self._width:
            self._out.write("\n")
            self._width = 0

    def _write(self, text: str) -> None:
        if self._redraws:
            self._out.write(f"\r{text}{' ' * (self._width - len(text))}")
            self._width = len(text)
        else:
            self._out.write(text + "\n")
        self._out.flush()
