"""All results of the real-time experiment: the paper's figures and what goes beyond them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.finger.data_sets import FingerDataSet, common_textures
from rigctl.analysis.finger.evaluation.evidence import EvidenceCurve, evidence_curve
from rigctl.analysis.finger.evaluation.force_invariance import (
    ForceComparison,
    compare_force_scalings,
)
from rigctl.analysis.finger.evaluation.judgements import (
    ERROR_RATES,
    NOVELTY_STAGE,
    LeftOutTask,
    NoveltyResult,
    SequentialResult,
    SetCoverage,
    leave_texture_out,
    measure_coverage,
    measure_novelty,
    measure_sequential,
    train_classifier,
)
from rigctl.analysis.finger.evaluation.profile_differences import (
    ProfileDifferences,
    profile_differences,
)
from rigctl.analysis.finger.scans import KINDS, ScanKind
from rigctl.analysis.finger.tasks import DrawSettings, FingerResult, run_finger_tasks
from rigctl.analysis.settings.settings_file import differences_from_paper
from rigctl.errors import WrongUse

Floats = NDArray[np.float64]

BEYOND_STAGE = "measuring answers"
MIN_TEXTURES_TO_LEAVE_OUT = 3


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
    for number, kind in enumerate(KINDS):
        resources.progress(BEYOND_STAGE, number, len(KINDS))
        classifiers = [train_classifier(one, kind, components) for one in data_sets]
        evidence.append(evidence_curve(classifiers, tested))
        coverage.append(measure_coverage(classifiers, tested))
        sequential += [measure_sequential(classifiers, tested, asked) for asked in ERROR_RATES]
    resources.progress(BEYOND_STAGE, len(KINDS), len(KINDS))
    return FingerAnalysis(
        tuple(data_sets),
        settings,
        tuple(tasks),
        tuple(evidence),
        tuple(coverage),
        _novelty(data_sets, components, resources),
        tuple(sequential),
        tuple(compare_force_scalings(data_sets, scaled_currents, settings)),
        tuple(_profiles(data_sets, kind) for kind in KINDS),
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
    textures = data_sets[0].textures
    if len(textures) < MIN_TEXTURES_TO_LEAVE_OUT:
        return ()
    tasks = [
        LeftOutTask(one, kind, name, components)
        for one in data_sets
        for kind in KINDS
        for name in textures
    ]
    found = list(resources.map(leave_texture_out, tasks, NOVELTY_STAGE))
    return tuple(measure_novelty([one for one in found if one.kind is kind]) for kind in KINDS)


def _profiles(data_sets: Sequence[FingerDataSet], kind: ScanKind) -> ProfileDifferences:
    """Return the mean over the data sets' training sessions."""
    each = [profile_differences(one.training, kind) for one in data_sets]
    names = [name for name in each[0].rate_hz if all(name in one.rate_hz for one in each)]
    return ProfileDifferences(
        kind,
        {name: float(np.mean([one.rate_hz[name] for one in each])) for name in names},
        float(np.mean([one.texture_share for one in each])),
        float(np.mean([one.profile_share for one in each])),
    )
