"""Judge the trials of a session anew on their data: verdicts, a table and a page."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
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
from rigctl.protocol.plan import Quality, condition_of
from rigctl.session.data_quality import (
    BASELINE_SAMPLES,
    TrialHistory,
    TrialStatistics,
    TrialSums,
    cell_statistics,
)
from rigctl.session.header import IMPORTED
from rigctl.session.layout import PROTOCOL_FILE
from rigctl.session.session import Session
from rigctl.values import SAMPLE_RATE_HZ, PlannedTrial, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PASS, REPEAT, QUARANTINE, GIVEN_UP = "pass", "repeat", "quarantine", "given up"
VERDICTS = (PASS, QUARANTINE, REPEAT, GIVEN_UP)
RESULT, PAGE = "quality.json", "quality.html"
MAX_COLUMNS = 400
"""Columns of the picture; with more trials each is the median of neighbours."""
SHOWN_SHARE = 0.3
"""Ends of the colour scale, a share of the usual reading."""
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


def judge_session(
    path: Path, progress: Callable[[int, int], object] = lambda done, total: None
) -> SessionQuality:
    """Judge every attempt of a session of the drum by its protocol's limits.

    Calls ``progress`` with the attempts judged and all. Raises SessionError for a session that
    cannot be read or has no trial.
    """
    with Session.open(path) as session:
        if not len(session.trials):
            raise SessionError(f"{path} has no trial to judge")
        limits = _limits_of(session)
        history = TrialHistory(limits)
        order = np.argsort(session.trials["started_s"], kind="stable")
        judged = []
        for done, index in enumerate(order.tolist(), 1):
            judged.append(_judge(session, index, history))
            progress(done, len(order))
        trials = tuple(_with_given_up(judged))
        return SessionQuality(path, session.header.simulated, limits, trials)


def _limits_of(session: Session) -> Quality:
    if session.header.rig == IMPORTED:
        return Quality()
    return parse_protocol(session.protocol_text, PROTOCOL_FILE, session.config).quality


def _judge(session: Session, index: int, history: TrialHistory) -> JudgedTrial:
    row = session.trial_row(index)
    if row.verdict is not Verdict.COMMITTED or index in session.left_out:
        reasons = row.reasons or (session.left_out.get(index, ""),)
        return JudgedTrial(row.trial, row.attempt, REPEAT, reasons, None)
    statistics = trial_statistics(session, index)
    found = history.judge(condition_of(row.trial), statistics)
    verdict = REPEAT if found.repeat else QUARANTINE if found.quarantine else PASS
    reasons = found.repeat or found.quarantine
    return JudgedTrial(row.trial, row.attempt, verdict, reasons, statistics)


def _with_given_up(judged: list[JudgedTrial]) -> Iterator[JudgedTrial]:
    """Yield the attempts; the last one at a trial of which none is good is given up."""
    good = {one.trial.trial_id for one in judged if one.verdict != REPEAT}
    last = {one.trial.trial_id: number for number, one in enumerate(judged)}
    for number, one in enumerate(judged):
        is_last = number == last[one.trial.trial_id] and one.trial.trial_id not in good
        yield one._replace(verdict=GIVEN_UP) if is_last else one


def trial_statistics(session: Session, index: int) -> TrialStatistics:
    """Return the statistics of a recorded attempt, as the engine has them when it ends."""
    samples, header = np.ascontiguousarray(session.samples(index)), session.header
    sums = TrialSums(header.n_taxels, header.highest_reading)
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
    why = Counter(_kind(reason) for one in found.trials for reason in one.reasons)
    commonest = [f"{n:,} times: {reason}" for reason, n in why.most_common(5)]
    return [f"{len(found.trials):,} attempts: {counts}", *commonest]


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


def draw_quality(found: SessionQuality, stem: Path) -> Path:
    """Draw every taxel over all recorded attempts, its drift, and the verdicts; return the PNG."""
    figure, (taxels, drift, verdicts) = new_figure(
        (10, 8.6), 3, 1, sharex=True, gridspec_kw={"height_ratios": [3, 1.6, 1]}
    )
    recorded = [n for n, one in enumerate(found.trials) if one.statistics is not None]
    edges = np.linspace(0, len(found.trials), min(len(found.trials), MAX_COLUMNS) + 1).astype(int)
    _draw_taxels(taxels, found, recorded, edges)
    _draw_drift(drift, found, recorded)
    _draw_verdicts(verdicts, found)
    verdicts.set(xlabel="attempt", xlim=(0, max(len(found.trials), 1)))
    bench = "Simulated bench" if found.simulated else "Real bench"
    origin = f"{bench} · session {found.path.name} · {len(found.trials):,} attempts"
    return save_figure(figure, stem, "Quality of the trials", origin)


def _shares(found: SessionQuality, recorded: Sequence[int]) -> Floats:
    """Return each taxel's mean as a share of that of its condition, float64 (n, n_taxels)."""
    means = np.array([_statistics(found, n).mean for n in recorded])
    conditions = [condition_of(found.trials[n].trial) for n in recorded]
    shares = np.zeros_like(means)
    for condition in set(conditions):
        rows = [row for row, one in enumerate(conditions) if one == condition]
        usual = np.median(means[rows], axis=0)
        shares[rows] = (means[rows] + 4.0) / (usual + 4.0) - 1.0
    return shares


