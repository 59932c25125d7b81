"""Judge the trials of a session anew on their data: verdicts, a table and a page."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.files import atomic_directory
from rigctl.analysis.report.figures import MUTED, RA_COLOUR, SA_COLOUR, new_figure, save_figure
from rigctl.analysis.report.html_page import render_page
from rigctl.encoder.encoder import encode_trial
from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import SessionError
from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import EACH_CONDITION, Quality, condition_of
from rigctl.session.data_quality import (
    BASELINE_SAMPLES,
    GIVEN_UP,
    MARKED,
    PASS,
    QUARANTINE,
    REPEAT,
    SHOWN_PERCENT,
    TITLES,
    VERDICTS,
    TrialHistory,
    TrialStatistics,
    cell_statistics,
)
from rigctl.session.header import IMPORTED
from rigctl.session.layout import PROTOCOL_FILE
from rigctl.session.session import Session
from rigctl.session.trial_sums import TrialSums
from rigctl.values import SAMPLE_RATE_HZ, PlannedTrial, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RESULT, PAGE = "quality.json", "quality.html"
MAX_COLUMNS = 400
"""Columns of the picture; with more trials each is the median of neighbours."""
MAX_ROWS = 500
"""Rows of the page's table."""
Floats = NDArray[np.float64]


class JudgedTrial(NamedTuple):
    """An attempt at a trial: its verdict with reasons, and its statistics where it was recorded."""

    trial: PlannedTrial
    attempt: int
    verdict: str
    reasons: tuple[str, ...]
    statistics: TrialStatistics | None


@dataclass(frozen=True)
class SessionQuality:
    """The attempts of a session in order, each judged beside those before it."""

    path: Path
    simulated: bool
    limits: Quality
    trials: tuple[JudgedTrial, ...]

    def counts(self) -> dict[str, int]:
        """Return the number of attempts with each verdict."""
        found = Counter(one.verdict for one in self.trials)
        return {verdict: found[verdict] for verdict in VERDICTS}


class SessionJudge:
    """Judges the attempts of a session of the drum, which may grow, by its protocol's limits."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._limits, self._stays = _limits_of(session)
        self._history = TrialHistory(self._limits)
        self._baseline: Floats | None = None
        self._judged: list[JudgedTrial] = []

    @property
    def is_behind(self) -> bool:
        """Whether there are attempts to judge yet."""
        return len(self._judged) < len(self._session.trials)

    def judge(
        self,
        progress: Callable[[int, int], object] = lambda done, total: None,
        most: int | None = None,
    ) -> SessionQuality:
        """Judge the attempts that are new, or the first ``most`` of them; return all judged.

        Calls ``progress`` with the attempts judged and all. Raises SessionError.
        """
        session, known = self._session, len(self._judged)
        order = np.argsort(session.trials["started_s"], kind="stable")
        for index in order[known:][:most].tolist():
            self._judged.append(self._judge(index))
            progress(len(self._judged), len(order))
        trials = tuple(_with_given_up(self._judged, session.finished))
        return SessionQuality(session.path, session.header.simulated, self._limits, trials)

    def _judge(self, index: int) -> JudgedTrial:
        session = self._session
        row = session.trial_row(index)
        if row.verdict is not Verdict.COMMITTED or index in session.left_out:
            reasons = row.reasons or (session.left_out.get(index, ""),)
            return JudgedTrial(row.trial, row.attempt, REPEAT, reasons, None)
        statistics = self._with_baseline(trial_statistics(session, index))
        found = self._history.judge(condition_of(row.trial), statistics)
        verdict = REPEAT if found.repeat else QUARANTINE if found.quarantine else PASS
        reasons = found.repeat or found.quarantine
        return JudgedTrial(row.trial, row.attempt, verdict, reasons, statistics)

    def _with_baseline(self, statistics: TrialStatistics) -> TrialStatistics:
        """Return the statistics with the last lifted baseline, where the drum stayed in contact."""
        if np.isfinite(statistics.baseline).all():
            self._baseline = statistics.baseline
        elif self._stays and self._baseline is not None:
            return replace(statistics, baseline=self._baseline)
        return statistics


def judge_session(
    path: Path, progress: Callable[[int, int], object] = lambda done, total: None
) -> SessionQuality:
    """Judge every attempt of a session of the drum as :class:`SessionJudge`.

    Raises SessionError for a session that cannot be read or has no trial.
    """
    with Session.open(path) as session:
        if not len(session.trials):
            raise SessionError(f"{path} has no trial to judge")
        return SessionJudge(session).judge(progress)


def _limits_of(session: Session) -> tuple[Quality, bool]:
    """Return the protocol's limits, and whether the drum stays in contact between repeats."""
    if session.header.rig == IMPORTED:
        return Quality(), False
    protocol = parse_protocol(session.protocol_text, PROTOCOL_FILE, session.config)
    return protocol.quality, protocol.lift == EACH_CONDITION


