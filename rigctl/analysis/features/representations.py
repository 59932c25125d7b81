"""The paper's four representations of a set of trials, and two whose C knows no texture.

Every condition is read once for the force search and both encodings, and once more for the
texture-blind C, which needs all conditions searched first. Feature matrices are files that are
mapped into memory, so that a large set needs no more memory than one condition does.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.cache import Cache
from rigctl.analysis.data.feature_file import FeatureFile
from rigctl.analysis.data.trial_set import TrialSet
from rigctl.analysis.execution.executor import HERE, Executor, Progress
from rigctl.analysis.features.spike_counts import (
    ConditionGroup,
    RangesOver,
    Resources,
    c_of,
    count,
    count_with,
    groups_of,
    prepare,
    with_c,
    with_own_c,
)
from rigctl.analysis.features.transferred_c import ForceMatrixSource, TransferredC, transferred_c
from rigctl.encoding.batch import features_of
from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.force_matrix import REFERENCE_FORCE_G, ForceMatrix
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.encoding.root_bracket import SearchStatus

Features = NDArray[np.float64]
PAPER_UNCONVERGED = (62, 4320)


class Representation(NamedTuple):
    """A way to make features: scaled to speed or not; C none, by true texture, or blind."""

    name: str
    key: str
    speed_scaled: bool
    force: str

    @property
    def sees_labels(self) -> bool:
        """Whether the test trial's own texture chose its C."""
        return self.force == "texture"


REPRESENTATIONS = (
    Representation("Original", "original", False, ""),
    Representation("Speed Scaled", "speed", True, ""),
    Representation("Force Scaled", "force", False, "texture"),
    Representation("Speed and Force Scaled", "speed_force", True, "texture"),
    Representation("Force Scaled, texture-blind", "force_blind", False, "blind"),
    Representation("Speed and Force Scaled, texture-blind", "speed_force_blind", True, "blind"),
)


@dataclass(frozen=True, slots=True)
class RepresentationSet:
    """Feature files of a set, a row for each of ``trials``; ``files`` by representation key.

    ``transferred_c``: where ``force`` is from, if it was not searched on these trials.
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

    @property
    def present(self) -> tuple[Representation, ...]:
        """The representations that could be made."""
        return tuple(r for r in REPRESENTATIONS if r.key in self.files)

    def features(self, representation: Representation) -> Features:
        """Feature matrix, float64 (n_trials, width), read only."""
        matrix: Features = np.load(self.files[representation.key], mmap_mode="r")
        return matrix


def represent(
    trials: TrialSet,
    parameters: EncoderParameters,
    folder: Path,
    *,
    reference_g: float = REFERENCE_FORCE_G,
    source: ForceMatrixSource | None = None,
    ranges: RangesOver | Normalisation = RangesOver.ALL,
    kept: Cache | None = None,
    crew: Executor = HERE,
    progress: Progress = lambda stage, done, all_: None,
) -> RepresentationSet:
    """Encode a set in every representation that it allows; feature files go into ``folder``.

    ``reference_g``: the force whose SA rates the others are scaled to. ``source``: a C to be used
    as it is, instead of a search. ``ranges``: of the taxels, over all trials used as in the paper,
    over those that it trains on, or given. ``kept``: what was worked out before.
    Trials with gaps are left out and named. Raises SessionError where no complete trial is left.
    """
    means = Resources(crew, kept or Cache(), progress)
    ground = prepare(trials, means, ranges)
    trials = ground.trials
    remarks = list(trials.remarks)
    lacking = "" if source else why_no_force(trials, reference_g)
    if lacking:
        remarks.append(lacking)
    groups = groups_of(ground, parameters, reference_g, with_c=not (lacking or source))
    plain, worth = [], None
    with _Files(folder, len(trials.trials), trials.n_taxels, crew) as files:
        for group, counted in zip(groups, count(ground, groups, means), strict=True):
            files.put("", group, counted["plain"])
            if "forced" in counted:
                files.put("texture", group, with_own_c(group, counted))
            plain.append(counted)
        force = c_of(groups, plain)
        if source is not None:
            force = source.force
            ways = (ground.normalisation, parameters)
            worth = transferred_c(source, trials, *ways, crew=crew, progress=progress)
            remarks.append(worth.sentence)
        for way in ("texture", "blind") if source else ("blind",):
            if force is not None:
                known = with_c(groups, force, blind=way == "blind")
                forced = count_with(ground, known, plain, means)
                for group, counts in zip(known, forced, strict=True):
                    files.put(way, group, counts)
    return RepresentationSet(
        trials,
        ground.normalisation,
        parameters,
        *ground.layouts,
        force,
        files.paths,
        (*remarks, *means.kept.remarks),
        worth,
    )


def status_counts(force: ForceMatrix) -> dict[str, int]:
    """How many searches ended how, for taxels at forces other than the reference."""
    return {
        status.name.lower(): int((force.status == status).sum())
        for status in SearchStatus
        if status is not SearchStatus.REFERENCE
    }


def force_sentence(force: ForceMatrix) -> str:
    """What the search for C came to, beside the paper's figure."""
    counts = status_counts(force)
    searched = sum(counts.values())
    reference = int((force.status == SearchStatus.REFERENCE).sum())
    ours, entries = PAPER_UNCONVERGED
    return (
        f"C has {searched + reference:,} entries, {reference:,} of them 1 by definition at "
        f"{force.reference_g:g} g; {searched:,} were searched: {counts['converged']:,} converged "
        f"within 0.1 Hz, {counts['capped']:,} were capped at 5, {counts['discontinuity']:,} lie "
        f"at a jump of the rate. Not converged: {force.unconverged:,} of {searched:,} "
        f"(the paper: {ours} of {entries:,})"
    )


