"""The results as plain values: one mapping for ``results.json``, rows for ``table1.csv``."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

from rigctl import __version__
from rigctl.analysis.features.representations import (
    RepresentationSet,
    count_search_statuses,
    force_sentence,
)
from rigctl.analysis.paper import published
from rigctl.analysis.paper.ablations import Ablations
from rigctl.analysis.paper.comparisons import (
    Agreement,
    ComponentsNeeded,
    RepresentationPair,
    compare_task,
    components_needed,
    differences,
)
from rigctl.analysis.paper.explanations import explain
from rigctl.analysis.paper.statistics import Difference
from rigctl.analysis.paper.tasks import Curve, SweepSettings, TaskResult

DECIMALS = 4

LABELS_SEEN = (
    "C is indexed by the true texture: in the Force Scaled and the Speed and Force Scaled "
    "representation a test trial is scaled by the C of its own texture, so the classifier is "
    "handed part of the answer. C was also made from every force, the untrained one included: "
    "that force is new to the classifier, but not to C. The texture-blind rows use the mean of C "
    "over the textures instead and know no label, but they too have seen every force."
)

TABLE_COLUMNS = (
    "task", "figure", "representation", "components", "mean_percent", "sd_percent", "iterations",
    "tested_per_iteration", "paper_mean_percent", "paper_sd_percent", "c_knows_the_label",
)  # fmt: skip


def table_rows(results: Sequence[TaskResult]) -> list[dict[str, Any]]:
    """Table 1, ours beside the paper's: a mapping for each task and representation."""
    rows = []
    for result in results:
        for curve in result.curves:
            mean, sd = shown_percent(result, curve)
            theirs = published.TABLE_1.get(result.task.key, {}).get(curve.representation.key)
            values = (
                result.task.title,
                result.task.figure,
                curve.representation.name,
                result.shown,
                mean,
                sd,
                len(curve.accuracy),
                curve.tested,
                theirs[0] if theirs else None,
                theirs[1] if theirs else None,
                curve.representation.sees_labels,
            )
            rows.append(dict(zip(TABLE_COLUMNS, values, strict=True)))
    return rows