def _with_given_up(judged: Sequence[JudgedTrial], finished: bool) -> Iterator[JudgedTrial]:
    """Yield the attempts; the last one at a trial of which none is good is given up.

    The newest one of a session that is not finished may be repeated yet.
    """
    good = {one.trial.trial_id for one in judged if one.verdict != REPEAT}
    last = {one.trial.trial_id: number for number, one in enumerate(judged)}
    for number, one in enumerate(judged):
        may_come = number == len(judged) - 1 and not finished
        is_last = number == last[one.trial.trial_id] and not may_come
        given_up = is_last and one.trial.trial_id not in good
        yield one._replace(verdict=GIVEN_UP) if given_up else one


def trial_statistics(session: Session, index: int) -> TrialStatistics:
    """Return the statistics of a recorded attempt, as the engine has them when it ends."""
    samples, header = np.ascontiguousarray(session.samples(index)), session.header
    unit = 1.0 if header.rig == IMPORTED else None  # what an import's full scale was is not known
    sums = TrialSums(header.n_taxels, header.highest_reading, unit)
    sums.add(samples)
    full = np.full(header.n_taxels, header.highest_reading, np.uint16)
    spikes = encode_trial(samples, Normalisation(np.zeros_like(full), full, "whole range"))
    sums.sa_spikes = int(spikes.row_start[header.n_taxels])
    drum = session.drum(index)
    lifted = session.lifted_samples(index, drum, BASELINE_SAMPLES)
    inside = (drum.loadcell_s >= 0) & (drum.loadcell_s <= len(samples) / SAMPLE_RATE_HZ)
    cell = cell_statistics(drum.loadcell["force_g"][inside].astype(np.float64))
    return sums.statistics(lifted.mean(axis=0) if len(lifted) else None, cell)


def as_dict(found: SessionQuality) -> dict[str, Any]:
    """Return the verdicts as values for JSON."""
    return {
        "session": str(found.path),
        "simulated": found.simulated,
        "limits": asdict(found.limits),
        "counts": found.counts(),
        "trials": [
            {
                "trial_id": one.trial.trial_id,
                "attempt": one.attempt,
                "texture": one.trial.texture,
                "speed_mm_s": one.trial.speed_mm_s,
                "force_g": one.trial.force_g,
                "verdict": one.verdict,
                "reasons": list(one.reasons),
            }
            for one in found.trials
        ],
    }


def summary_lines(found: SessionQuality) -> list[str]:
    """Return the verdicts in a line, and the commonest reasons."""
    counts = ", ".join(f"{n:,} {verdict}" for verdict, n in found.counts().items())
    commonest = [f"{n:,} times: {reason}" for reason, n in commonest_reasons(found)]
    return [f"{len(found.trials):,} attempts: {counts}", *commonest]


def commonest_reasons(found: SessionQuality) -> list[tuple[str, int]]:
    """Return the five commonest reasons, without their measured numbers, and how often each is."""
    why = Counter(_kind(reason) for one in found.trials for reason in one.reasons)
    return why.most_common(5)


def _kind(reason: str) -> str:
    """Return a reason without its measured numbers; a taxel keeps its own."""
    return re.sub(r"(?<!taxel )[+-]?\b\d[\d.]*( ?%)?", "…", reason)


def write_quality(found: SessionQuality, out: Path) -> Path:
    """Write quality.html, quality.json and the picture to a new folder; return the page.

    Raises WrongUse where ``out`` exists, DiskFault where it cannot be written.
    """
    with atomic_directory(out) as folder:
        values = as_dict(found)
        text = json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False)
        (folder / RESULT).write_text(text + "\n", encoding="utf-8")
        figure = draw_quality(found, folder / "quality")
        shown = [one for one in values["trials"] if one["verdict"] != PASS]
        page = render_page(
            "quality.html",
            results=values,
            lines=summary_lines(found),
            shown=shown[:MAX_ROWS],
            not_shown=max(0, len(shown) - MAX_ROWS),
            figure=figure,
        )
        (folder / PAGE).write_text(page, encoding="utf-8")
    return out / PAGE


class QualityPicture(NamedTuple):
    """What the picture of a session's quality shows; places count attempts from 0.

    ``off_percent``: float64 (n_taxels, columns), each taxel's mean beside that of equal trials,
    NaN where nothing was recorded; ``edges``: int64 (columns + 1,), first attempt of each column.
    ``drift_at``: int64 (n,), ``drift_counts``: float64 (n, n_taxels), lifted readings less those of
    the first attempt. ``marks``: the attempts of each verdict but *pass*.
    """

    n_attempts: int
    off_percent: Floats
    edges: NDArray[np.int64]
    drift_at: NDArray[np.int64]
    drift_counts: Floats
    marks: dict[str, NDArray[np.int64]]


