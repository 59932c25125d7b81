"""What the analysis found, in sentences: the report begins with them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rigctl.analysis.finger.results import FingerAnalysis
from rigctl.analysis.finger.scans import KINDS, ScanKind
from rigctl.analysis.finger.tasks import FingerResult

NEAR_POINTS = 10.0
"""A peak at most so many points from the paper's value counts as near it; our choice."""


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
        f"({one.promised:.0%} promised); they name {one.size[-1]:.1f} of {one.n_classes} textures, "
        f"and in {one.failures[-1]:.0%} of scans all of them."
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