def table_csv(results: Sequence[TaskResult]) -> str:
    """The rows of :func:`table_rows` as CSV; what is not known is empty."""
    out = io.StringIO()
    writer = csv.DictWriter(out, TABLE_COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in table_rows(results):
        writer.writerow(
            {k: "yes" if v is True else "no" if v is False else v for k, v in row.items()}
        )
    return out.getvalue()


def shown_percent(result: TaskResult, curve: Curve) -> tuple[float, float | None]:
    """μ and σ in per cent with the shown components."""
    k = result.shown - 1
    sd = None if curve.deviation is None else round(100 * float(curve.deviation[k]), DECIMALS)
    return round(100 * float(curve.mean[k]), DECIMALS), sd


def as_plain(
    made: RepresentationSet,
    settings: SweepSettings,
    results: Sequence[TaskResult],
    remarks: Sequence[str],
    made_utc: str,
    evidence: Ablations | None = None,
) -> dict[str, Any]:
    """Everything that the report says, as JSON can hold it."""
    return {
        "program": {"name": "rigctl", "version": __version__},
        "made_utc": made_utc,
        "simulated": made.trials.simulated,
        "inputs": list(made.trials.provenance),
        "settings": {
            "iterations": settings.iterations,
            "k_max": settings.k_max,
            "seed": settings.seed,
            "engine": settings.engine.value,
            "encoder": made.parameters.as_dict(),
        },
        "trials": {
            "used": len(made.trials.trials),
            "textures": list(made.trials.textures),
            "speeds_mm_s": list(made.trials.speeds_mm_s),
            "forces_g": list(made.trials.forces_g),
            "taxel_low": made.normalisation.low.tolist(),
            "taxel_high": made.normalisation.high.tolist(),
            "windows": {
                "unscaled": made.unscaled.n_windows,
                "speed_scaled": made.scaled.n_windows,
                "window_ms": made.scaled.window_ms,
                "reference_mm_s": made.scaled.reference_mm_s,
            },
        },
        "remarks": list(remarks),
        "force_matrix": _force(made),
        "tasks": {
            result.task.key: _task(result, made.trials.simulated, evidence) for result in results
        },
        "evidence": None if evidence is None else _evidence(evidence),
        "table1": table_rows(results),
    }


def _force(made: RepresentationSet) -> dict[str, Any] | None:
    if made.force is None:
        return None
    searched = made.force.evaluations[made.force.evaluations > 0]
    return {
        "sentence": made.transferred_c.sentence
        if made.transferred_c
        else force_sentence(made.force),
        "from_file": str(made.transferred_c.source.file) if made.transferred_c else None,
        "rate_error": [m.as_dict() for m in made.transferred_c.rate_errors]
        if made.transferred_c
        else None,
        "labels_seen": LABELS_SEEN,
        "status": count_search_statuses(made.force),
        "unconverged": made.force.unconverged,
        "paper": {"unconverged": 62, "of": 4320},
        "mean_evaluations": round(float(searched.mean()), DECIMALS) if len(searched) else 0.0,
        "textures": list(made.force.textures),
        "speeds_mm_s": list(made.force.speeds_mm_s),
        "forces_g": list(made.force.forces_g),
        "c": made.force.c.tolist(),
        "residual_hz": made.force.residual_hz.tolist(),
        "entry_status": made.force.status.tolist(),
    }


def _task(result: TaskResult, simulated: bool, evidence: Ablations | None) -> dict[str, Any]:
    found = compare_task(result, simulated=simulated)
    return {
        "title": result.task.title,
        "figure": result.task.figure,
        "classes": list(result.classes),
        "chance": result.chance,
        "largest_class_share": result.largest_class,
        "k_max": result.k_max,
        "shown_components": result.shown,
        "smallest_training_set": result.learnt,
        "paper": {k: list(v) for k, v in published.TABLE_1.get(result.task.key, {}).items()},
        "representations": {c.representation.key: _curve(c) for c in result.curves},
        "components_needed": {k: _needed(n) for k, n in components_needed(result).items()},
        "differences_from_original": {k: _difference(d) for k, d in differences(result).items()},
        "order": None
        if found is None
        else {
            "sentence": found.sentence,
            "pairs": len(found.pairs),
            "held": len(found.keys(Agreement.HOLDS)),
            "within_spread": [list(keys) for keys in found.keys(Agreement.TIED)],
            "reversed": [list(keys) for keys in found.keys(Agreement.REVERSED)],
            "reasons": list(found.caveats),
            "compared": [_pair(pair, result, evidence) for pair in found.pairs],
        },
    }


def _pair(
    pair: RepresentationPair, result: TaskResult, evidence: Ablations | None
) -> dict[str, Any]:
    spread = None if pair.spread is None else round(100 * pair.spread, DECIMALS)
    return {
        "better": pair.keys[0],
        "worse": pair.keys[1],
        "verdict": pair.agreement.value,
        "points": round(100 * pair.gap, DECIMALS),
        "spread_points": spread,
        "paper_points": round(100 * pair.paper_gap, DECIMALS),
        "measured_beside": list(explain(pair, result, evidence)),
    }


def _evidence(evidence: Ablations) -> dict[str, Any]:
    return {
        "draws": evidence.draws,
        "forces_g": list(evidence.forces_g),
        "halves": {
            key: {name: half._asdict() for name, half in both.items()}
            for key, both in evidence.halves.items()
        },
        "alone": evidence.alone,
    }


def _curve(curve: Curve) -> dict[str, Any]:
    sd = curve.deviation
    return {
        "name": curve.representation.name,
        "c_knows_the_label": curve.representation.sees_labels,
        "tested_per_iteration": curve.tested,
        "mean": curve.mean.tolist(),
        "sd": None if sd is None else sd.tolist(),
        "accuracy": curve.accuracy.tolist(),
        "confusion": curve.confusion.tolist(),
        "components_without_within_class_variance": curve.set_aside,
        "components_beyond_rank": curve.beyond_rank,
    }


def _needed(needed: ComponentsNeeded) -> dict[str, int | None]:
    by_share = {f"{share:.0%}": k for share, k in needed.thresholds.items()}
    return {**by_share, "as_original": needed.as_original}


def _difference(found: Difference) -> dict[str, Any]:
    return {
        "test": found.test,
        "statistic": found.statistic,
        "p": found.p,
        "effect": found.effect,
        "effect_name": found.rule.effect,
        "stars": found.stars,
        "assumptions": list(found.assumptions),
    }
