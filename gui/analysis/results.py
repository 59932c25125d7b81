"""The results of analyses as pages for the window. This module does not import Qt."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from gui.analysis.value_file import data_words, rows_csv
from rigctl.analysis.notes import summarise_notes
from rigctl.analysis.report.figure import Figure, Matrix, Panel, Series
from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from rigctl.analysis.classify_sessions import Classification
    from rigctl.analysis.report.demo import DemoResult
    from rigctl.analysis.report.report_folder import ReportResult
    from rigctl.finger.analysis.report import FingerReport
    from rigctl.session.verify import VerifyReport


CURVE_NAMES = (
    "plot", "curve", "x is", "x", "y is", "y", "bar from", "bar to", "asterisks", "dotted line",
    "the paper's value",
)  # fmt: skip
CELL_NAMES = (
    "task", "representation", "true texture", "predicted texture", "count (trials)",
    "share of the true texture (%)",
)  # fmt: skip
PROFILE_NAMES = ("representation", "velocity profile", "right (scans)", "tested (scans)")


def figures_csv(figures: Sequence[Figure]) -> str:
    """Return every point of every curve, or every cell of every matrix, as a row."""
    if figures[0].matrices:
        return rows_csv(CELL_NAMES, (row for one in figures for row in _cells(one)))
    return rows_csv(CURVE_NAMES, (row for one in figures for row in _points(one)))


def _points(figure: Figure) -> Iterator[tuple[object, ...]]:
    for panel in figure.plots:
        level = "" if panel.level is None else f"{panel.level[0]:.4f}"
        for one in panel.series:
            published = "; ".join(value.text for value in one.published)
            for i, (x, y) in enumerate(zip(one.x, one.y, strict=True)):
                ends = [f"{end:.4f}" for end in one.ends(i) or ()] or ("", "")
                stars = one.stars[i] if one.stars else ""
                point = (panel.x_label, f"{x:g}", panel.y_label, f"{y:.4f}", *ends)
                yield (panel.title, one.name, *point, stars, level, published)


def _cells(figure: Figure) -> Iterator[tuple[object, ...]]:
    for matrix in figure.matrices:
        for row, true in enumerate(matrix.classes):
            for column, predicted in enumerate(matrix.classes):
                percent = f"{100 * matrix.share(row, column):.4f}"
                cell = (true, predicted, matrix.counts[row][column], percent)
                yield (figure.title, matrix.name, *cell)


def point_words(panel: Panel, curve: Series, i: int) -> str:
    """Return a point of a curve in words, with the paper's values of the curve."""
    x = curve.x[i]
    words = f"{panel.title} · {curve.name}, {panel.x_name or panel.x_label} {x:g}"
    value = curve.words_at(x, panel.unit)
    others = [one.text for one in curve.published if one.x != x]
    return " · ".join([f"{words}: {value}", *others])


TRAINED = "Trials that the model was trained on; the counts say nothing about others."
UNSEEN = "Trials that the model was not trained on."
LATENCY_NAMES = ("latency", "number", "p50 (ms)", "p99 (ms)", "p99.9 (ms)", "largest (ms)")
PREDICTION_NAMES = (
    "session", "trial", "true texture", "speed (mm/s)", "force (g)", "predicted texture", "right",
    "posterior probability", "runner-up", "margin (log posterior)", "model was trained on it",
)  # fmt: skip


class ResultsPage(NamedTuple):
    """One page: figures to plot, the path of a picture, or an HTML text.

    ``origin``: of the plotted figures. ``csv``: the numbers of the page, with their units.
    """

    name: str
    html: str = ""
    figure: str = ""
    plots: tuple[Figure, ...] = ()
    origin: str = ""
    csv: str = ""


class AnalysisResults(NamedTuple):
    """The result in a sentence, its pages, and the folder of its report if it has one.

    ``altered``: index and reason of each attempt whose rows are not those that were recorded.
    ``name``: begins the names of files. ``simulated``: whether any of the data is, or the model.
    ``data``: where the data come from, if it takes more words. ``is_alarming``: whether the
    sentence says that a session is not whole.
    """

    sentence: str
    pages: tuple[ResultsPage, ...]
    folder: str = ""
    altered: tuple[tuple[int, str], ...] = ()
    name: str = "results"
    simulated: bool = False
    data: str = ""
    is_alarming: bool = False

    @property
    def origin(self) -> str:
        """Where the numbers come from, as figures and files say it."""
        return f"{self.data or data_words(simulated=self.simulated)} · {self.name}"


