"""What an analysis came to, as pages that the window can show. No Qt in here."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from rigctl.analysis.classification.classify_sessions import Classification

Progress = Callable[[str, float], None]

FIGURES = (("fig3", "Accuracy"), ("confusion", "Confusion"), ("fig2c", "One taxel"))


class ResultsPage(NamedTuple):
    """One page: a text in HTML, or the path of a figure, never both."""

    name: str
    html: str = ""
    figure: str = ""


class AnalysisResults(NamedTuple):
    """An answer in a sentence, its pages, and where everything was written."""

    sentence: str
    pages: tuple[ResultsPage, ...]
    folder: str = ""


class AnalysisRequest(NamedTuple):
    """What is to be analysed, as the options of ``rigctl analyse``. ``task``: empty for all.

    ``representation``: of a model to be kept beside the report, empty for none; ``c``: a model
    file that C is taken from, empty for a search.
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


def analyse(order: AnalysisRequest, progress: Progress) -> AnalysisResults:
    """Make a report as ``rigctl analyse`` does. Raises RigctlError."""
    from rigctl.analysis.classification.sweep_engines import SweepEngine
    from rigctl.analysis.classification.training import ModelRequest
    from rigctl.analysis.data.cache import Cache, cache_folder
    from rigctl.analysis.paper.tasks import SweepSettings
    from rigctl.analysis.report.report_folder import ReportRequest, make_report
    from rigctl.encoding.parameters import preset

    out = Path(order.folder)
    tasks = (order.task,) if order.task else ()
    model = None
    if order.representation:
        model = ModelRequest(model_path(out), order.representation, order.components)
    request = ReportRequest(
        tuple(map(Path, order.sessions)),
        out,
        SweepSettings(order.draws, order.components, order.seed, SweepEngine(order.engine), tasks),
        preset(order.preset),
        order.reference_g,
        model=model,
        c=Path(order.c).expanduser() if order.c else None,
        sensitivity=order.sensitivity,
    )
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")

    def tell(stage: str, done: int, all_: int) -> None:
        progress(stage, done / max(all_, 1))

    kept = Cache(cache_folder())
    report = make_report(request, now, kept=kept, progress=tell)
    kept.trim()
    return _report_findings(report, out)


def ask_model(model: str, sessions: tuple[str, ...], progress: Progress) -> AnalysisResults:
    """Classify sessions as ``rigctl classify`` does. Raises RigctlError."""
    from rigctl.analysis.classification.classify_sessions import classify
    from rigctl.analysis.classification.predictions import rows, sentence
    from rigctl.session.files.model_file import load_model

    def tell(stage: str, done: int, all_: int) -> None:
        progress(stage, done / max(all_, 1))

    found = classify(
        load_model(Path(model).expanduser()), tuple(map(Path, sessions)), progress=tell
    )
    marks = {True: "right", False: "<b>wrong</b>", None: "not known to the model"}
    head = ["trial", "true", "mm/s", "g", "answer", "", "posterior", "then", "margin"]
    cells = [
        [
            f"{row['trial_id']}", escape(row["texture"]), f"{row['speed_mm_s']:g}",
            f"{row['force_g']:g}", f"<b>{escape(row['predicted'])}</b>", marks[row["right"]],
            f"{row['posterior']:.1%}", escape(row["runner_up"]), f"{row['margin']:.2f}",
        ]
        for row in rows(found)
    ]  # fmt: skip
    answers = f"<h3>{escape(sentence(found))}</h3>{table(head, cells)}"
    said = [ResultsPage("Answers", answers), ResultsPage("Confusion", _confusion(found))]
    said.append(ResultsPage("Remarks", _listed(found.remarks)))
    return AnalysisResults(sentence(found), tuple(said))


def discard(folder: str) -> None:
    """Remove what a cancelled analysis left: its process was ended before it could."""
    import shutil

    from rigctl.analysis.data.atomic_directory import PARTIAL

    out = Path(folder).absolute()
    shutil.rmtree(out.with_name(PARTIAL.format(name=out.name)), ignore_errors=True)


def model_path(out: Path) -> Path:
    """Where the model of a report is kept: beside its folder."""
    return out.with_name(f"{out.name}-model.h5")


def table(head: list[str], rows: list[list[str]]) -> str:
    """A plain table; cells are HTML."""
    top = "".join(f'<th align="left">{cell}</th>' for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f'<table cellspacing="0" cellpadding="5"><tr>{top}</tr>{body}</table>'


def _report_findings(report: Any, out: Path) -> AnalysisResults:
    from rigctl.analysis.paper.result_tables import table_rows
    from rigctl.analysis.report.html_page import ABSENT

    rows = table_rows(report.results)
    names = list(dict.fromkeys(row["representation"] for row in rows))
    by_task: dict[str, dict[str, Any]] = {}
    for row in rows:
        task = ", ".join(filter(None, (row["task"], row["figure"].replace(" ", "\u00a0"))))
        by_task.setdefault(task, {})[row["representation"]] = row
    cells = []
    for task, ours in by_task.items():
        one = next(iter(ours.values()))
        said = f"{escape(task)}<br><small>{one['components']} components</small>"
        cells.append([said, *(_percent(ours.get(name), ABSENT) for name in names)])
    note = "<p>Ours, mean ± standard deviation in %; below, the paper's.</p>"
    origin = "<p><b>Simulated.</b></p>" if report.made.trials.simulated else ""
    pages = [ResultsPage("Table 1", origin + table(["task", *map(escape, names)], cells) + note)]
    pages += [ResultsPage(title, figure=str(out / f"{stem}.png")) for stem, title in FIGURES]
    if (out / "sensitivity.csv").exists():
        pages.append(ResultsPage("Presets", _csv_table(out / "sensitivity.csv")))
    pages.append(ResultsPage("Remarks", _listed(report.remarks)))
    best = max(report.results[0].curves, key=lambda c: c.mean[report.results[0].shown - 1])
    sentence = (
        f"{report.results[0].task.title}: {best.representation.name} "
        f"{best.mean[report.results[0].shown - 1]:.1%}, chance {report.results[0].chance:.1%}. "
        f"The report is {out / 'report.html'}"
    )
    if report.model is not None:
        sentence += f"; the model is {report.model}"
    return AnalysisResults(sentence, tuple(pages), str(out))


def _percent(row: dict[str, Any] | None, absent: str) -> str:
    if row is None:
        return absent
    sd = "" if row["sd_percent"] is None else f" ± {row['sd_percent']:.2f}"
    theirs = absent
    if row["paper_mean_percent"] is not None:
        theirs = f"{row['paper_mean_percent']:.2f} ± {row['paper_sd_percent']:.2f}"
    return f"{row['mean_percent']:.2f}{sd}<br><small>{theirs}</small>"


def _confusion(found: Classification) -> str:
    names = found.model.classes
    rows = [
        [f"<b>{escape(name)}</b>", *(str(count or "·") for count in row)]
        for name, row in zip(names, found.confusion.tolist(), strict=True)
    ]
    return f"<p>Rows: true; columns: answered.</p>{table(['', *map(escape, names)], rows)}"


def _csv_table(path: Path) -> str:
    import csv

    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    return table(
        [escape(name.replace("_", " ")) for name in rows[0]],
        [[escape(cell) for cell in row] for row in rows[1:]],
    )


def _listed(sentences: tuple[str, ...]) -> str:
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else "<p>Nothing to remark.</p>"
