"""All results of the real-time experiment, and their values for ``results.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl import __version__
from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.representations import KNOWS
from rigctl.analysis.settings import as_plain, differences_from_paper
from rigctl.analysis.statistics import curve_test_dict, k_ranges, published_share, wilson_interval
from rigctl.errors import WrongUse
from rigctl.finger.analysis.evaluation import (
    ERROR_RATES,
    NOVELTY_STAGE,
    EvidenceCurve,
    ForceComparison,
    LeftOutTask,
    NoveltyResult,
    ProfileDifferences,
    SequentialResult,
    SetCoverage,
    compare_force_scalings,
    evidence_curve,
    leave_texture_out,
    measure_coverage,
    measure_novelty,
    measure_sequential,
    profile_differences,
    train_classifier,
)
from rigctl.finger.analysis.scans import (
    KINDS,
    FingerDataSet,
    common_kinds,
    common_textures,
)
from rigctl.finger.analysis.tasks import (
    DeployedAnswers,
    DrawSettings,
    FingerResult,
    deployed_answers,
    run_finger_tasks,
)
from rigctl.finger.published import DEPLOYED, DEPLOYED_TRIALS
from rigctl.finger.values import ScanKind

Floats = NDArray[np.float64]
BEYOND_STAGE = "measuring answers"
MIN_TEXTURES_TO_LEAVE_OUT = 3
DECIMALS = 6


@dataclass(frozen=True, slots=True)
class FingerAnalysis:
    """Everything that the report of the real-time experiment shows.

    ``novelty`` is empty for fewer than three textures. ``latencies``: milliseconds by kind.
    """

    data_sets: tuple[FingerDataSet, ...]
    settings: DrawSettings
    tasks: tuple[FingerResult, ...]
    evidence: tuple[EvidenceCurve, ...]
    coverage: tuple[SetCoverage, ...]
    novelty: tuple[NoveltyResult, ...]
    sequential: tuple[SequentialResult, ...]
    force: tuple[ForceComparison, ...]
    profiles: tuple[ProfileDifferences, ...]
    answers: tuple[DeployedAnswers, ...]
    latencies: Mapping[str, Floats] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def simulated(self) -> bool:
        """Whether any of the scans comes from a simulation."""
        return any(
            part.simulated
            for one in self.data_sets
            for part in (one.training, one.calibration, one.tested)
        )


def analyse_finger(
    data_sets: Sequence[FingerDataSet],
    settings: DrawSettings,
    resources: Resources = SERIAL_RESOURCES,
    *,
    scaled_currents: Sequence[FingerDataSet] = (),
    latencies: Mapping[str, Floats] | None = None,
    remarks: Sequence[str] = (),
) -> FingerAnalysis:
    """Return all results. ``scaled_currents``: the data sets with label-free force scaling.

    Raises :class:`WrongUse` for no data set, other textures, or too few trials.
    """
    if not data_sets:
        raise WrongUse("the analysis needs a data set: a training session and a later one")
    data_sets = [one.of_repeated_textures() for one in data_sets]
    common = common_textures([one.textures for one in data_sets])
    if common is None:
        raise WrongUse("the data sets have different textures: analyse sets of one protocol")
    data_sets, scaled_currents = (
        [one.of_textures(common) for one in sets] for sets in (data_sets, scaled_currents)
    )
    tasks, omissions = run_finger_tasks(data_sets, settings, resources)
    components = settings.finger.components
    tested = [one.tested for one in data_sets]
    evidence, coverage, sequential = [], [], []
    kinds = common_kinds(data_sets)
    for number, kind in enumerate(kinds):
        resources.progress(BEYOND_STAGE, number, len(kinds))
        classifiers = [train_classifier(one, kind, components) for one in data_sets]
        evidence.append(evidence_curve(classifiers, tested))
        coverage.append(measure_coverage(classifiers, tested))
        sequential += [measure_sequential(classifiers, tested, asked) for asked in ERROR_RATES]
    resources.progress(BEYOND_STAGE, len(kinds), len(kinds))
    return FingerAnalysis(
        tuple(data_sets),
        settings,
        tuple(tasks),
        tuple(evidence),
        tuple(coverage),
        _novelty(data_sets, components, resources),
        tuple(sequential),
        tuple(compare_force_scalings(data_sets, scaled_currents, settings)),
        tuple(_profiles(data_sets, kind) for kind in kinds),
        tuple(deployed_answers(data_sets, kind, settings) for kind in kinds),
        latencies or {},
        (
            *differences_from_paper(settings.analysis),
            *remarks,
            *(remark for one in data_sets for remark in one.remarks),
            *omissions,
        ),
    )


def _novelty(
    data_sets: Sequence[FingerDataSet], components: int, resources: Resources
) -> tuple[NoveltyResult, ...]:
    textures, kinds = data_sets[0].textures, common_kinds(data_sets)
    if len(textures) < MIN_TEXTURES_TO_LEAVE_OUT:
        return ()
    tasks = [
        LeftOutTask(one, kind, name, components)
        for one in data_sets
        for kind in kinds
        for name in textures
    ]
    found = list(resources.map(leave_texture_out, tasks, NOVELTY_STAGE))
    return tuple(measure_novelty([one for one in found if one.kind is kind]) for kind in kinds)


def _profiles(data_sets: Sequence[FingerDataSet], kind: ScanKind) -> ProfileDifferences:
    """Return the mean over the data sets' training sessions."""
    each = [profile_differences(one.training, kind) for one in data_sets]
    names = [name for name in each[0].mean_rate_hz if all(name in one.mean_rate_hz for one in each)]
    return ProfileDifferences(
        kind,
        {name: float(np.mean([one.mean_rate_hz[name] for one in each])) for name in names},
        float(np.mean([one.texture_share for one in each])),
        float(np.mean([one.profile_share for one in each])),
    )


