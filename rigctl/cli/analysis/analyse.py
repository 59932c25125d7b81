"""Encode sessions and classify their textures as the paper does.

Encode sessions in the paper's four representations and in two with a texture-blind force
scaling, classify the textures with 1 to 50 principal components in many draws, and write a
report: report.html, results.json, table1.csv and figures.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.cli.options.encoder import (
    add_encoder,
    add_resources,
    parameters_of,
    ranges_of,
    resources_of,
)
from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from rigctl.analysis.classification.training import ModelRequest
    from rigctl.analysis.report.report_folder import ReportResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("sessions", nargs="+", metavar="SESSION", help="session folders")
    parser.add_argument("--out", required=True, metavar="REPORT", help="new folder")
    _add_sweep(parser)
    parser.add_argument(
        "--c",
        type=Path,
        metavar="FILE",
        help="take C from a model or spikes.h5 instead of a search, and measure its rate error",
    )
    parser.add_argument(
        "--sensitivity",
        action="store_true",
        help="add a table of all encoder presets, with 10 components and the same draws",
    )
    parser.add_argument("--trial", type=int, metavar="ID", help="trial in the figure of one taxel")
    parser.add_argument("--taxel", type=int, metavar="N", help="taxel in that figure, from 1")
    add_encoder(parser)
    add_resources(parser)
    _add_model(parser)


def _add_sweep(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--iterations", type=int, default=20, metavar="N", help="random draws (20)")
    parser.add_argument(
        "--k-max", type=int, default=50, metavar="K", help="principal components, at most (50)"
    )
    parser.add_argument(
        "--engine",
        choices=("own", "sklearn"),
        default="own",
        help="own: one decomposition per fold; sklearn: a pipeline per number of components, "
        "which is slower and gives the same results",
    )
    parser.add_argument(
        "--task",
        action="append",
        default=[],
        metavar="TASK",
        help="textures, groups, extrapolation, leave-speed-out or leave-force-out; may be "
        "repeated (default: all that fit the sessions)",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the draws (0)")


def _add_model(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("a model for rigctl classify")
    group.add_argument(
        "--save-model", type=Path, metavar="FILE", help="save a model trained on all trials"
    )
    group.add_argument(
        "--representation", metavar="NAME", help='such as "Original" (default: "Speed Scaled")'
    )
    group.add_argument("--components", type=int, metavar="K", help="principal components (50)")


def run(args: argparse.Namespace) -> int:
    """Make the report; the last lines on standard output name its files."""
    from rigctl.analysis.classification.sweep_engines import SweepEngine
    from rigctl.analysis.paper.tasks import SweepSettings
    from rigctl.analysis.report.report_folder import ReportRequest, make_report

    engine = SweepEngine(args.engine)
    request = ReportRequest(
        tuple(Path(name) for name in args.sessions),
        Path(args.out),
        SweepSettings(args.iterations, args.k_max, args.seed, engine, tuple(args.task)),
        parameters_of(args),
        reference_g=args.reference_force,
        trial=args.trial,
        taxel=args.taxel,
        model=_model_of(args),
        c=args.c,
        sensitivity=args.sensitivity,
        ranges=ranges_of(args),
    )
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    with resources_of(args) as resources:
        report = make_report(request, now, resources)
    print(_summary(report), flush=True)
    return 0


def _model_of(args: argparse.Namespace) -> ModelRequest | None:
    """Return the requested model, if any. Raises WrongUse for its options without a file."""
    from rigctl.analysis.classification.training import ModelRequest

    options = ("representation", "components")
    given = {name: value for name in options if (value := getattr(args, name)) is not None}
    if args.save_model is not None:
        return ModelRequest(args.save_model, **given)
    if given:
        raise WrongUse(f"--{next(iter(given))} belongs to a model: name its file with --save-model")
    return None


def _summary(report: ReportResult) -> str:
    """Return the remarks, one line for each task, and the paths of the files."""
    lines = [f"note: {remark}" for remark in report.remarks]
    for result in report.results:
        accuracies = (
            f"{curve.representation.name} {curve.mean[result.shown_components - 1]:.1%}"
            for curve in result.curves
        )
        lines.append(
            f"{result.task.title} ({result.shown_components} components): {', '.join(accuracies)}"
        )
    names = {"report": "report.html", "results": "results.json", "table": "table1.csv"}
    files = {k: report.folder / v for k, v in names.items()}
    if report.model is not None:
        files["model"] = report.model
    return "\n".join([*lines, *(f"{k}: {path}" for k, path in files.items())])
