"""The paper's four representations of a set of trials, and others that do not see the label.

Every condition is read once for the force search and both layouts, once more for the
texture-blind C, which needs all conditions searched first, and once for each kind of gain, which
takes conductances where the wiring is known. Feature matrices are files that are
mapped into memory, so that a large set needs no more memory than one condition does.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.lib.format import open_memmap
from numpy.typing import NDArray

from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.force_gains import force_gains
from rigctl.analysis.force_scaling import (
    ForceMatrixSource,
    TransferredC,
    absence_sentence,
    choose_reference,
    covered_trials,
    describe_transfer,
    force_scaling_obstacle,
    pool_rate_errors,
    sa_rates_by_force,
    with_c,
)
from rigctl.analysis.settings import AnalysisSettings, check_reference_force
from rigctl.analysis.spike_counts import (
    ConditionTask,
    PreparedTrials,
    RangesOver,
    count_conditions,
    count_with_given_c,
    group_by_condition,
    join_searched_c,
    prepare_trials,
    replace_sa_counts,
)
from rigctl.analysis.trial_set import TrialSet
from rigctl.encoder.batch import features_from_counts
from rigctl.encoder.features import FeatureLayout
from rigctl.encoder.force_gain import GAINED, LOADCELL, ForceGain, ForceScaling
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters
from rigctl.session.sensor_passport import SensorPassport

Features = NDArray[np.float64]


class Representation(NamedTuple):
    """A kind of features.

    ``force``: what scales the SA current, "" for nothing, "texture" for C of the true one, "blind"
    for the mean C, or one of :data:`~rigctl.encoder.force_gain.GAINED` for a gain.
    """

    name: str
    key: str
    speed_scaled: bool
    force: str

    @property
    def sees_labels(self) -> bool:
        """Whether a test trial's own texture selects its C."""
        return self.force == "texture"

    @property
    def knows(self) -> str:
        """What the scaling of the force knows beside the readings."""
        return KNOWS.get(self.force, "nothing")


KNOWS = {
    "texture": "label, set force, speed",
    "blind": "set force, speed",
    ForceScaling.CALIBRATED: "the sensor's passport",
    LOADCELL: "load cell, the sensor's passport",
}
REPRESENTATIONS = (
    Representation("Original", "original", False, ""),
    Representation("Speed Scaled", "speed", True, ""),
    Representation("Force Scaled", "force", False, "texture"),
    Representation("Speed and Force Scaled", "speed_force", True, "texture"),
    Representation("Force Scaled, texture-blind", "force_blind", False, "blind"),
    Representation("Speed and Force Scaled, texture-blind", "speed_force_blind", True, "blind"),
    Representation("Divided", "divided", False, ForceScaling.DIVIDED),
    Representation("Speed Scaled and Divided", "speed_divided", True, ForceScaling.DIVIDED),
    Representation("Calibrated", "calibrated", False, ForceScaling.CALIBRATED),
    Representation(
        "Speed Scaled and Calibrated", "speed_calibrated", True, ForceScaling.CALIBRATED
    ),
    Representation("Load Cell", "loadcell", False, LOADCELL),
    Representation("Speed Scaled and Load Cell", "speed_loadcell", True, LOADCELL),
)


class GainedEncoding(NamedTuple):
    """Ranges, encoder and gains (of each trial, by kind) of the representations with a gain."""

    normalisation: Normalisation
    parameters: EncoderParameters
    gains: dict[str, tuple[ForceGain, ...]]


