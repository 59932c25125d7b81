"""Sessions to a report folder: encode, classify, write. The folder appears whole or not at all."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rigctl.analysis.carried_c import Source, c_of
from rigctl.analysis.imported import IMPORTED, imported_remarks
from rigctl.analysis.jobs import HERE, Crew, Progress
from rigctl.analysis.report_figures import (
    TaxelPicture,
    confusion_figure,
    curves_figure,
    taxel_figure,
)
from rigctl.analysis.report_html import html_report
from rigctl.analysis.representations import RepresentationSet, represent
from rigctl.analysis.sensitivity import Line, sensitivity
from rigctl.analysis.sensitivity import as_csv as sensitivity_csv
from rigctl.analysis.sensitivity import as_plain as sensitivity_table
from rigctl.analysis.tables import as_plain, table_csv
from rigctl.analysis.tasks import Settings, TaskResult, run_tasks
from rigctl.analysis.training import ModelRequest, train
from rigctl.analysis.trial_set import TrialRef, TrialSet, join_sessions, opened
from rigctl.encoding.encoder import encode_trial, membrane_mv
from rigctl.encoding.force import REFERENCE_FORCE_G
from rigctl.encoding.presets import DEFAULT, EncoderParameters
from rigctl.errors import DiskFault, WrongUse
from rigctl.session.model import Model
from rigctl.session.model_file import check_new, save_model

PARTIAL = "{name}.partial"
FEATURES = "features"
SHOWN_TRIAL = ("L", 80.0, 500.0)
"""Texture, speed and force of the paper's Figure 2C."""
CONFUSED = ("untrained-both", "leave-speed-out", "leave-force-out", "textures", "groups")


@dataclass(frozen=True, slots=True)
class Request:
    """What a report is to hold. ``trial``, ``taxel``: of the one taxel's figure, or None.

    ``model``: one to be kept beside the report. ``c``: a file that C is taken from, not searched.
    ``sensitivity``: whether the other encoder presets are tried too.
    """

    sessions: tuple[Path, ...]
    out: Path
    settings: Settings = field(default_factory=Settings)
    parameters: EncoderParameters = DEFAULT
    reference_g: float = REFERENCE_FORCE_G
    trial: int | None = None
    taxel: int | None = None
    model: ModelRequest | None = None
    c: Path | None = None
    sensitivity: bool = False


@dataclass(frozen=True, slots=True)
class Report:
    """Where the report is, and what it found."""

    folder: Path
    made: RepresentationSet
    results: tuple[TaskResult, ...]
    remarks: tuple[str, ...]
    model: Path | None = None


def make_report(
    request: Request,
    made_utc: str,
    *,
    crew: Crew = HERE,
    progress: Progress = lambda stage, done, all_: None,
) -> Report:
    """Analyse and write. ``made_utc``: wall-clock stamp for the report's foot; ``crew``: who works.

    Raises SessionError or WrongUse for what cannot be analysed, DiskFault where nothing can be
    written; then no report folder is left.
    """
    trials = join_sessions(request.sessions)
    _check_shown(request, trials)
    if request.model is not None:
        check_new(request.model.path)
    source = None if request.c is None else c_of(request.c, trials)
    crew.must_see(trials.paths)
    with _appearing(request.out) as folder:
        crew.must_see([folder])
        found = _find(request, trials, source, folder / FEATURES, made_utc, crew, progress)
        progress("writing the report", 0, 1)
        _write(folder, request, found, made_utc)
        shutil.rmtree(folder / FEATURES)
        if request.model is not None and found.model is not None:
            save_model(found.model, request.model.path)
    progress("writing the report", 1, 1)
    kept = request.model.path if request.model is not None else None
    return Report(request.out, found.made, found.results, found.remarks, kept)


class _Found(NamedTuple):
    """What goes into the report."""

    made: RepresentationSet
    results: tuple[TaskResult, ...]
    remarks: tuple[str, ...]
    sensitivity: list[Line]
    model: Model | None


