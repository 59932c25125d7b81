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

from rigctl.cli.options.arguments import MAX_DRAWS, a_path, add_seed, whole_number
from rigctl.cli.options.encoder import (
    add_encoder,
    add_resources,
    parameters_of,
    ranges_of,
    resources_of,
)
from rigctl.errors import WrongUse

DRUM_OPTIONS = (
    "k_max", "task", "c", "sensitivity", "trial", "taxel", "save_model", "representation",
    "components", "preset", "set", "ranges", "reference_force", "dask",
)  # fmt: skip
"""Options without a meaning for the moving finger."""

if TYPE_CHECKING:
    from rigctl.analysis.pca_lda import SweepEngine
    from rigctl.analysis.report.report_folder import ReportResult
    from rigctl.analysis.settings import AnalysisSettings
    from rigctl.analysis.tasks import SweepSettings
    from rigctl.analysis.training import ModelRequest


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "sessions", nargs="+", type=a_path("SESSION"), metavar="SESSION", help="session folders"
    )
    parser.add_argument(
        "--out", type=a_path("--out"), required=True, metavar="REPORT", help="new folder"
    )
    parser.add_argument(
        "--experiment",
        choices=("drum", "realtime"),
        default="drum",
        help="realtime: sessions of the moving finger, training sessions and new ones in pairs, "
        "for Figures 4B, 4C and S5 (default: drum)",
    )
    parser.add_argument(
        "--settings",
        type=a_path("--settings"),
        metavar="FILE",
        help="analysis file (TOML) with conditions, groups, shares, windows and thresholds that "
        "differ from the paper's; every report holds one, analysis.toml",
    )
    _add_sweep(parser)
    parser.add_argument(
        "--c",
        type=a_path("--c"),
        metavar="FILE",
        help="take C from a model or spikes.h5 instead of a search, and measure its rate error",
    )
    parser.add_argument(
        "--sensitivity",
        action="store_true",
        help="add a table of all encoder presets, with 10 components and the same draws",
    )
    parser.add_argument(
        "--trial",
        type=whole_number("--trial", 0),
        metavar="ID",
        help="trial in the figure of one taxel",
    )
    parser.add_argument(
        "--taxel", type=whole_number("--taxel", 1), metavar="N", help="taxel in that figure, from 1"
    )
    add_encoder(parser)
    add_resources(parser)
    _add_model(parser)


def _add_sweep(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--iterations",
        type=whole_number("--iterations", 1, MAX_DRAWS),
        metavar="N",
        help="random draws (20; realtime: 100 of each data set)",
    )
    parser.add_argument(
        "--k-max",
        type=whole_number("--k-max", 1),
        metavar="K",
        help="principal components, at most (50)",
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
        help="textures, groups, extrapolation, leave-speed-out, leave-force-out or "
        "leave-mount-out; may be repeated (default: all that fit the sessions)",
    )
    add_seed(parser, "seed of the draws (0)", default=0)


def _add_model(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("a model for rigctl classify")
    group.add_argument(
        "--save-model",
        type=a_path("--save-model"),
        metavar="FILE",
        help="save a model trained on all trials",
    )
    group.add_argument(
        "--representation", metavar="NAME", help='such as "Original" (default: "Speed Scaled")'
    )
    group.add_argument(
        "--components",
        type=whole_number("--components", 1),
        metavar="K",
        help="principal components (50)",
    )


def run(args: argparse.Namespace) -> int:
    """Make the report; the last lines on standard output name its files."""
    if args.experiment == "realtime":
        return _run_realtime(args)
    from rigctl.analysis.pca_lda import SweepEngine
    from rigctl.analysis.report.report_folder import ReportRequest, make_report

    engine, analysis = SweepEngine(args.engine), _analysis_of(args)
    request = ReportRequest(
        tuple(Path(name) for name in args.sessions),
        Path(args.out),
        _sweep_of(args, engine, analysis),
        parameters_of(args),
        trial=args.trial,
        taxel=args.taxel,
        model=_model_of(args),
        c=args.c,
        sensitivity=args.sensitivity,
        ranges=ranges_of(args),
        analysis=analysis,
    )
    with resources_of(args) as resources:
        report = make_report(request, _now(), resources)
    print(_summary(report), flush=True)
    return 0


def _run_realtime(args: argparse.Namespace) -> int:
    """Analyse sessions of the moving finger. Raises WrongUse for an option of the drum's alone."""
    from rigctl.analysis.finger.report import make_finger_report
    from rigctl.analysis.finger.tasks import DrawSettings
    from rigctl.analysis.pca_lda import SweepEngine

    _refuse_drum_options(args)
    out = Path(args.out)
    analysis = _analysis_of(args)
    iterations = analysis.finger.draws if args.iterations is None else args.iterations
    settings = DrawSettings(iterations, args.seed, SweepEngine(args.engine), analysis)
    sessions = [Path(name) for name in args.sessions]
    with resources_of(args) as resources:
        report = make_finger_report(sessions, out, settings, _now(), resources)
    files = [f"report: {report.page}", f"results: {out / 'results.json'}"]
    print("\n".join([*report.lines, *files]), flush=True)
    return 0


def _refuse_drum_options(args: argparse.Namespace) -> None:
    plain = argparse.ArgumentParser()
    add_arguments(plain)
    for name in DRUM_OPTIONS:
        if getattr(args, name) != plain.get_default(name):
            option = name.replace("_", "-")
            raise WrongUse(f"--{option} belongs to the drum's analysis: leave it out")


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _analysis_of(args: argparse.Namespace) -> AnalysisSettings:
    """Return the constants of the analysis file, or the paper's; options come before both."""
    from rigctl.analysis.settings import AnalysisSettings, load_settings

    settings = AnalysisSettings() if args.settings is None else load_settings(args.settings)
    if args.reference_force is None:
        return settings
    return settings.with_reference_force(args.reference_force)


def _sweep_of(
    args: argparse.Namespace, engine: SweepEngine, analysis: AnalysisSettings
) -> SweepSettings:
    """Return the sweep of the drum's analysis."""
    from rigctl.analysis.tasks import SweepSettings

    draws = analysis.draws
    iterations = draws.count if args.iterations is None else args.iterations
    k_max = draws.components if args.k_max is None else args.k_max
    return SweepSettings(iterations, k_max, args.seed, engine, tuple(args.task))


def _model_of(args: argparse.Namespace) -> ModelRequest | None:
    """Return the requested model, if any. Raises WrongUse for its options without a file."""
    from rigctl.analysis.training import ModelRequest

    options = ("representation", "components")
    given = {name: value for name in options if (value := getattr(args, name)) is not None}
    if args.save_model is not None:
        return ModelRequest(args.save_model, **given)
    if given:
        raise WrongUse(f"--{next(iter(given))} belongs to a model: name its file with --save-model")
    return None


def _summary(report: ReportResult) -> str:
    """Return the notes, one line for each task, and the paths of the files."""
    from rigctl.analysis.notes import summarise_notes

    lines = [f"note: {note}" for note in summarise_notes(report.remarks)]
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
