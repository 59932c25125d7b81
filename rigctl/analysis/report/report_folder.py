"""The report folder of sessions: encode, classify, write. It is complete or absent."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.comparisons import Ablations, measure_ablations
from rigctl.analysis.files import atomic_directory
from rigctl.analysis.force_scaling import load_c
from rigctl.analysis.further_analyses import ANALYSES, check_names, run_further
from rigctl.analysis.options import AnalysisOptions
from rigctl.analysis.report.html_report import html_report
from rigctl.analysis.report.responses import measure_responses
from rigctl.analysis.report.result_figures import (
    accuracy_figure,
    confusion_figures,
)
from rigctl.analysis.report.vega import save_figure
from rigctl.analysis.representations import RepresentationSet, represent
from rigctl.analysis.result_tables import as_dict, to_csv
from rigctl.analysis.sensitivity import as_dict as sensitivity_dict
from rigctl.analysis.sensitivity import compare_presets
from rigctl.analysis.settings import differences_from_paper, to_toml
from rigctl.analysis.study import Findings, Study
from rigctl.analysis.tasks import TaskResult, run_tasks
from rigctl.analysis.taxel import (
    TaxelCourse,
    check_selection,
    draw_taxel,
    load_course,
    trials_origin,
    write_course,
)
from rigctl.analysis.training import train_model
from rigctl.analysis.trial_set import TrialSet, join_sessions
from rigctl.errors import WrongUse
from rigctl.session.analysis_file import check_output_path
from rigctl.session.header import IMPORTED
from rigctl.session.model_file import Model, save_model
from rigctl.session.sensor_passport import load_passport
from rigctl.session.session import Session

FEATURES = "features"
SETTINGS_FILE = "analysis.toml"
"""Every constant of the report, as a file for another analysis."""
IMPORT_EVENT = "import"
"""Kind of the events in which an import records its remarks."""
WHOLE_IMPORT = ("sampled too slowly", "forces are levels", "rows a second: taken at 1 kHz")
"""Words that identify the remarks on every trial of an import."""


@dataclass(frozen=True, slots=True)
class ReportResult:
    """The folder of a report and its results."""

    folder: Path
    simulated: bool
    results: tuple[TaskResult, ...]
    remarks: tuple[str, ...]
    model: Path | None
    further: tuple[Findings, ...] = ()


class _Analysis(NamedTuple):
    """The results of an analysis, before they are written."""

    representations: RepresentationSet
    results: tuple[TaskResult, ...]
    remarks: tuple[str, ...]
    preset_rows: list[dict[str, Any]]
    ablations: Ablations | None
    further: dict[str, Findings]
    model: Model | None
    taxel: TaxelCourse


def make_report(
    options: AnalysisOptions, made_utc: str, resources: Resources = SERIAL_RESOURCES
) -> ReportResult:
    """Analyse the sessions and write the report. ``made_utc``: wall-clock time of the report.

    Raises SessionError, ConfigError or WrongUse for sessions that cannot be analysed in this way,
    DiskFault where nothing can be written; then there is no report folder.
    """
    executor, progress = resources.executor, resources.progress
    check_names(options.also)
    constants, wanted, ranges = options.analysis, options.model, options.taxel_ranges
    trials = join_sessions(options.sessions, progress, options.parameters.reading)
    if wanted is not None:
        check_output_path(wanted.path)
    source = None if options.c is None else load_c(options.c, trials, resources)
    named = options.passport
    passport = None if named is None else load_passport(named, trials.n_taxels)
    executor.check_visible(trials.paths)
    with atomic_directory(options.out) as folder:
        executor.check_visible([folder])
        (folder / FEATURES).mkdir()
        encode = partial(
            represent,
            trials,
            settings=constants,
            source=source,
            passport=passport,
            ranges=ranges,
        )
        analysis = _analyse(options, trials, encode, folder / FEATURES, made_utc, resources)
        progress("writing the report", 0, 1)
        _write(folder, options, analysis, made_utc)
        shutil.rmtree(folder / FEATURES)
        if wanted is not None and analysis.model is not None:
            save_model(analysis.model, wanted.path)
    progress("writing the report", 1, 1)
    model = None if wanted is None else wanted.path
    further = tuple(analysis.further.values())
    return ReportResult(
        options.out, trials.simulated, analysis.results, analysis.remarks, model, further
    )


def _analyse(
    options: AnalysisOptions,
    trials: TrialSet,
    encode: Callable[..., RepresentationSet],
    folder: Path,
    made_utc: str,
    resources: Resources,
) -> _Analysis:
    """Encode, classify and train; feature files go into ``folder``.

    ``encode``: :func:`represent` for the trials; it still takes parameters, folder and resources.
    """
    settings, wanted = options.sweep, options.model
    further: dict[str, Findings] = {}
    representations = encode(options.parameters, folder, resources=resources)
    results, remarks = run_tasks(representations, settings, resources)
    taxel, absent = _chosen_course(representations, options)
    ablations = measure_ablations(representations, results, settings, resources)
    remarks = (
        *differences_from_paper(options.analysis),
        *_import_remarks(trials),
        *representations.remarks,
        *remarks,
        *_component_remarks(results),
        *absent,
    )
    preset_rows: list[dict[str, Any]] = []
    if options.sensitivity:
        base = (representations, results)
        preset_rows = compare_presets(encode, base, settings, folder, resources)
    if options.also:
        study = Study(encode, representations, results, settings, folder, resources)
        further, left_out = run_further(options.also, study)
        remarks = (*remarks, *left_out)
    model = None
    if wanted is not None:
        model, remark = train_model(
            representations, wanted, made_utc, settings.seed, resources.progress
        )
        remarks = (*remarks, remark)
    return _Analysis(
        representations, tuple(results), remarks, preset_rows, ablations, further, model, taxel
    )


def _write(folder: Path, options: AnalysisOptions, analysis: _Analysis, made_utc: str) -> None:
    representations, results = analysis.representations, analysis.results
    trials, ranges = representations.trials, representations.normalisation
    origin = trials_origin(trials)
    taxel = analysis.taxel
    start_s = options.start if options.start < taxel.duration_s else 0.0
    fig2c = draw_taxel(taxel, folder / "fig2c", start_s)
    values = as_dict(
        representations, options.sweep, results, analysis.remarks, made_utc, analysis.ablations
    )
    write_course(taxel, folder / "fig2c.csv")
    values["sensitivity"] = table = sensitivity_dict(analysis.preset_rows)
    if table is not None:
        (folder / "sensitivity.csv").write_text(to_csv(table["rows"]), encoding="utf-8")
    values["further"] = _write_further(folder, analysis.further, origin)
    force = values["force_matrix"]
    if force is not None and force["unconverged_entries"]:
        entries = to_csv(force["unconverged_entries"])
        (folder / "unconverged_c.csv").write_text(entries, encoding="utf-8")
    # JSON has no NaN.
    text = json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False)
    (folder / "results.json").write_text(text + "\n", encoding="utf-8")
    (folder / SETTINGS_FILE).write_text(to_toml(options.analysis), encoding="utf-8")
    (folder / "table1.csv").write_text(to_csv(values["table1"]), encoding="utf-8")
    accuracy, confusions = accuracy_figure(values), confusion_figures(values)
    save_figure(accuracy, folder / "fig3", origin)
    save_figure(confusions[0], folder / "confusion", origin)
    responses = measure_responses(trials, ranges, representations.parameters)
    figures = {name: one.figures for name, one in analysis.further.items()}
    page = html_report(values, accuracy, confusions, responses, fig2c, figures, origin)
    (folder / "report.html").write_text(page, encoding="utf-8")


def _chosen_course(
    representations: RepresentationSet, options: AnalysisOptions
) -> tuple[TaxelCourse, list[str]]:
    """Return the signals of the chosen taxel; of the usual one with a remark if it is not there."""
    trials = representations.trials
    given = (trials, representations.normalisation, representations.parameters)
    try:
        check_selection(trials, options.trial, options.taxel)
        course = load_course(*given, options.trial, options.taxel)
        if options.start >= course.duration_s:
            raise WrongUse(f"--start {options.start:g} is behind the end of the trial")
        return course, []
    except WrongUse as reason:
        return load_course(*given), [f"figure of one taxel: {reason}; it shows the usual one"]


def _write_further(
    folder: Path, further: Mapping[str, Findings], origin: str
) -> dict[str, dict[str, Any]]:
    """Write table and figures of each further analysis; return their values for JSON."""
    values = {}
    for one in ANALYSES:
        if (found := further.get(one.name)) is None:
            continue
        (folder / f"{one.name}.csv").write_text(to_csv(found.rows), encoding="utf-8")
        for number, figure in enumerate(found.figures):
            save_figure(figure, folder / f"{one.name}{f'-{number + 1}' if number else ''}", origin)
        sentences, rows = list(found.sentences), [dict(row) for row in found.rows]
        values[one.name] = {
            "title": one.title, "sentences": sentences, "rows": rows, "note": found.note
        }  # fmt: skip
    return values


def _import_remarks(trials: TrialSet) -> list[str]:
    """Return the remarks that concern a whole import, and the number of the others."""
    remarks = []
    for path, source in zip(trials.paths, trials.provenance, strict=True):
        if source["rig"] != IMPORTED:
            continue
        with Session.open(path) as session:
            lines = [event.text for event in session.events if event.kind == IMPORT_EVENT]
        whole = [line for line in lines if any(words in line for words in WHOLE_IMPORT)]
        remarks += [f"{path}: {line}" for line in whole]
        if len(lines) > len(whole):
            remarks.append(
                f"{path}: its events (kind {IMPORT_EVENT}) hold {len(lines) - len(whole)} more "
                "remarks on single files"
            )
    return remarks


def _component_remarks(results: Sequence[TaskResult]) -> list[str]:
    """Return remarks on components that were not used."""
    remarks = []
    for result in results:
        for curve in result.curves:
            where = f"{result.task.title.lower()}, {curve.representation.name}"
            if curve.n_without_variance:
                remarks.append(
                    f"{where}: components in which the trials of each class are all equal (no "
                    f"within-class variance) were set aside, up to {curve.n_without_variance} in "
                    "a fit"
                )
            if curve.beyond_rank:
                remarks.append(
                    f"{where}: the training trials do not have all requested components (up to "
                    f"{curve.beyond_rank} fewer); the curve is constant there"
                )
    return remarks
