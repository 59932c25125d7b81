"""What the answers of a recorded run were like, in sentences."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rigctl.finger_values import PredictionRow
from rigctl.realtime.latency import KINDS, LIMITS_MS
from rigctl.session.finger_session import FingerSession


def answer_lines(folder: Path) -> Iterator[str]:
    """Yield a sentence on the sets, the unknown plates, the early answers and the latencies."""
    with FingerSession.open(folder) as session:
        rows = session.committed().tolist()
        textures = [str(session.trials["texture"][i]) for i in rows]
        answers = [session.predictions(i) for i in rows]
        latencies = session.latencies
    pairs = [(t, found) for t, found in zip(textures, answers, strict=True) if found]
    if pairs:
        yield _sets_line([(texture, found[-1]) for texture, found in pairs])
        yield _early_line(pairs)
    for kind in KINDS:
        ms = latencies["ms"][latencies["kind"] == kind]
        if len(ms):
            middle, high, longest = np.percentile(ms, [50, 99, 100])
            over = [
                f"; TOO SLOW: {percent:g} % must be within {limit:g} ms"
                for percent, limit in LIMITS_MS.get(kind, ())
                if np.percentile(ms, percent) > limit
            ]
            yield (
                f"from a velocity to {kind}: {middle:.1f} ms, 99 % within {high:.1f} ms, "
                f"longest {longest:.1f} ms, n = {len(ms)}" + "".join(over)
            )


def _sets_line(pairs: list[tuple[str, PredictionRow]]) -> str:
    held = sum(texture in answer.texture_set for texture, answer in pairs)
    sizes = [len(answer.texture_set) for _, answer in pairs]
    unknown = sum(not answer.known for _, answer in pairs)
    known = max(len(answer.probabilities) for _, answer in pairs)
    empty = sum(size == known for size in sizes)
    failed = f"; FAILURE: {empty} hold all textures and say nothing" if empty else ""
    return (
        f"sets of textures: {held} of {len(pairs)} hold the true one, mean size "
        f"{np.mean(sizes):.1f} of {known}{failed}; unlike every trained plate: {unknown}"
    )


def _early_line(pairs: list[tuple[str, tuple[PredictionRow, ...]]]) -> str:
    firsts = [(t, next((a for a in found if a.decided), None)) for t, found in pairs]
    decided = [(texture, answer) for texture, answer in firsts if answer is not None]
    if not decided:
        return "early answers: none, the calibration supports none at the error rate asked for"
    right = sum(texture == answer.texture for texture, answer in decided)
    mm = np.mean([answer.distance_mm for _, answer in decided])
    return (
        f"early answers: {len(decided)} scans, after {mm:.0f} mm on average, {right} of them right"
    )
