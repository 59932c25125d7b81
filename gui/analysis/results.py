"""The results of analyses as pages for the window. This module does not import Qt."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rigctl.analysis.data.notes import summarise_notes

if TYPE_CHECKING:
    from rigctl.analysis.classification.classify_sessions import Classification
    from rigctl.analysis.finger.report import FingerReport
    from rigctl.analysis.report.report_folder import ReportResult
    from rigctl.session.verify.report import VerifyReport

FIGURES = (("fig3", "Accuracy"), ("confusion", "Confusion"), ("fig2c", "One taxel"))
FINGER_FIGURES = (
    ("fig4b", "Figure 4B"),
    ("fig4c", "Figure 4C"),
    ("figs5", "Figure S5"),
    ("evidence", "Evidence"),
    ("promises", "Promises"),
    ("latencies", "Latencies"),
)


class ResultsPage(NamedTuple):
    """One page: an HTML text or the path of a figure."""

    name: str
    html: str = ""
    figure: str = ""


class AnalysisResults(NamedTuple):
    """The result in a sentence, its pages, and the folder of its report if it has one.

    ``altered``: index and reason of each attempt whose rows are not those that were recorded.
    """

    sentence: str
    pages: tuple[ResultsPage, ...]
    folder: str = ""
    altered: tuple[tuple[int, str], ...] = ()


def report_results(report: ReportResult) -> AnalysisResults:
    """Return the results of a report: Table 1, its figures and its remarks."""
    out = report.folder
    pages = [ResultsPage("Table 1", _table_1(report))]
    pages += [ResultsPage(title, figure=str(out / f"{stem}.png")) for stem, title in FIGURES]
    if (out / "sensitivity.csv").exists():
        pages.append(ResultsPage("Presets", _csv_table(out / "sensitivity.csv")))
    pages.append(ResultsPage("Remarks", _bullets(summarise_notes(report.remarks))))
    return AnalysisResults(_report_sentence(report), tuple(pages), str(out))


def finger_results(report: FingerReport) -> AnalysisResults:
    """Return the results of a report on the moving finger: its sentences and figures."""
    out = report.page.parent
    figures = [(title, out / f"{stem}.png") for stem, title in FINGER_FIGURES]
    pages = [ResultsPage(title, figure=str(path)) for title, path in figures if path.exists()]
    pages.append(ResultsPage("In words", _bullets(report.lines)))
    return AnalysisResults(f"The report is {report.page}", tuple(pages), str(out))


def prediction_results(classification: Classification) -> AnalysisResults:
    """Return the predictions of a model: each trial, the confusion matrix and the remarks."""
    from rigctl.analysis.classification.predictions import summary

    verdicts = {True: "correct", False: "<b>wrong</b>", None: "unknown to the model"}
    trained = {True: "trained on it", False: "no", None: "perhaps"}
    head = [
        "Trial", "True", "mm/s", "g", "Predicted", "", "Posterior", "Runner-up", "Margin",
        "Trained on",
    ]  # fmt: skip
    cells = [
        [
            f"{p.trial_id}", escape(p.texture), f"{p.speed_mm_s:g}", f"{p.force_g:g}",
            f"<b>{escape(p.predicted)}</b>", verdicts[p.right], f"{p.posterior:.1%}",
            escape(p.runner_up), f"{p.margin:.2f}",
            trained[p.trained_on],
        ]
        for p in classification.predictions
    ]  # fmt: skip
    predictions = f"<h3>{escape(summary(classification))}</h3>{table(head, cells)}"
    pages = (
        ResultsPage("Predictions", predictions),
        ResultsPage("Confusion", _confusion(classification)),
        ResultsPage("Remarks", _bullets(summarise_notes(classification.remarks))),
    )
    return AnalysisResults(summary(classification), pages)


def verify_results(report: VerifyReport, path: Path, altered: Mapping[int, str]) -> AnalysisResults:
    """Return what a check of a session found, in the words of ``rigctl verify``."""
    from rigctl.session.verify.words import answer, finding_lines

    sentence = answer(report, path)
    digest = f"<p>digest: {escape(report.closing_digest)}</p>" if report.closing_digest else ""
    findings = _bullets(finding_lines(report), "Nothing to note.")
    page = f"<h3>{escape(sentence)}</h3>{findings}{digest}"
    pages = (ResultsPage("Verify", page),)
    return AnalysisResults(sentence, pages, altered=tuple(altered.items()))


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return an HTML table; ``head`` and ``rows`` contain HTML."""
    header = "".join(f'<th align="left">{cell}</th>' for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f'<table cellspacing="0" cellpadding="5"><tr>{header}</tr>{body}</table>'


def _report_sentence(report: ReportResult) -> str:
    """Return the best accuracy in the first task, and the paths of the report and the model."""
    first = report.results[0]
    means = {
        curve.representation.name: curve.mean[first.shown_components - 1] for curve in first.curves
    }
    best = max(means, key=lambda name: means[name])
    sentence = (
        f"{first.task.title}: {best} {means[best]:.1%}, chance {first.chance:.1%}. "
        f"The report is {report.folder / 'report.html'}"
    )
    return sentence if report.model is None else f"{sentence}; the model is {report.model}"


def _table_1(report: ReportResult) -> str:
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
    origin = "<p><b>Simulated.</b></p>" if report.simulated else ""
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


def _confusion(classification: Classification) -> str:
    """Return the matrix of the trials that the model was not trained on, else of all."""
    unseen = classification.unseen
    which = "Trials that the model was trained on; the counts say nothing about others."
    if unseen.n_scored:
        classification, which = unseen, "Trials that the model was not trained on."
    names = classification.model.classes
    rows = [
        [f"<b>{escape(name)}</b>", *(str(count or "·") for count in row)]
        for name, row in zip(names, classification.confusion.tolist(), strict=True)
    ]
    note = f"<p>{which} Rows: true texture; columns: predicted texture.</p>"
    return note + table(["", *map(escape, names)], rows)


def _csv_table(path: Path) -> str:
    import csv

    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    return table(
        [escape(name.replace("_", " ")) for name in rows[0]],
        [[escape(cell) for cell in row] for row in rows[1:]],
    )


def _bullets(sentences: Sequence[str], absent: str = "No remarks.") -> str:
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else f"<p>{absent}</p>"