def plot_page(name: str, origin: str, *figures: Figure) -> ResultsPage:
    """Return a page that plots figures: one of curves, or one or more of matrices."""
    return ResultsPage(name, plots=figures, origin=origin, csv=figures_csv(figures))


def report_results(report: ReportResult) -> AnalysisResults:
    """Return the results of a report: Table 1, its figures and its remarks."""
    from rigctl.analysis.report.result_figures import accuracy_figure, confusion_figures

    out = report.folder
    values = _values(out)
    origin = f"{data_words(simulated=report.simulated)} · {out.name}"
    pages = [
        ResultsPage("Table 1", _table_1(report), csv=_text(out / "table1.csv")),
        plot_page("Accuracy", origin, accuracy_figure(values)),
        plot_page("Confusion", origin, *confusion_figures(values, blind=True)),
        ResultsPage("One taxel", figure=str(out / "fig2c.png"), csv=_text(out / "fig2c.csv")),
    ]
    if (out / "sensitivity.csv").exists():
        presets = out / "sensitivity.csv"
        pages.append(ResultsPage("Presets", _csv_table(presets), csv=_text(presets)))
    for name, one in values["further"].items():
        table, picture = out / f"{name}.csv", out / f"{name}.png"
        if picture.exists():
            pages.append(ResultsPage(one["title"], figure=str(picture), csv=_text(table)))
        else:
            pages.append(ResultsPage(one["title"], _csv_table(table), csv=_text(table)))
    pages.append(_words_page("Remarks", summarise_notes(report.remarks)))
    sentence = _report_sentence(report)
    return AnalysisResults(
        sentence, tuple(pages), str(out), name=out.name, simulated=report.simulated
    )


def finger_results(report: FingerReport) -> AnalysisResults:
    """Return the results of a report on the moving finger: its sentences and figures."""
    from rigctl.finger.analysis.figures import (
        accuracy_figures,
        answer_figures,
        evidence_figure,
        gain_figure,
        promises_figure,
    )
    from rigctl.finger.analysis.report import CAPTIONS

    out = report.page.parent
    values = _values(out)
    origin = f"{data_words(simulated=values['simulated'])} · {out.name}"
    figures = {one.title.partition(":")[0]: one for one in accuracy_figures(values, CAPTIONS)}
    figures |= {
        "Force scaling": gain_figure(values),
        "Evidence": evidence_figure(values),
        "Promises": promises_figure(values),
    }
    figures["Confusion"] = answer_figures(values)[0]
    pages = [plot_page(name, origin, figure) for name, figure in figures.items()]
    if (profiles := out / "profiles.png").exists():
        answers = (
            (one["kind"], name, one["right"][name], tested)
            for one in values["answers"]
            for name, tested in one["tested"].items()
        )
        csv = rows_csv(PROFILE_NAMES, answers)
        pages.append(ResultsPage("Profiles", figure=str(profiles), csv=csv))
    if values["latencies"]:
        rows = [(kind, *one.values()) for kind, one in values["latencies"].items()]
        path, csv = out / "latencies.png", rows_csv(LATENCY_NAMES, rows)
        pages.append(ResultsPage("Latencies", figure=str(path), csv=csv))
    pages.append(_words_page("In words", report.lines))
    sentence = f"The report is {report.page}"
    return AnalysisResults(
        sentence, tuple(pages), str(out), name=out.name, simulated=values["simulated"]
    )


def quick_results(demo: DemoResult) -> AnalysisResults:
    """Return the results of the quick check: accuracy, confusion, spikes of a trial, remarks."""
    from rigctl.analysis.report.demo import held_out_accuracy, held_out_confusion

    sentence = ". ".join((demo.sentence, *demo.remarks))
    pages = (
        plot_page("Accuracy", demo.origin, held_out_accuracy(demo.held_out)),
        plot_page("Confusion", demo.origin, held_out_confusion(demo.held_out)),
        ResultsPage("Spikes", figure=str(demo.raster), csv=_spikes_csv(demo)),
        _words_page("In words", (demo.sentence, *demo.remarks)),
    )
    return AnalysisResults(sentence, pages, name="quick-check", simulated=demo.simulated)