@dataclass(frozen=True, slots=True)
class RepresentationSet:
    """Feature files of a set, a row for each of ``trials``; ``files`` by representation key.

    ``transferred_c``: the origin of ``force`` if it was not searched on these trials.
    ``settings``: windows and conditions that they were made with. ``hashes``: XXH3 of each trial's
    samples, uint64 (n_trials,). ``gained``: the encoding of those with a gain.
    """

    trials: TrialSet
    normalisation: Normalisation
    parameters: EncoderParameters
    unscaled: FeatureLayout
    scaled: FeatureLayout
    force: ForceMatrix | None
    files: dict[str, Path]
    remarks: tuple[str, ...]
    transferred_c: TransferredC | None = None
    settings: AnalysisSettings = field(default_factory=AnalysisSettings)
    hashes: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))
    gained: GainedEncoding | None = None

    @property
    def present(self) -> tuple[Representation, ...]:
        """The representations that the trials allow."""
        return tuple(r for r in REPRESENTATIONS if r.key in self.files)

    def layout(self, representation: Representation) -> FeatureLayout:
        """Return the windows of a representation's features."""
        return self.scaled if representation.speed_scaled else self.unscaled

    def encoder(self, representation: Representation) -> tuple[Normalisation, EncoderParameters]:
        """Return the taxel ranges and the encoder of a representation."""
        if self.gained is None or representation.force not in GAINED:
            return self.normalisation, self.parameters
        return self.gained.normalisation, self.gained.parameters

    def features(self, representation: Representation) -> Features:
        """Return the feature matrix, float64 (n_trials, width), read only."""
        matrix: Features = np.load(self.files[representation.key], mmap_mode="r")
        return matrix


def represent(
    trials: TrialSet,
    parameters: EncoderParameters,
    folder: Path,
    *,
    settings: AnalysisSettings | None = None,
    source: ForceMatrixSource | None = None,
    passport: SensorPassport | None = None,
    ranges: RangesOver | Normalisation = RangesOver.ALL,
    resources: Resources = SERIAL_RESOURCES,
) -> RepresentationSet:
    """Encode a set in every representation that it allows; write feature files into ``folder``.

    ``settings``: windows, reference force and trained conditions, by default the paper's.
    ``source``: a C that is used as it is, without a search. ``passport``: the sensor's, in the
    place of those that the sessions carry. ``ranges``: the taxel ranges, over all
    trials used as in the paper, over those that it trains on, or given. The set leaves out trials
    with gaps and trials without C, and lists them in remarks. Raises SessionError where no complete
    trial is left, WrongUse where no trial has the reference force that an analysis file names.
    """
    settings = settings or AnalysisSettings()
    reference_g, choice = settings.conditions.reference_force_g, ""
    if source is None:
        check_reference_force(settings, trials.forces_g)
        reference_g, choice = choose_reference(trials, reference_g)
        settings = settings.with_reference_force(reference_g)
    trials = trials.without_gaps()
    obstacle = "" if source else force_scaling_obstacle(trials, reference_g)
    if source is not None:
        trials = covered_trials(trials, source.force, by_texture=True)
    elif not obstacle:
        trials = with_c(trials, reference_g)
    prepared = prepare_trials(trials, resources, ranges, settings)
    trials = prepared.trials
    remarks = [*trials.remarks, choice, obstacle]
    conditions = group_by_condition(
        prepared, parameters, reference_g, search_c=not (obstacle or source)
    )
    with closing(_FeatureFiles(folder, trials, sync=not resources.executor.is_local)) as files:
        force, transferred = _write_features(files, prepared, conditions, source, resources)
        gained, gain_remarks = _write_gained(
            files, prepared, parameters, ranges, settings, passport, resources
        )
        remarks += gain_remarks
    if transferred is not None:
        remarks.append(transferred.sentence)
    elif force is not None:
        remarks.append(absence_sentence(force))
    return RepresentationSet(
        trials,
        prepared.normalisation,
        parameters,
        *prepared.layouts,
        force,
        files.paths,
        (*filter(None, remarks), *resources.cache.remarks),
        transferred,
        settings,
        prepared.hashes,
        gained,
    )