def picture_of(found: SessionQuality) -> QualityPicture:
    """Return what the picture of a session's quality shows."""
    n = len(found.trials)
    recorded = [number for number, one in enumerate(found.trials) if one.statistics is not None]
    edges = np.linspace(0, n, min(n, MAX_COLUMNS) + 1).astype(np.int64)
    at, drift = _drift(found, recorded)
    marks = {
        verdict: np.array([i for i, one in enumerate(found.trials) if one.verdict == verdict], int)
        for verdict in MARKED
    }
    return QualityPicture(n, _off_percent(found, recorded, edges), edges, at, drift, marks)


def _off_percent(
    found: SessionQuality, recorded: Sequence[int], edges: NDArray[np.int64]
) -> Floats:
    if not recorded:
        return np.zeros((0, len(edges) - 1))
    shares = _shares(found, recorded)
    image = np.full((shares.shape[1], len(edges) - 1), np.nan)
    column = np.searchsorted(edges, recorded, side="right") - 1
    for number in np.unique(column).tolist():
        image[:, number] = 100 * np.median(shares[column == number], axis=0)
    return image


def _shares(found: SessionQuality, recorded: Sequence[int]) -> Floats:
    """Return each taxel's mean as a share of that of its condition, float64 (n, n_taxels).

    What is usual is the median of the trials that passed, of all where none did.
    """
    means = np.array([_statistics(found, number).mean for number in recorded])
    conditions = [condition_of(found.trials[number].trial) for number in recorded]
    passed = {row for row, i in enumerate(recorded) if found.trials[i].verdict == PASS}
    shares = np.zeros_like(means)
    for condition in set(conditions):
        rows = [row for row, one in enumerate(conditions) if one == condition]
        usual = np.median(means[[row for row in rows if row in passed] or rows], axis=0)
        shares[rows] = (means[rows] + 4.0) / (usual + 4.0) - 1.0
    return shares


def _drift(found: SessionQuality, recorded: Sequence[int]) -> tuple[NDArray[np.int64], Floats]:
    known = [n for n in recorded if np.isfinite(_statistics(found, n).baseline).all()]
    baselines = np.array([_statistics(found, number).baseline for number in known])
    return np.array(known, int), baselines - baselines[:1]


def _statistics(found: SessionQuality, number: int) -> TrialStatistics:
    statistics = found.trials[number].statistics
    assert statistics is not None
    return statistics


def draw_quality(found: SessionQuality, stem: Path) -> Path:
    """Draw every taxel over all attempts, its drift, and the verdicts; return the PNG."""
    shown = picture_of(found)
    figure, (taxels, drift, verdicts) = new_figure(
        (10, 8.6), 3, 1, sharex=True, gridspec_kw={"height_ratios": [3, 1.6, 1]}
    )
    _draw_taxels(taxels, shown)
    _draw_drift(drift, shown)
    _draw_verdicts(verdicts, shown)
    verdicts.set(xlabel="attempt", xlim=(0, max(shown.n_attempts, 1)))
    bench = "Simulated bench" if found.simulated else "Real bench"
    origin = f"{bench} · session {found.path.name} · {shown.n_attempts:,} attempts"
    return save_figure(figure, stem, "Quality of the trials", origin)


def _draw_taxels(axes: Axes, shown: QualityPicture) -> None:
    axes.set_title(TITLES[0], loc="left", size=10)
    axes.set(ylabel="taxel")
    axes.grid(visible=False)
    if not shown.off_percent.size:
        return
    drawn = axes.imshow(
        shown.off_percent, aspect="auto", cmap="RdBu_r", interpolation="nearest",
        extent=(0, shown.n_attempts, len(shown.off_percent) + 0.5, 0.5),
        vmin=-SHOWN_PERCENT, vmax=SHOWN_PERCENT,
    )  # fmt: skip
    axes.figure.colorbar(drawn, ax=axes, label="% off", pad=0.01)


def _draw_drift(axes: Axes, shown: QualityPicture) -> None:
    axes.set_title(TITLES[1], loc="left", size=10)
    axes.set(ylabel="counts")
    if not len(shown.drift_at):
        axes.text(0.5, 0.5, "not known", transform=axes.transAxes, ha="center", color=MUTED)
        return
    drift, at = shown.drift_counts, shown.drift_at
    axes.fill_between(at, drift.min(axis=1), drift.max(axis=1), color=SA_COLOUR, alpha=0.25, lw=0)
    axes.plot(at, np.median(drift, axis=1), color=SA_COLOUR, lw=1.0)


def _draw_verdicts(axes: Axes, shown: QualityPicture) -> None:
    """Draw a row of marks for each verdict; the shape tells it, too."""
    colours = {GIVEN_UP: "#c8102e", REPEAT: RA_COLOUR, QUARANTINE: SA_COLOUR}
    for row, (verdict, shape) in enumerate(MARKED.items()):
        at = shown.marks[verdict]
        axes.plot(at, [row] * len(at), shape, color=colours[verdict], ms=7)
    names = [f"{verdict} ({len(at):,})" for verdict, at in shown.marks.items()]
    axes.set_yticks(range(len(names)), names)
    axes.set(ylim=(-0.7, len(names) - 0.3))