class _Files:
    """Feature matrices on disk that are filled row by row; the crew reads them when it is left."""

    def __init__(self, folder: Path, n_trials: int, n_taxels: int, crew: Executor) -> None:
        self._folder, self._n, self._n_taxels = folder, n_trials, n_taxels
        self._for_others = not crew.shares_disk
        self._open: dict[str, FeatureFile] = {}

    def __enter__(self) -> _Files:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for file in self._open.values():
            file.close(for_others=self._for_others)

    @property
    def paths(self) -> dict[str, Path]:
        """Of each representation by key."""
        return {key: file.path for key, file in self._open.items()}

    def put(self, force: str, group: ConditionGroup, counts: NDArray[Any]) -> None:
        """Write the unscaled and the speed-scaled rows of one way to treat force."""
        condition = group.condition
        told = (condition.cuts, condition.lengths, condition.trials[0].speed_mm_s)
        pair = [r for r in REPRESENTATIONS if r.force == force]
        for representation, layout in zip(pair, condition.layouts, strict=True):
            key = representation.key
            if key not in self._open:
                path = self._folder / f"{key}.npy"
                self._open[key] = FeatureFile(path, self._n, layout.width(self._n_taxels))
            file = self._open[key]
            room = file.room(len(group.rows))
            file.write(group.rows, features_of(counts, *told, layout, room))


def why_no_force(trials: TrialSet, reference_g: float) -> str:
    """A sentence where force cannot be scaled; empty where it can."""
    without = "Force Scaled representations are left out: "
    forces = trials.forces_g
    if len(forces) < 2:
        return f"{without}there is one level of force only"
    if reference_g not in forces:
        return (
            f"{without}no trial was made at the reference force of {reference_g:g} g "
            "(--reference-force names another)"
        )
    there = {(t.texture, t.speed_mm_s, t.force_g) for t in trials.trials}
    for texture, speed in sorted({(t.texture, t.speed_mm_s) for t in trials.trials}):
        for force in forces:
            if (texture, speed, force) not in there:
                return f"{without}texture {texture} at {speed:g} mm/s has no trial at {force:g} g"
    crossed = len(trials.textures) * len(trials.speeds_mm_s) * len(forces)
    return "" if len(there) == crossed else f"{without}some texture lacks a speed"
