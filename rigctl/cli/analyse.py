"""Encode sessions and classify their textures as the paper does.

Encode sessions in the paper's four representations and in others whose force scaling does not
see the texture, classify the textures with 1 to 50 principal components in many draws, and write
a report: report.html, results.json, table1.csv and figures.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from rigctl.analysis.options import DRUM, AnalysisOptions, declared
from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.encoder_options import add_declared, add_resources, options_of, resources_of
from rigctl.errors import WrongUse
from rigctl.experiments import EXPERIMENTS, FINGER_EXPERIMENT

if TYPE_CHECKING:
    from rigctl.analysis.report.report_folder import ReportResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "sessions", a_path, "SESSION", "session folders", nargs="+")
    add_option(parser, "--out", a_path, "REPORT", "new folder", required=True)
    add_declared(parser, AnalysisOptions)
    add_resources(parser)


def run(args: argparse.Namespace) -> int:
    """Make the report; the last lines on standard output name its files."""
    options = options_of(args, AnalysisOptions)
    if options.experiment != DRUM:
        return _run_realtime(options, args)
    from rigctl.analysis.report.report_folder import make_report

    with resources_of(args) as resources:
        report = make_report(options, _now(), resources)
    print(_summary(report), flush=True)
    return 0


def _run_realtime(options: AnalysisOptions, args: argparse.Namespace) -> int:
    """Analyse sessions of the moving finger. Raises WrongUse for an option of the drum's alone."""
    changed = [
        name
        for name, one in declared(AnalysisOptions).items()
        if one.metadata["drum"] and getattr(options, name) != one.default
    ]
    for name in changed or (["dask"] if args.dask is not None else []):
        option = name.replace("_", "-")
        raise WrongUse(f"--{option} belongs to the drum's analysis: leave it out")
    report_on = EXPERIMENTS[FINGER_EXPERIMENT].load("report")
    with resources_of(args) as resources:
        report = report_on(options, _now(), resources)
    files = [f"report: {report.page}", f"results: {options.out / 'results.json'}"]
    print("\n".join([*report.lines, *files]), flush=True)
    return 0


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


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
    lines += [sentence for found in report.further for sentence in found.sentences]
    names = {"report": "report.html", "results": "results.json", "table": "table1.csv"}
    files = {k: report.folder / v for k, v in names.items()}
    if report.model is not None:
        files["model"] = report.model
    return "\n".join([*lines, *(f"{k}: {path}" for k, path in files.items())])
