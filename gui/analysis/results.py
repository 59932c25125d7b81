"""Analyses and their results as pages for the window. This module does not import Qt."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from rigctl.analysis.classification.classify_sessions import Classification

Progress = Callable[[str, float], None]
"""Takes the stage of the work and its progress from 0 to 1."""

FIGURES = (("fig3", "Accuracy"), ("confusion", "Confusion"), ("fig2c", "One taxel"))


class ResultsPage(NamedTuple):
    """One page: an HTML text or the path of a figure."""

    name: str
    html: str = ""
    figure: str = ""


class AnalysisResults(NamedTuple):
    """The result in a sentence, its pages, and the folder of the report."""

    sentence: str
    pages: tuple[ResultsPage, ...]
    folder: str = ""


class AnalysisRequest(NamedTuple):
    """The options of ``rigctl analyse``.

    ``task``: empty for all. ``representation``: that of a model to save beside the report, empty
    for none. ``c``: a model file that C is taken from, empty for a search.
    """

    sessions: tuple[str, ...]
    folder: str
    task: str = ""
    draws: int = 20
    components: int = 50
    engine: str = "own"
    preset: str = "default"
    reference_g: float = 500.0
    seed: int = 0
    sensitivity: bool = False
    representation: str = ""
    c: str = ""


def analyse(request: AnalysisRequest, progress: Progress) -> AnalysisResults:
    """Write a report as ``rigctl analyse`` does. Raises RigctlError."""
    from rigctl.analysis.classification.sweep_engines import SweepEngine
    from rigctl.analysis.classification.training import ModelRequest
    from rigctl.analysis.data.cache import Cache, Resources, cache_folder
    from rigctl.analysis.paper.tasks import SweepSettings
    from rigctl.analysis.report.report_folder import ReportRequest, make_report
    from rigctl.encoding.parameters import preset

    out = Path(request.folder)
    tasks = (request.task,) if request.task else ()
    engine = SweepEngine(request.engine)
    model = None
    if request.representation:
        model = ModelRequest(model_path(out), request.representation, request.components)
    report_request = ReportRequest(
        tuple(map(Path, request.sessions)),
        out,
        SweepSettings(request.draws, request.components, request.seed, engine, tasks),
        preset(request.preset),
        request.reference_g,
        model=model,
        c=Path(request.c).expanduser() if request.c else None,
        sensitivity=request.sensitivity,
    )
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    cache = Cache(cache_folder())
    report = make_report(report_request, now, Resources(cache=cache, progress=_counted(progress)))
    cache.trim()
    return _report_results(report, out)


def classify_sessions(model: str, sessions: tuple[str, ...], progress: Progress) -> AnalysisResults:
    """Classify sessions as ``rigctl classify`` does. Raises RigctlError."""
    from rigctl.analysis.classification.classify_sessions import classify
    from rigctl.analysis.classification.predictions import prediction_rows, summary
    from rigctl.analysis.data.cache import Resources
    from rigctl.session.files.model_file import load_model

    loaded = load_model(Path(model).expanduser())
    resources = Resources(progress=_counted(progress))
    found = classify(loaded, tuple(map(Path, sessions)), resources)
    verdicts = {True: "correct", False: "<b>wrong</b>", None: "unknown to the model"}
    head = [
        "Trial", "True", "mm/s", "g", "Predicted", "", "Posterior", "Runner-up", "Margin",
    ]  # fmt: skip
    cells = [
        [
            f"{row['trial_id']}", escape(row["texture"]), f"{row['speed_mm_s']:g}",
            f"{row['force_g']:g}", f"<b>{escape(row['predicted'])}</b>", verdicts[row["right"]],
            f"{row['posterior']:.1%}", escape(row["runner_up"]), f"{row['margin']:.2f}",
        ]
        for row in prediction_rows(found)
    ]  # fmt: skip
    predictions = f"<h3>{escape(summary(found))}</h3>{table(head, cells)}"
    pages = (
        ResultsPage("Predictions", predictions),
        ResultsPage("Confusion", _confusion(found)),
        ResultsPage("Remarks", _bullets(found.remarks)),
    )
    return AnalysisResults(summary(found), pages)


def _counted(progress: Progress) -> Callable[[str, int, int], None]:
    """Return a callback that takes a count and its total instead of a share."""
    return lambda stage, n_done, n_total: progress(stage, n_done / max(n_total, 1))


def discard(folder: str) -> None:
    """Remove the partial report of a cancelled analysis, whose process could not do so itself."""
    import shutil

    from rigctl.analysis.data.atomic_directory import PARTIAL

    out = Path(folder).absolute()
    shutil.rmtree(out.with_name(PARTIAL.format(name=out.name)), ignore_errors=True)


def model_path(out: Path) -> Path:
    """Return the path of a report's model: beside its folder."""
    return out.with_name(f"{out.name}-model.h5")


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return an HTML table; the cells are HTML, too."""
    header = "".join(f'<th align="left">{cell}</th>' for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f'<table cellspacing="0" cellpadding="5"><tr>{header}</tr>{body}</table>'


def _report_results(report: Any, out: Path) -> AnalysisResults:
    pages = [ResultsPage("Table 1", _table_1(report))]
    pages += [ResultsPage(title, figure=str(out / f"{stem}.png")) for stem, title in FIGURES]
    if (out / "sensitivity.csv").exists():
        pages.append(ResultsPage("Presets", _csv_table(out / "sensitivity.csv")))
    pages.append(ResultsPage("Remarks", _bullets(report.remarks)))
    first = report.results[0]
    means = {
        curve.representation.name: curve.mean[first.shown_components - 1] for curve in first.curves
    }
    best = max(means, key=lambda name: means[name])
    sentence = (
        f"{first.task.title}: {best} {means[best]:.1%}, chance {first.chance:.1%}. "
        f"The report is {out / 'report.html'}"
    )
    if report.model is not None:
        sentence += f"; the model is {report.model}"
    return AnalysisResults(sentence, tuple(pages), str(out))


def _table_1(report: Any) -> str:
    """Return our accuracies above the paper's: one row per task, one column per representation."""
    from rigctl.analysis.paper.result_tables import table_rows
    from rigctl.analysis.report.html_page import ABSENT

    rows = table_rows(report.results)
    names = list(dict.fromkeys(row["representation"] for row in rows))
    by_task: dict[str, dict[str, Any]] = {}
    for row in rows:
        task = ", ".join(filter(None, (row["task"], row["figure"].replace(" ", "\u00a0"))))
        by_task.setdefault(task, {})[row["representation"]] = row
    cells = []
    for task, accuracies in by_task.items():
        components = next(iter(accuracies.values()))["components"]
        title = f"{escape(task)}<br><small>{components} components</small>"
        cells.append([title, *(_percent(accuracies.get(name), ABSENT) for name in names)])
    origin = "<p><b>Simulated.</b></p>" if report.representations.trials.simulated else ""
    note = "<p>Accuracy in %, mean ± standard deviation; the paper's values are in small type.</p>"
    return origin + table(["Task", *map(escape, names)], cells) + note


def _percent(row: dict[str, Any] | None, absent: str) -> str:
    if row is None:
        return absent
    sd = "" if row["sd_percent"] is None else f" ± {row['sd_percent']:.2f}"
    paper = absent
    if row["paper_mean_percent"] is not None:
        paper = f"{row['paper_mean_percent']:.2f} ± {row['paper_sd_percent']:.2f}"
    return f"{row['mean_percent']:.2f}{sd}<br><small>{paper}</small>"


def _confusion(found: Classification) -> str:
    names = found.model.classes
    rows = [
        [f"<b>{escape(name)}</b>", *(str(count or "·") for count in row)]
        for name, row in zip(names, found.confusion.tolist(), strict=True)
    ]
    note = "<p>Rows: true texture; columns: predicted texture.</p>"
    return note + table(["", *map(escape, names)], rows)


def _csv_table(path: Path) -> str:
    import csv

    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    return table(
        [escape(name.replace("_", " ")) for name in rows[0]],
        [[escape(cell) for cell in row] for row in rows[1:]],
    )


def _bullets(sentences: tuple[str, ...]) -> str:
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else "<p>No remarks.</p>"
