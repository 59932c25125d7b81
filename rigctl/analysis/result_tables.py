"""What a classifier learns of how the plates sat: accuracy with the same and another mounting."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from rigctl import __version__
from rigctl.analysis import published
from rigctl.analysis.comparisons import (
    Ablations,
    Agreement,
    RepresentationPair,
    compare_task,
    components_needed,
    curve_differences,
    explain,
)
from rigctl.analysis.force_scaling import (
    count_search_statuses,
    force_sentence,
    unconverged_entries,
    unconverged_shares,
)
from rigctl.analysis.representations import RepresentationSet
from rigctl.analysis.settings import as_plain
from rigctl.analysis.statistics import (
    NOT_IN_PAPER,
    Difference,
    confusion_shares,
    difference_dict,
    standard_error,
    task_curve_tests,
    tests_rule,
)
from rigctl.analysis.tasks import Curve, SweepSettings, TaskResult

GAP_DECIMALS = 3
PAIRS = (
    ("trained-mount", "leave-mount-out"),
    ("trained-mount-untrained-speed", "leave-mount-out-untrained-speed"),
)
"""Tasks of the same fits, tested with the trained mountings and with one that was left out."""
DECIMALS = 4
LABELS_SEEN = (
    "C is indexed by the true texture: in the Force Scaled and the Speed and Force Scaled "
    "representation a test trial is scaled by the C of its own texture, so the classifier is "
    "given part of the answer. C was also computed from every force, the untrained one included: "
    "that force is new to the classifier, but not to C. The texture-blind rows use the mean of C "
    "over the textures instead and use no label, but it too is computed from every force."
)


def describe_mountings(results: Sequence[TaskResult]) -> list[dict[str, Any]]:
    """Return what a plate's own seat contributes, for JSON, in per cent and percentage points.

    A mapping for each representation in each pair of tasks that was run; ``sd_points``: standard
    deviation of the difference over draws (n − 1), None for a single draw.
    """
    by_key = {result.task.key: result for result in results}
    return [
        _mounting_gap(other_key, curve, beside, min(same.shown_components, other.shown_components))
        for same_key, other_key in PAIRS
        if (same := by_key.get(same_key)) and (other := by_key.get(other_key))
        for curve in same.curves
        if (beside := other.curve(curve.representation.key))
    ]


def _mounting_gap(task: str, same: Curve, other: Curve, k: int) -> dict[str, Any]:
    """Return the gap between two curves of the same draws, with ``k`` components."""
    by_draw = same.accuracy[:, k - 1] - other.accuracy[:, k - 1]
    known, unknown = float(same.mean[k - 1]), float(other.mean[k - 1])
    spread = round(100 * float(by_draw.std(ddof=1)), GAP_DECIMALS) if len(by_draw) > 1 else None
    return {
        "task": task,
        "untrained_speed": task != PAIRS[0][1],
        "representation": same.representation.key,
        "components": k,
        "same_mounting_percent": round(100 * known, GAP_DECIMALS),
        "other_mounting_percent": round(100 * unknown, GAP_DECIMALS),
        "points": round(100 * (known - unknown), GAP_DECIMALS),
        "sd_points": spread,
    }


def table_rows(results: Sequence[TaskResult]) -> list[dict[str, Any]]:
    """Return Table 1, ours beside the paper's: a mapping for each task and representation."""
    rows = []
    for result in results:
        for curve in result.curves:
            mean, sd = shown_percent(result, curve)
            theirs = published.TABLE_1.get(result.task.key, {}).get(curve.representation.key)
            paper_mean, paper_sd = theirs or (None, None)
            row = {
                "task": result.task.title,
                "figure": result.task.figure,
                "representation": curve.representation.name,
                "components": result.shown_components,
                "mean_percent": mean,
                "sd_percent": sd,
                "iterations": len(curve.accuracy),
                "tested_per_iteration": curve.n_tested,
                "paper_mean_percent": paper_mean,
                "paper_sd_percent": paper_sd,
                "c_knows_the_label": curve.representation.sees_labels,
                "scaling_knows": curve.representation.knows,
            }
            rows.append(row)
    return rows