def prediction_results(classification: Classification) -> AnalysisResults:
    """Return the predictions of a model: each trial, the confusion matrix and the remarks."""
    from rigctl.analysis.classify_sessions import summary

    verdicts = {True: "correct", False: "<b>wrong</b>", None: "unknown to the model"}
    trained = {True: "trained on it", False: "no"}
    head = [
        "Trial", "True", "mm/s", "g", "Predicted", "", "Posterior", "Runner-up",
        "Margin (log posterior)", "Trained on",
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
    csv = rows_csv(PREDICTION_NAMES, classification.predictions)
    data = _data_and_model(classification)
    sessions = ", ".join(path.name for path in classification.trials.paths)
    origin = f"{data} · {sessions}"
    pages = (
        ResultsPage("Predictions", predictions, csv=csv),
        plot_page("Confusion", origin, _model_confusion(classification)),
        _words_page("Remarks", summarise_notes(classification.remarks)),
    )
    simulated = classification.trials.simulated or classification.model.training.simulated
    return AnalysisResults(
        summary(classification), pages, name="predictions", simulated=simulated, data=data
    )


def verify_results(
    report: VerifyReport, path: Path, altered: Mapping[int, str], *, simulated: bool
) -> AnalysisResults:
    """Return what a check of a session found, in the words of ``rigctl verify``."""

    sentence = report.answer(path)
    digest = f"<p>digest: {escape(report.closing_digest)}</p>" if report.closing_digest else ""
    findings = _bullets(report.lines(), "Nothing to note.")
    page = f"<h3>{escape(sentence)}</h3>{findings}{digest}"
    csv = rows_csv(("finding",), [[line] for line in report.lines()])
    pages = (ResultsPage("Verify", page, csv=csv),)
    found = tuple(altered.items())
    return AnalysisResults(
        sentence,
        pages,
        altered=found,
        name="verify",
        simulated=simulated,
        is_alarming=not report.whole,
    )


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return an HTML table; ``head`` and ``rows`` contain HTML."""
    header = "".join(f'<th align="left">{cell}</th>' for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f'<table cellspacing="0" cellpadding="5"><tr>{header}</tr>{body}</table>'


def _spikes_csv(demo: DemoResult) -> str:
    """Return every spike of the trial in the quick check's raster."""
    spikes = demo.shown.spikes
    half = spikes.n_trains // 2
    names = [f"{kind} {i + 1}" for kind in ("SA", "RA") for i in range(half)]
    rows = [
        (name, f"{sample / SAMPLE_RATE_HZ:.3f}")
        for train, name in enumerate(names)
        for sample in spikes.train(train).tolist()
    ]
    return rows_csv(("neuron", "spike (s)"), rows)


def _model_confusion(classification: Classification) -> Figure:
    """Return the matrix of the trials that the model was not trained on, else of all."""
    unseen, model = classification.unseen, classification.model
    shown, note = (unseen, UNSEEN) if unseen.n_scored else (classification, TRAINED)
    lines = [f"{model.components} components", note]
    matrix = Matrix(model.representation, lines, model.classes, shown.confusion.tolist())
    return Figure("Trained model", [matrix])


def _data_and_model(classification: Classification) -> str:
    """Return where the trials come from, and the model's where that is another origin."""
    trials, model = classification.trials.simulated, classification.model.training.simulated
    words = data_words(simulated=trials)
    if model == trials:
        return words
    return f"{words}, {'SIMULATED' if model else 'recorded'} model"


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
    from rigctl.analysis.report.html_page import ABSENT
    from rigctl.analysis.result_tables import table_rows

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


def _words_page(name: str, sentences: Sequence[str]) -> ResultsPage:
    csv = rows_csv((name.lower(),), [[sentence] for sentence in sentences])
    return ResultsPage(name, _bullets(sentences), csv=csv)


def _values(report: Path) -> dict[str, Any]:
    """Return what a report of this program has written as its results."""
    values: dict[str, Any] = json.loads(_text(report / "results.json"))
    return values


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


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
