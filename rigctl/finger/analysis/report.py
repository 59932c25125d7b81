"""The report folder of the real-time experiment: complete or absent."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.files import atomic_directory
from rigctl.analysis.notes import summarise_notes
from rigctl.analysis.options import AnalysisOptions
from rigctl.analysis.pca_lda import SweepEngine
from rigctl.analysis.report.html_page import render_page
from rigctl.analysis.report.vega import save_figure
from rigctl.errors import WrongUse
from rigctl.finger.analysis.figures import (
    accuracy_figures,
    answer_figures,
    draw_latencies,
    evidence_figure,
    gain_figure,
    promises_figure,
)
from rigctl.finger.analysis.results import FingerAnalysis, analyse_finger, as_dict
from rigctl.finger.analysis.scans import KINDS, read_data_sets
from rigctl.finger.analysis.tasks import DrawSettings, FingerResult
from rigctl.finger.values import ScanKind

NEAR_POINTS = 10.0
"""A peak at most so many points from the paper's value counts as near it; our choice."""
CAPTIONS = {
    "Fig. 4B": "Figure 4B: same session and new session",
    "Fig. 4C": "Figure 4C: trained and untrained velocity profiles",
    "Fig. S5": "Figure S5: the real-time classifier",
}


class HeldClaim(NamedTuple):
    """At how many of the numbers of components that the paper names its claim holds here.

    ``words``: where the paper has it, such as ``5 to 30``; ``tested`` are those that our training
    set allows.
    """

    words: str
    held: int
    tested: int


def held_double(result: FingerResult) -> HeldClaim:
    """Return where Speed Scaled is better with two asterisks, as the paper says it is."""
    double = [d.stars == "**" and (d.effect or 0.0) > 0 for d in result.differences()]
    return _held(result.task.double, np.array(double, bool))


def held_above(result: FingerResult) -> HeldClaim | None:
    """Return where Speed Scaled is above Original's peak, as the paper says; None: not said."""
    if result.task.above is None:
        return None
    level = result.mean(ScanKind.ORIGINAL).max()
    return _held(result.task.above, result.mean(ScanKind.SPEED_SCALED) > level)


def findings(analysis: FingerAnalysis) -> list[str]:
    """Return what was found: our comparison, the paper's claims, what differs, the answers."""
    sentences = [_comparison(analysis), _claims(analysis), _peaks(analysis)]
    kind = ScanKind.SPEED_SCALED
    sentences += [
        f"After whole scans {one.coverage[-1]:.1%} of {kind.value}'s sets hold the texture "
        f"({one.promised:.0%} promised); they name {one.mean_size[-1]:.1f} of {one.n_classes} "
        f"textures, and in {one.failures[-1]:.0%} of scans all of them."
        for one in analysis.coverage
        if one.kind is kind
    ]
    sentences += [
        f"Of scans of a plate that was never trained, {one.detected[-1]:.0%} are called unknown."
        for one in analysis.novelty
        if one.kind is kind
    ]
    return sentences


def _held(claimed: range, holds: np.ndarray) -> HeldClaim:
    inside = holds[claimed.start - 1 : claimed.stop - 1]
    return HeldClaim(f"{claimed.start} to {claimed.stop - 1}", int(inside.sum()), len(inside))


def _comparison(analysis: FingerAnalysis) -> str:
    pairs, better, components = [], 0, analysis.settings.finger.components
    for result in analysis.tasks:
        k = min(components, result.k_max)
        original, scaled = (float(result.mean(kind)[k - 1]) for kind in KINDS)
        better += scaled > original
        pairs.append(f"{result.task.title.lower()} {scaled:.1%} against {original:.1%}")
    return (
        f"With {components} components, or as many as there are, Speed Scaled is more accurate "
        f"than Original in {better} of {len(pairs)} tasks: {', '.join(pairs)}."
    )


def _claims(analysis: FingerAnalysis) -> str:
    held = [(result.task.title.lower(), held_double(result)) for result in analysis.tasks]
    said = ", ".join(f"{title} {one.held} of {one.tested}" for title, one in held)
    return (
        "Numbers of components at which Speed Scaled is better by two asterisks, of those at which "
        f"the paper has it so: {said}."
    )


def _peaks(analysis: FingerAnalysis) -> str:
    far = []
    for result in analysis.tasks:
        for kind, quoted in zip(KINDS, result.task.quoted, strict=True):
            peak = 100 * float(result.mean(kind).max())
            if abs(peak - quoted.percent) > NEAR_POINTS:
                about = "about " if quoted.components is None else ""
                far.append(
                    f"{result.task.title.lower()}, {kind.value} {peak:.1f} % "
                    f"({about}{quoted.percent:g} % in the paper)"
                )
    if not far:
        return f"Every peak is within {NEAR_POINTS:g} points of the paper's."
    return (
        f"Not reproduced, peaks more than {NEAR_POINTS:g} points from the paper's: "
        f"{'; '.join(far)}."
    )


class FingerReport(NamedTuple):
    """A written report: its page, and its results in sentences."""

    page: Path
    lines: tuple[str, ...]


def report_on(
    options: AnalysisOptions, made_utc: str, resources: Resources = SERIAL_RESOURCES
) -> FingerReport:
    """Write the report that options of ``rigctl analyse`` or of the window ask for.

    Raises as :func:`make_finger_report`, and ConfigError for the analysis file.
    """
    analysis = options.analysis
    draws = analysis.finger.draws if options.iterations is None else options.iterations
    settings = DrawSettings(draws, options.seed, SweepEngine(options.engine), analysis)
    return make_finger_report(options.sessions, options.out, settings, made_utc, resources)