def _statistics(found: SessionQuality, number: int) -> TrialStatistics:
    statistics = found.trials[number].statistics
    assert statistics is not None
    return statistics


def _draw_taxels(
    axes: Axes, found: SessionQuality, recorded: Sequence[int], edges: NDArray[np.int_]
) -> None:
    axes.set_title("Reading of each taxel beside equal trials", loc="left", size=10)
    axes.set(ylabel="taxel")
    axes.grid(visible=False)
    if not recorded:
        return
    shares = _shares(found, recorded)
    image = np.full((shares.shape[1], len(edges) - 1), np.nan)
    column = np.searchsorted(edges, recorded, side="right") - 1
    for number in set(column.tolist()):
        image[:, number] = np.median(shares[column == number], axis=0)
    extent = (0, edges[-1], shares.shape[1] + 0.5, 0.5)
    drawn = axes.imshow(
        100 * image, aspect="auto", extent=extent, cmap="RdBu_r", interpolation="nearest",
        vmin=-100 * SHOWN_SHARE, vmax=100 * SHOWN_SHARE,
    )  # fmt: skip
    axes.figure.colorbar(drawn, ax=axes, label="% off", pad=0.01)


def _draw_drift(axes: Axes, found: SessionQuality, recorded: Sequence[int]) -> None:
    axes.set_title("Lifted reading since the start", loc="left", size=10)
    axes.set(ylabel="counts")
    if not recorded:
        return
    baselines = np.array([_statistics(found, n).baseline for n in recorded])
    known = np.isfinite(baselines).all(axis=1)
    if not known.any():
        axes.text(0.5, 0.5, "not known", transform=axes.transAxes, ha="center", color=MUTED)
        return
    drift = baselines[known] - baselines[known][0]
    at = np.array(recorded)[known]
    axes.fill_between(at, drift.min(axis=1), drift.max(axis=1), color=SA_COLOUR, alpha=0.25, lw=0)
    axes.plot(at, np.median(drift, axis=1), color=SA_COLOUR, lw=1.0)


def _draw_verdicts(axes: Axes, found: SessionQuality) -> None:
    """Draw a row of marks for each verdict; the shape tells it, too."""
    marks = {GIVEN_UP: ("X", "#c8102e"), REPEAT: ("|", RA_COLOUR), QUARANTINE: ("d", SA_COLOUR)}
    for row, (verdict, (shape, colour)) in enumerate(marks.items()):
        at = [n for n, one in enumerate(found.trials) if one.verdict == verdict]
        axes.plot(at, [row] * len(at), shape, color=colour, ms=7)
    counts = found.counts()
    axes.set_yticks(range(len(marks)), [f"{name} ({counts[name]:,})" for name in marks])
    axes.set(ylim=(-0.7, len(marks) - 0.3))