def task_dict(result: FingerResult) -> dict[str, Any]:
    """Return a task's curves, tests and comparison with the paper as values for JSON."""
    differences = result.differences()
    original = result.mean(ScanKind.ORIGINAL)
    scaled = result.mean(ScanKind.SPEED_SCALED)
    better = np.array([(d.effect or 0.0) > 0 for d in differences])
    stars = np.array([d.stars for d in differences])
    quoted = {
        kind.value: value._asdict() for kind, value in zip(KINDS, result.task.quoted, strict=True)
    }
    return {
        "title": result.task.title,
        "figure": result.task.figure,
        "trained_on": result.n_train,
        "tested_per_draw": result.n_tested,
        "n": len(result.accuracy[ScanKind.ORIGINAL]),
        "n_of_runs": {kind.value: n for kind, n in result.n_of_runs.items()},
        "chance": result.chance,
        "k_max": result.k_max,
        "paper": {
            "accuracy": quoted,
            "claims": result.task.claims,
            "shares": _shares_from_paper(result),
        },
        "curves": {kind.value: _curve_dict(result, kind) for kind in result.accuracy},
        "above_originals_peak": k_ranges(np.flatnonzero(scaled > original.max()) + 1),
        "scaled_better_double": k_ranges(np.flatnonzero(better & (stars == "**")) + 1),
        "scaled_better_single": k_ranges(np.flatnonzero(better & (stars == "*")) + 1),
        "original_better": k_ranges(np.flatnonzero(~better & (stars != "")) + 1),
        "assumptions": sorted({text for d in differences for text in d.assumptions}),
    }


def _shares_from_paper(result: FingerResult) -> list[dict[str, Any]]:
    """Return Figure S5's quoted shares and ours with as many components; empty for Figure 4.

    Figure 4 quotes means over draws without their spread, which no test can use.
    """
    if result.task is not DEPLOYED:
        return []
    shares = []
    for kind, quoted in zip(KINDS, result.task.quoted, strict=True):
        if quoted.components is None or quoted.components > result.k_max:
            continue
        n = result.tested(kind)
        correct = round(n * float(result.mean(kind)[quoted.components - 1]))
        rule = result.thresholds.proportion_asterisks
        paper = published_share(correct, n, quoted.percent, DEPLOYED_TRIALS, rule=rule)
        ours = {"kind": kind.value, "components": quoted.components, "correct": correct, "of": n}
        shares.append({**ours, "paper": paper})
    return shares