def _find(
    request: Request,
    trials: TrialSet,
    source: Source | None,
    features: Path,
    made_utc: str,
    crew: Crew,
    progress: Progress,
) -> _Found:
    """Encode, classify and train; feature files go into the new folder ``features``."""
    features.mkdir()
    reference_g = request.reference_g
    made = represent(
        trials,
        request.parameters,
        features,
        reference_g=reference_g,
        source=source,
        crew=crew,
        progress=progress,
    )
    results, said = run_tasks(made, request.settings, crew=crew, progress=progress)
    remarks = (*imported_remarks(trials), *made.remarks, *said, *_aside(results), *crew.remarks)
    lines: list[Line] = []
    if request.sensitivity:
        lines = sensitivity(
            trials,
            (made, results),
            request.settings,
            features,
            reference_g=reference_g,
            source=source,
            crew=crew,
            progress=progress,
        )
    if request.model is None:
        return _Found(made, tuple(results), remarks, lines, None)
    model, words = train(made, request.model, made_utc, request.settings.seed, progress)
    return _Found(made, tuple(results), (*remarks, words), lines, model)


def origin_of(trials: TrialSet) -> str:
    """Where the data come from, for the foot of a figure."""
    rigs = {str(source["rig"]) for source in trials.provenance}
    bench = "Imported recordings" if rigs == {IMPORTED} else "Real bench"
    bench = "Simulated bench" if trials.simulated else bench
    first, n = trials.paths[0].name, len(trials.paths)
    rest = f" and {n - 1} more" if n > 1 else ""
    return f"{bench} · session {first}{rest} · {len(trials.trials):,} trials"


@contextmanager
def _appearing(out: Path) -> Iterator[Path]:
    """A folder beside ``out`` that takes its name at the end; otherwise nothing stays."""
    if out.exists():
        raise WrongUse(f"{out} is there already: name another folder, or remove it")
    folder = out.absolute().with_name(PARTIAL.format(name=out.name))
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise WrongUse(
            f"{folder} is there: another analysis writes it, or was killed; remove it then"
        ) from None
    except OSError as error:
        raise DiskFault(f"{out} cannot be made ({error.strerror}): name another folder") from error
    try:
        yield folder
        folder.rename(out)
    except OSError as error:
        raise DiskFault(
            f"the report cannot be written ({error}): free some space or name another folder"
        ) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _write(
    folder: Path,
    request: Request,
    found: _Found,
    made_utc: str,
) -> None:
    made, results = found.made, found.results
    origin = origin_of(made.trials)
    confused = next(r for key in CONFUSED for r in results if r.task.key == key)
    figures = {
        "fig3": curves_figure(results, origin, folder / "fig3"),
        "confusion": confusion_figure(confused, origin, folder / "confusion"),
        "fig2c": taxel_figure(_taxel_picture(request, made, origin), folder / "fig2c"),
    }
    plain = as_plain(made, request.settings, results, found.remarks, made_utc)
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


def _check_shown(request: Request, trials: TrialSet) -> None:
    if request.taxel is not None and not 1 <= request.taxel <= trials.n_taxels:
        raise WrongUse(f"there is no taxel {request.taxel}: choose 1 to {trials.n_taxels}")
    if request.trial is not None and not any(t.trial_id == request.trial for t in trials.trials):
        raise WrongUse(f"no session has a committed trial {request.trial} with motion")


def _taxel_picture(request: Request, made: RepresentationSet, origin: str) -> TaxelPicture:
    """Figure 2C for the trial and taxel asked for, or the one most like the paper's."""
    trial = _shown_trial(request, made.trials)
    with opened(made.trials.files) as reader:
        samples = reader.of(trial)
    ranges = made.normalisation
    x = (samples.astype(np.float64) - ranges.low) * ranges.scale
    taxel = request.taxel - 1 if request.taxel else int(x.std(axis=0).argmax())
    n = made.trials.n_taxels
    spikes = encode_trial(samples, ranges, made.parameters)
    voltage = membrane_mv(samples, ranges, made.parameters)[:, [taxel, n + taxel]]
    title = (
        f"Texture {trial.texture} at {trial.speed_mm_s:g} mm/s and {trial.force_g:g} g: "
        f"taxel {taxel + 1} of trial {trial.trial_id}, up to its first second (as Fig. 2C)"
    )
    trains = (spikes.train(taxel), spikes.train(n + taxel))
    return TaxelPicture(title, origin, x[:, taxel], voltage, trains)


def _shown_trial(request: Request, trials: TrialSet) -> TrialRef:
    texture, speed, force = SHOWN_TRIAL
    if request.trial is not None:
        asked = [t for t in trials.trials if t.trial_id == request.trial]
        if not asked:
            raise WrongUse(f"trial {request.trial} has gaps: choose another for the figure")
        return asked[0]

    def unlike(t: TrialRef) -> tuple[bool, float, float]:
        return t.texture != texture, abs(t.speed_mm_s - speed), abs(t.force_g - force)

    return min(trials.trials, key=unlike)