def _write_features(
    files: _FeatureFiles,
    prepared: PreparedTrials,
    conditions: Sequence[ConditionTask],
    source: ForceMatrixSource | None,
    resources: Resources,
) -> tuple[ForceMatrix | None, TransferredC | None]:
    """Write all features; return the C that scales them, and its rate error if it was given."""
    plain, transferred = [], None
    counts = count_conditions(prepared, conditions, resources)
    for condition, found in zip(conditions, counts, strict=True):
        files.write("", condition, found["plain"])
        if "forced" in found:
            forced = replace_sa_counts(found["plain"], found["forced"], condition.scaled_rows)
            files.write("texture", condition, forced)
        plain.append(found)
    force = source.force if source else join_searched_c(conditions, plain)
    if force is None:
        return None, None
    given = (prepared, conditions, plain, force, resources)
    if source is not None:
        rates = []
        scaled = count_with_given_c(*given, blind=False)
        for condition, found, forced in zip(conditions, plain, scaled, strict=True):
            files.write("texture", condition, forced)
            by_force = sa_rates_by_force(condition, found["plain"], forced, force.reference_g)
            rates.append((condition, by_force))
        transferred = describe_transfer(source, pool_rate_errors(rates))
    for condition, forced in zip(conditions, count_with_given_c(*given, blind=True), strict=True):
        files.write("blind", condition, forced)
    return force, transferred


def _write_gained(
    files: _FeatureFiles,
    plain: PreparedTrials,
    parameters: EncoderParameters,
    ranges: RangesOver | Normalisation,
    settings: AnalysisSettings,
    passport: SensorPassport | None,
    resources: Resources,
) -> tuple[GainedEncoding, tuple[str, ...]]:
    """Write the features whose SA current has a gain; return their encoding, and remarks.

    They are of conductances where the wiring is known: a sum of counts depends on which taxels
    share an input. Ranges that are given are of the encoder's own reading, which then stays.
    """
    is_given = isinstance(ranges, Normalisation)
    trials = plain.trials if is_given else plain.trials.as_conductances
    is_new = trials.reading is not plain.trials.reading
    prepared = prepare_trials(trials, resources, ranges, settings) if is_new else plain
    parameters = replace(parameters, reading=trials.reading)
    reference_g = settings.conditions.reference_force_g
    gains, remarks = force_gains(trials, prepared.normalisation, reference_g, passport)
    conditions = group_by_condition(prepared, parameters, reference_g, search_c=False)
    for kind, of_trials in gains.items():
        gained = [
            condition._replace(gains=tuple(of_trials[row] for row in condition.rows))
            for condition in conditions
        ]
        counts = count_conditions(prepared, gained, resources, f"encoding {kind} readings")
        for condition, found in zip(gained, counts, strict=True):
            files.write(kind, condition, found["plain"])
    return GainedEncoding(prepared.normalisation, parameters, gains), remarks


class _FeatureFiles:
    """Feature matrices in .npy files, filled row by row; ``sync``: other machines read them.

    Rows are written, not stored into a mapped file: the first touch of a mapped page costs more.
    """

    def __init__(self, folder: Path, trials: TrialSet, *, sync: bool) -> None:
        self._folder, self._sync = folder, sync
        self._n_trials, self._n_taxels = len(trials.trials), trials.n_taxels
        self._files: dict[str, BinaryIO] = {}

    def close(self) -> None:
        """Close all files."""
        for file in self._files.values():
            file.flush()
            if self._sync:
                os.fsync(file.fileno())
            file.close()

    @property
    def paths(self) -> dict[str, Path]:
        """Path of each representation, by key."""
        return {key: Path(file.name) for key, file in self._files.items()}

    def write(self, force: str, condition: ConditionTask, counts: NDArray[Any]) -> None:
        """Write the unscaled and the speed-scaled rows of one kind of C."""
        timing = (condition.bin_edges, condition.lengths, condition.speed_mm_s)
        keys = [r.key for r in REPRESENTATIONS if r.force == force]
        for key, layout in zip(keys, condition.layouts, strict=True):
            features = features_from_counts(counts, *timing, layout)
            if key not in self._files:
                self._files[key] = self._create(key, features.shape[1])
            for row, values in zip(condition.rows, features, strict=True):
                self._files[key].seek((row - self._n_trials) * values.nbytes, os.SEEK_END)
                self._files[key].write(values.data)

    def _create(self, key: str, width: int) -> BinaryIO:
        """Return a file whose rows read 0 until they are written."""
        path = self._folder / f"{key}.npy"
        open_memmap(path, "w+", np.float64, (self._n_trials, width))
        return path.open("r+b")
