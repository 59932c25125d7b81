"""Sessions to a report folder: encode, classify, write. The folder appears whole or not at all."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from rigctl.analysis.classification.training import ModelRequest, train_model
from rigctl.analysis.data.atomic_directory import atomic_directory
from rigctl.analysis.data.cache import Resources
from rigctl.analysis.data.import_remarks import imported_remarks
from rigctl.analysis.data.trial_set import TrialSet, join_sessions
from rigctl.analysis.features.representations import RepresentationSet, represent
from rigctl.analysis.features.spike_counts import RangesOver
from rigctl.analysis.features.transferred_c import ForceMatrixSource, load_c
from rigctl.analysis.paper.ablations import Ablations, measure
from rigctl.analysis.paper.result_tables import as_plain, table_csv
from rigctl.analysis.paper.sensitivity import SensitivityRow, sensitivity
from rigctl.analysis.paper.sensitivity import as_csv as sensitivity_csv
from rigctl.analysis.paper.sensitivity import as_plain as sensitivity_table
from rigctl.analysis.paper.tasks import SweepSettings, TaskResult, run_tasks
from rigctl.analysis.report.example_taxel import check_shown, origin_of, taxel_picture
from rigctl.analysis.report.html_report import html_report
from rigctl.analysis.report.paper_figures import draw_confusion, draw_curves, draw_taxel
from rigctl.encoding.force_matrix import REFERENCE_FORCE_G
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.session.files.model import Model
from rigctl.session.files.model_file import check_output_path, save_model

FEATURES = "features"
CONFUSED = ("untrained-both", "leave-speed-out", "leave-force-out", "textures", "groups")


@dataclass(frozen=True, slots=True)
class ReportRequest:
    """What a report is to hold. ``trial``, ``taxel``: of the one taxel's figure, or None.

    ``model``: one to be kept beside the report. ``c``: a file that C is taken from, not searched.
    ``sensitivity``: whether the other encoder presets are tried too. ``ranges``: of the taxels.
    """

    sessions: tuple[Path, ...]
    out: Path
    settings: SweepSettings = field(default_factory=SweepSettings)
    parameters: EncoderParameters = DEFAULT
    reference_g: float = REFERENCE_FORCE_G
    trial: int | None = None
    taxel: int | None = None
    model: ModelRequest | None = None
    c: Path | None = None
    sensitivity: bool = False
    ranges: RangesOver | Normalisation = RangesOver.ALL


@dataclass(frozen=True, slots=True)
class ReportResult:
    """Where the report is, and what it found."""

    folder: Path
    made: RepresentationSet
    results: tuple[TaskResult, ...]
    remarks: tuple[str, ...]
    model: Path | None = None


def make_report(
    request: ReportRequest,
    made_utc: str,
    resources: Resources | None = None,
) -> ReportResult:
    """Analyse and write. ``made_utc``: wall-clock stamp for the report's foot.

    Raises SessionError or WrongUse for what cannot be analysed, DiskFault where nothing can be
    written; then no report folder is left.
    """
    resources = resources or Resources()
    executor, progress = resources.executor, resources.progress
    trials = join_sessions(request.sessions)
    check_shown(trials, request.trial, request.taxel)
    if request.model is not None:
        check_output_path(request.model.path)
    source = None if request.c is None else load_c(request.c, trials, progress)
    executor.check_visible(trials.paths)
    with atomic_directory(request.out) as folder:
        executor.check_visible([folder])
        found = _find(request, trials, source, folder / FEATURES, made_utc, resources)
        progress("writing the report", 0, 1)
        _write(folder, request, found, made_utc)
        shutil.rmtree(folder / FEATURES)
        if request.model is not None and found.model is not None:
            save_model(found.model, request.model.path)
    progress("writing the report", 1, 1)
    model = request.model.path if request.model is not None else None
    return ReportResult(request.out, found.made, found.results, found.remarks, model)


class _Found(NamedTuple):
    """What goes into the report."""

    made: RepresentationSet
    results: tuple[TaskResult, ...]
    remarks: tuple[str, ...]
    sensitivity: list[SensitivityRow]
    evidence: Ablations | None
    model: Model | None


def _find(
    request: ReportRequest,
    trials: TrialSet,
    source: ForceMatrixSource | None,
    features: Path,
    made_utc: str,
    resources: Resources,
) -> _Found:
    """Encode, classify and train; feature files go into the new folder ``features``."""
    features.mkdir()
    reference_g = request.reference_g
    executor, progress = resources.executor, resources.progress
    made = represent(
        trials,
        request.parameters,
        features,
        reference_g=reference_g,
        source=source,
        ranges=request.ranges,
        resources=resources,
    )
    results, said = run_tasks(made, request.settings, executor=executor, progress=progress)
    evidence = measure(made, results, request.settings, executor=executor, progress=progress)
    remarks = (*imported_remarks(trials), *made.remarks, *said, *_aside(results), *executor.remarks)
    lines: list[SensitivityRow] = []
    if request.sensitivity:
        lines = sensitivity(
            trials,
            (made, results),
            request.settings,
            features,
            reference_g=reference_g,
            source=source,
            ranges=request.ranges,
            resources=resources,
        )
    if request.model is None:
        return _Found(made, tuple(results), remarks, lines, evidence, None)
    model, words = train_model(made, request.model, made_utc, request.settings.seed, progress)
    return _Found(made, tuple(results), (*remarks, words), lines, evidence, model)


def _write(
    folder: Path,
    request: ReportRequest,
    found: _Found,
    made_utc: str,
) -> None:
    made, results = found.made, found.results
    origin = origin_of(made.trials)
    ways = (made.normalisation, made.parameters, request.trial, request.taxel)
    confused = next(r for key in CONFUSED for r in results if r.task.key == key)
    figures = {
        "fig3": draw_curves(results, origin, folder / "fig3"),
        "confusion": draw_confusion(confused, origin, folder / "confusion"),
        "fig2c": draw_taxel(taxel_picture(made.trials, *ways), folder / "fig2c"),
    }
    plain = as_plain(made, request.settings, results, found.remarks, made_utc, found.evidence)
    plain["sensitivity"] = table = sensitivity_table(found.sensitivity)
    if table is not None:
        (folder / "sensitivity.csv").write_text(sensitivity_csv(table), encoding="utf-8")
    # NaN would not be JSON, and nothing here may be one.
    text = json.dumps(plain, indent=1, allow_nan=False, ensure_ascii=False)
    (folder / "results.json").write_text(text + "\n", encoding="utf-8")
    (folder / "table1.csv").write_text(table_csv(results), encoding="utf-8")
    (folder / "report.html").write_text(html_report(plain, figures), encoding="utf-8")


def _aside(results: Sequence[TaskResult]) -> list[str]:
    """Sentences on components that took no part."""
    said = []
    for result in results:
        where = result.task.title.lower()
        for curve in result.curves:
            name = curve.representation.name
            if curve.set_aside:
                said.append(
                    f"{where}, {name}: components in which the trials of each class are all equal "
                    f"(no within-class variance) were set aside, up to {curve.set_aside} in a fit"
                )
            if curve.beyond_rank:
                said.append(
                    f"{where}, {name}: the training trials do not have all components asked for "
                    f"(up to {curve.beyond_rank} fewer); the curve stays level there"
                )
    return said