def to_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return mappings with equal keys as CSV: yes and no for a bool, nothing for None."""
    out = io.StringIO()
    writer = csv.DictWriter(out, rows[0], lineterminator="\n")
    writer.writeheader()
    words = {True: "yes", False: "no"}
    for row in rows:
        writer.writerow({k: words[v] if isinstance(v, bool) else v for k, v in row.items()})
    return out.getvalue()


def shown_percent(result: TaskResult, curve: Curve) -> tuple[float, float | None]:
    """Return μ and σ in per cent with the shown components."""
    k = result.shown_components - 1
    sd = None if curve.sd is None else round(100 * float(curve.sd[k]), DECIMALS)
    return round(100 * float(curve.mean[k]), DECIMALS), sd


def as_dict(
    representations: RepresentationSet,
    settings: SweepSettings,
    results: Sequence[TaskResult],
    remarks: Sequence[str],
    made_utc: str,
    ablations: Ablations | None = None,
) -> dict[str, Any]:
    """Return all results as values for JSON."""
    trials, ranges = representations.trials, representations.normalisation
    tests = {result.task.key: curve_differences(result) for result in results}
    return {
        "program": {"name": "rigctl", "version": __version__},
        "made_utc": made_utc,
        "simulated": trials.simulated,
        "inputs": list(trials.provenance),
        "settings": {
            "iterations": settings.iterations,
            "k_max": settings.k_max,
            "seed": settings.seed,
            "engine": settings.engine.value,
            "encoder": representations.parameters.as_dict(),
            "analysis": as_plain(representations.settings),
            "analysis_file": representations.settings.file or None,
        },
        "trials": {
            "used": len(trials.trials),
            "textures": list(trials.textures),
            "speeds_mm_s": list(trials.speeds_mm_s),
            "forces_g": list(trials.forces_g),
            "taxel_low": ranges.low.tolist(),
            "taxel_high": ranges.high.tolist(),
            "windows": {
                "unscaled": representations.unscaled.n_windows,
                "speed_scaled": representations.scaled.n_windows,
                "window_ms": representations.scaled.window_ms,
                "reference_mm_s": representations.scaled.reference_mm_s,
            },
        },
        "remarks": list(remarks),
        "force_matrix": _force_dict(representations),
        "tasks": {
            result.task.key: _task_dict(result, tests[result.task.key], trials.simulated, ablations)
            for result in results
        },
        "curve_tests": {key: task_curve_tests(found) for key, found in tests.items()},
        "tests_rule": tests_rule(tests),
        "tests_note": NOT_IN_PAPER,
        "evidence": None if ablations is None else _ablations_dict(ablations),
        "mountings": describe_mountings(results),
        "table1": table_rows(results),
    }


def _force_dict(representations: RepresentationSet) -> dict[str, Any] | None:
    force, transferred = representations.force, representations.transferred_c
    if force is None:
        return None
    searched = force.evaluations[force.evaluations > 0]
    return {
        "sentence": transferred.sentence if transferred else force_sentence(force),
        "from_file": str(transferred.source.file) if transferred else None,
        "rate_error": [m.as_dict() for m in transferred.rate_errors] if transferred else None,
        "labels_seen": LABELS_SEEN,
        "status": count_search_statuses(force),
        **unconverged_shares(force),
        "unconverged_entries": [entry.as_dict() for entry in unconverged_entries(force)],
        "mean_evaluations": round(float(searched.mean()), DECIMALS) if len(searched) else 0.0,
        "textures": list(force.textures),
        "speeds_mm_s": list(force.speeds_mm_s),
        "forces_g": list(force.forces_g),
        "c": force.c.tolist(),
        "residual_hz": force.residual_hz.tolist(),
        "entry_status": force.status.tolist(),
    }


def _task_dict(
    result: TaskResult,
    tests: Mapping[str, Sequence[Difference]],
    simulated: bool,
    ablations: Ablations | None,
) -> dict[str, Any]:
    found, shown = compare_task(result, simulated=simulated), result.shown_components - 1
    return {
        "title": result.task.title,
        "figure": result.task.figure,
        "classes": list(result.classes),
        "chance": result.chance,
        "largest_class_share": result.largest_class_share,
        "k_max": result.k_max,
        "shown_components": result.shown_components,
        "smallest_training_set": result.n_train,
        "paper": {k: list(v) for k, v in published.TABLE_1.get(result.task.key, {}).items()},
        "representations": {c.representation.key: _curve_dict(c) for c in result.curves},
        "components_needed": components_needed(result),
        "differences_from_original": {
            key: difference_dict(each[shown]) for key, each in tests.items()
        },
        "confusion_shares": confusion_shares(result),
        "order": None
        if found is None
        else {
            "sentence": found.sentence,
            "pairs": len(found.pairs),
            "held": len(found.keys(Agreement.HOLDS)),
            "not_told_apart": [list(keys) for keys in found.keys(Agreement.TIED)],
            "reversed": [list(keys) for keys in found.keys(Agreement.REVERSED)],
            "reasons": list(found.caveats),
            "compared": [_pair_dict(pair, result, ablations) for pair in found.pairs],
        },
    }


def _pair_dict(
    pair: RepresentationPair, result: TaskResult, ablations: Ablations | None
) -> dict[str, Any]:
    return {
        "better": pair.keys[0],
        "worse": pair.keys[1],
        "verdict": pair.agreement.value,
        "points": round(100 * pair.gap, DECIMALS),
        "test": difference_dict(pair.difference),
        "paper_points": round(100 * pair.paper_gap, DECIMALS),
        "measured_beside": list(explain(pair, result, ablations)),
    }


def _ablations_dict(ablations: Ablations) -> dict[str, Any]:
    return {
        "draws": ablations.draws,
        "forces_g": list(ablations.forces_g),
        "halves": {
            key: {name: half._asdict() for name, half in both.items()}
            for key, both in ablations.halves.items()
        },
        "alone": ablations.alone,
    }


def _curve_dict(curve: Curve) -> dict[str, Any]:
    sd, error = curve.sd, standard_error(curve.accuracy)
    return {
        "name": curve.representation.name,
        "c_knows_the_label": curve.representation.sees_labels,
        "tested_per_iteration": curve.n_tested,
        "mean": curve.mean.tolist(),
        "sd": None if sd is None else sd.tolist(),
        "standard_error": None if error is None else error.tolist(),
        "accuracy": curve.accuracy.tolist(),
        "confusion": curve.confusion.tolist(),
        "components_without_within_class_variance": curve.n_without_variance,
        "components_beyond_rank": curve.beyond_rank,
    }