def make_finger_report(
    sessions: Sequence[Path],
    out: Path,
    settings: DrawSettings,
    made_utc: str,
    resources: Resources = SERIAL_RESOURCES,
) -> FingerReport:
    """Read sessions, analyse them, and write the report to a new folder.

    Raises WrongUse where ``out`` exists or the sessions do not fit together, SessionError for
    another kind of folder, DiskFault where the report cannot be written.
    """
    if out.exists():
        raise WrongUse(f"{out} already exists: name another folder, or remove it")
    recorded = read_data_sets(sessions, resources, settings.finger)
    analysis = analyse_finger(
        recorded.data_sets,
        settings,
        resources,
        scaled_currents=recorded.scaled_currents,
        latencies=recorded.latencies,
        remarks=recorded.remarks,
    )
    page = write_finger_report(analysis, out, made_utc, recorded.closing_digests)
    return FingerReport(page, tuple(summary_lines(analysis)))


def write_finger_report(
    analysis: FingerAnalysis,
    out: Path,
    made_utc: str,
    closing_digests: Mapping[str, str] = MappingProxyType({}),
) -> Path:
    """Write report.html, results.json and the figures to a new folder; return the page.

    ``closing_digests``: of the sessions by their paths.
    Raises WrongUse where ``out`` exists, DiskFault where it cannot be written.
    """
    with atomic_directory(out) as folder:
        values = {**as_dict(analysis, made_utc), "closing_digests": dict(closing_digests)}
        values["sentences"] = summary_lines(analysis)
        text = json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False)
        (folder / "results.json").write_text(text + "\n", encoding="utf-8")
        assumptions = {one for task in values["tasks"].values() for one in task["assumptions"]}
        origin = _origin(analysis)
        accuracies = accuracy_figures(values, CAPTIONS)
        evidence, promised = evidence_figure(values), promises_figure(values)
        named = {_stem(figure.title): figure for figure in accuracies}
        confusion, by_profile = answer_figures(values)
        gains = gain_figure(values)
        further = {
            "gains": gains,
            "evidence": evidence,
            "promises": promised,
            "confusion": confusion,
        }
        if by_profile.legend:
            further["profiles"] = by_profile
        for stem, figure in {**named, **further}.items():
            save_figure(figure, folder / stem, origin)
        latencies = None
        if analysis.latencies:
            latencies = draw_latencies(analysis.latencies, origin, folder / "latencies")
        page = render_page(
            "report.html",
            "rigctl.finger.analysis",
            results=values,
            latencies=latencies,
            accuracies=accuracies,
            gains=gains,
            evidence=evidence,
            promises_figure=promised,
            confusion=confusion,
            by_profile=by_profile,
            origin=origin,
            assumptions=sorted(assumptions),
            promises=_promises(analysis),
            findings=findings(analysis),
            held={one.task.key: (held_double(one), held_above(one)) for one in analysis.tasks},
        )
        (folder / "report.html").write_text(page, encoding="utf-8")
    return out / "report.html"


def summary_lines(analysis: FingerAnalysis) -> list[str]:
    """Return the results in sentences, one a line."""
    start = "Simulated: " if analysis.simulated else ""
    lines = [f"note: {note}" for note in summarise_notes(analysis.remarks)]
    for result in analysis.tasks:
        shown = min(analysis.settings.finger.components, result.k_max)
        accuracies = ", ".join(
            f"{kind.value} {result.mean(kind)[shown - 1]:.1%} "
            f"(peak {result.mean(kind).max():.1%} at {int(result.mean(kind).argmax()) + 1})"
            for kind in result.accuracy
        )
        name = f"{result.task.figure} {result.task.title.lower()}"
        lines.append(f"{start}{name}, {shown} components: {accuracies}")
    lines += [start + sentence for sentence in _promises(analysis)]
    for one in analysis.sequential:
        if one.error_rate is not None:
            lines.append(
                f"{start}{one.kind.value}: at an error rate of {one.asked:.0%}, "
                f"{one.answered:.0%} of trials are answered after {one.mean_mm:.0f} mm, "
                f"{one.error_rate:.1%} of them wrongly" + ("" if one.kept else ", MORE than asked")
            )
    for force in analysis.force:
        if force.verdict:
            lines.append(
                f"{start}{force.kind.value}, {force.scaling}: {force.accuracy:.1%}, {force.verdict}"
            )
    return lines


def _promises(analysis: FingerAnalysis) -> list[str]:
    sets = [one.sentence for one in analysis.coverage]
    return sets + [one.sentence for one in analysis.novelty]


def _stem(title: str) -> str:
    """Return the name of a figure's files, such as ``fig4b``."""
    return "fig" + title.partition(":")[0].removeprefix("Figure ").lower()


def _origin(analysis: FingerAnalysis) -> str:
    source = "Simulated finger" if analysis.simulated else "Real finger"
    trained = sum(len(one.training) for one in analysis.data_sets)
    tested = sum(len(one.tested) for one in analysis.data_sets)
    n = len(analysis.data_sets)
    sets = f"{n} data set{'s' if n != 1 else ''}"
    return f"{source} · {sets} · {trained:,} training scans, {tested:,} scans of new sessions"