def _curve_tests(result: FingerResult) -> dict[str, Any]:
    """Return the asterisks of Figures 4 and S5: Speed Scaled against Original."""
    original, scaled = (kind.value for kind in KINDS)
    return {scaled: curve_test_dict(result.differences(), original, in_paper=True)}


def _curve_dict(result: FingerResult, kind: ScanKind) -> dict[str, Any]:
    mean, sd, error = result.mean(kind), result.sd(kind), result.standard_error(kind)
    peak = int(mean.argmax())
    return {
        "mean": mean.round(DECIMALS).tolist(),
        "sd": None if sd is None else sd.round(DECIMALS).tolist(),
        "standard_error": None if error is None else error.round(DECIMALS).tolist(),
        "peak": round(float(mean[peak]), DECIMALS),
        "peak_components": peak + 1,
    }


def as_dict(analysis: FingerAnalysis, made_utc: str) -> dict[str, Any]:
    """Return everything as values for JSON; every number is finite or None."""
    return {
        "program": {"name": "rigctl", "version": __version__},
        "experiment": "realtime",
        "made_utc": made_utc,
        "simulated": analysis.simulated,
        "settings": {
            "draws": analysis.settings.draws,
            "seed": analysis.settings.seed,
            "engine": analysis.settings.engine.value,
            "analysis": as_plain(analysis.settings.analysis),
            "analysis_file": analysis.settings.analysis.file or None,
        },
        "data_sets": [_data_set_dict(one) for one in analysis.data_sets],
        "remarks": list(analysis.remarks),
        "tasks": {one.task.key: task_dict(one) for one in analysis.tasks},
        "curve_tests": {one.task.key: _curve_tests(one) for one in analysis.tasks},
        "evidence": [_values(one, "at_mm", "by_mm", "at_s", "by_s") for one in analysis.evidence],
        "coverage": [
            _values(one, "sentence", "promised", "n", "coverage", "mean_size", "failures")
            for one in analysis.coverage
        ],
        "novelty": [
            _values(
                one,
                "sentence",
                "promised_false_alarms",
                "detected",
                "false_alarms",
                "area",
                "by_texture",
            )
            for one in analysis.novelty
        ],
        "sequential": [{**one._asdict(), "kept": one.kept} for one in analysis.sequential],
        "knows": {
            kind.value: KNOWS.get(kind.force_scaling, "nothing")
            for kind in common_kinds(analysis.data_sets)
        },
        "force_invariance": [
            _values(one, "scaling", "accuracy", "peak", "peak_components", "p", "h", "verdict")
            for one in analysis.force
        ],
        "profiles": [
            _values(one, "mean_rate_hz", "spread", "texture_share", "profile_share")
            for one in analysis.profiles
        ],
        "answers": [
            {
                **_values(one, "components", "confusion", "right", "tested"),
                "textures": list(one.textures),
                "interval": {
                    name: wilson_interval(one.right[name], n) for name, n in one.tested.items()
                },
            }
            for one in analysis.answers
        ],
        "latencies": {kind: latency_dict(ms) for kind, ms in analysis.latencies.items()},
    }


def latency_dict(ms: Floats) -> dict[str, float]:
    """Return percentiles of latencies in milliseconds."""
    percentiles = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}
    values = {
        name: round(float(np.percentile(ms, share)), 3) for name, share in percentiles.items()
    }
    return {"n": len(ms), **values}


def _data_set_dict(one: FingerDataSet) -> dict[str, Any]:
    return {
        "name": one.name,
        "sessions": [one.training.session, one.tested.session],
        "textures": list(one.textures),
        "trained": len(one.training),
        "calibrated": len(one.calibration),
        "tested": len(one.tested),
    }


def _values(one: Any, *names: str) -> dict[str, Any]:
    """Return the kind of a result and some of its values, arrays rounded."""
    found = {name: getattr(one, name) for name in ("kind", *names)}
    return {
        name: value.round(DECIMALS).tolist() if isinstance(value, np.ndarray) else value
        for name, value in found.items()
    }
