"""The paper's four representations of a set of trials, and two whose C knows no texture.

Every condition is read once for the force search and both encodings, and once more for the
texture-blind C, which needs all conditions searched first. Feature matrices are files that are
mapped into memory, so that a large set needs no more memory than one condition does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.carried_c import Carried, Source, carried
from rigctl.analysis.conditions import (
    Condition,
    counted_condition,
    fingerprint_of,
    joined_matrix,
    piece_of,
    with_force,
)
from rigctl.analysis.jobs import HERE, Crew, Progress, work_through
from rigctl.analysis.trial_set import TrialSet
from rigctl.encoding.bulk import features_of
from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.force import REFERENCE_FORCE_G, ForceMatrix, Status
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.presets import EncoderParameters

CHUNK = 64
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

    ``carried``: where ``force`` is from, if it was not searched on these trials.
    """

    trials: TrialSet
    normalisation: Normalisation
    parameters: EncoderParameters
    unscaled: FeatureLayout
    scaled: FeatureLayout
    force: ForceMatrix | None
    files: dict[str, Path]
    remarks: tuple[str, ...]
    carried: Carried | None = None

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
    source: Source | None = None,
    crew: Crew = HERE,
    progress: Progress = lambda stage, done, all_: None,
) -> RepresentationSet:
    """Encode a set in every representation that it allows; feature files go into ``folder``.

    ``reference_g``: the force whose SA rates the others are scaled to. ``source``: a C to be used
    as it is, instead of a search.
    Taxel ranges are the minimum and maximum over all trials used, as in the paper. Trials with
    gaps are left out and named. Raises SessionError where no complete trial is left.
    """
    trials, ranges = _ranges(trials, crew, progress)
    remarks = list(trials.remarks)
    if ranges.constant_taxels:
        named = ", ".join(map(str, ranges.constant_taxels))
        remarks.append(f"constant taxels, which read 0 and never spike: {named}")
    lacking = "" if source else _why_no_force(trials, reference_g)
    if lacking:
        remarks.append(lacking)
    lengths = [trial.n_planned for trial in trials.trials]
    speeds = [trial.speed_mm_s for trial in trials.trials]
    layouts = (
        FeatureLayout.covering(lengths, speeds, scaled=False),
        FeatureLayout.covering(lengths, speeds, scaled=True),
    )
    conditions = _conditions(
        trials, ranges, parameters, layouts, reference_g, with_force=not (lacking or source)
    )
    files = _Files(folder, len(trials.trials), [lay.width(trials.n_taxels) for lay in layouts])
    plain, force = _encode(conditions, files, crew, progress)
    worth = None
    if source is not None:
        force = source.force
        worth = carried(source, trials, ranges, parameters, crew=crew, progress=progress)
        remarks.append(worth.sentence)
        _encode_with(conditions, plain, force, files, "texture", crew, progress)
    if force is not None:
        _encode_with(conditions, plain, force, files, "blind", crew, progress)
    return RepresentationSet(
        trials, ranges, parameters, *layouts, force, files.close(crew), tuple(remarks), worth
    )


def status_counts(force: ForceMatrix) -> dict[str, int]:
    """How many searches ended how, for taxels at forces other than the reference."""
    return {
        status.name.lower(): int((force.status == status).sum())
        for status in Status
        if status is not Status.REFERENCE
    }


def force_sentence(force: ForceMatrix) -> str:
    """What the search for C came to, beside the paper's figure."""
    counts = status_counts(force)
    searched = sum(counts.values())
    reference = int((force.status == Status.REFERENCE).sum())
    ours, entries = PAPER_UNCONVERGED
    return (
        f"C has {searched + reference:,} entries, {reference:,} of them 1 by definition at "
        f"{force.reference_g:g} g; {searched:,} were searched: {counts['converged']:,} converged "
        f"within 0.1 Hz, {counts['capped']:,} were capped at 5, {counts['discontinuity']:,} lie "
        f"at a jump of the rate. Not converged: {force.unconverged:,} of {searched:,} "
        f"(the paper: {ours} of {entries:,})"
    )


class _Files:
    """Feature matrices on disk that are filled row by row."""

    def __init__(self, folder: Path, n_trials: int, widths: Sequence[int]) -> None:
        self._folder, self._n, self._widths = folder, n_trials, widths
        self._open: dict[str, NDArray[np.float64]] = {}

    def put(
        self, force: str, rows: Sequence[int], condition: Condition, counts: NDArray[Any]
    ) -> None:
        """Write the unscaled and the speed-scaled rows of one way to treat force."""
        pair = [r for r in REPRESENTATIONS if r.force == force]
        told = (condition.cuts, condition.lengths, condition.trials[0].speed_mm_s)
        for representation, layout, width in zip(
            pair, condition.layouts, self._widths, strict=True
        ):
            key, matrix = representation.key, features_of(counts, *told, layout)
            if key not in self._open:
                self._open[key] = np.lib.format.open_memmap(
                    self._folder / f"{key}.npy", "w+", np.float64, (self._n, width)
                )
            self._open[key][list(rows)] = matrix

    def close(self, crew: Crew) -> dict[str, Path]:
        """Let go of the files, so that the crew can read them; their paths by key."""
        keys = list(self._open)
        while self._open:
            _, matrix = self._open.popitem()
            # Other machines see what reached the file server, not this one's memory.
            if isinstance(matrix, np.memmap) and not crew.shares_disk:
                matrix.flush()
        return {key: self._folder / f"{key}.npy" for key in keys}


def _ranges(trials: TrialSet, crew: Crew, progress: Progress) -> tuple[TrialSet, Normalisation]:
    """Taxel ranges over complete trials, and the set without the others."""
    torn = [i for i, trial in enumerate(trials.trials) if not trial.place.complete]
    kept = trials.without(torn, "gaps in their samples")
    starts = range(0, len(kept.trials), CHUNK)
    jobs = [(kept.files, kept.trials[at : at + CHUNK]) for at in starts]
    stage = "reading trials for the taxel ranges"
    found = work_through(fingerprint_of, jobs, crew=crew, stage=stage, progress=progress)
    ends = [np.concatenate([several.low, several.high]) for several in found]
    return kept, Normalisation.over(ends, "minimum and maximum over all trials used")


def _why_no_force(trials: TrialSet, reference_g: float) -> str:
    """A sentence where force cannot be scaled; empty where it can."""
    without = "Force Scaled representations are left out: "
    if len(trials.forces_g) < 2:
        return f"{without}there is one level of force only"
    if reference_g not in trials.forces_g:
        return (
            f"{without}no trial was made at the reference force of {reference_g:g} g "
            "(--reference-force names another)"
        )
    there = {(t.texture, t.speed_mm_s, t.force_g) for t in trials.trials}
    for texture, speed in sorted({(t.texture, t.speed_mm_s) for t in trials.trials}):
        for force in trials.forces_g:
            if (texture, speed, force) not in there:
                return f"{without}texture {texture} at {speed:g} mm/s has no trial at {force:g} g"
    crossed = len(trials.textures) * len(trials.speeds_mm_s) * len(trials.forces_g)
    return "" if len(there) == crossed else f"{without}some texture lacks a speed"


def _conditions(
    trials: TrialSet,
    ranges: Normalisation,
    parameters: EncoderParameters,
    layouts: tuple[FeatureLayout, FeatureLayout],
    reference_g: float,
    *,
    with_force: bool,
) -> list[tuple[list[int], Condition]]:
    """Rows of each texture and speed, and the work to be done on them."""
    rows: dict[tuple[str, float], list[int]] = {}
    for i, trial in enumerate(trials.trials):
        rows.setdefault((trial.texture, trial.speed_mm_s), []).append(i)
    forces = trials.forces_g if with_force else ()
    return [
        (
            rows[key],
            Condition(
                trials.files,
                tuple(trials.trials[i] for i in rows[key]),
                ranges,
                parameters,
                layouts,
                forces,
                reference_g,
                (),
            ),
        )
        for key in sorted(rows)
    ]


def _encode(
    conditions: Sequence[tuple[list[int], Condition]],
    files: _Files,
    crew: Crew,
    progress: Progress,
) -> tuple[list[NDArray[Any]], ForceMatrix | None]:
    """Plain counts of each condition, and C where there are forces; both as features in files."""
    jobs = [condition for _, condition in conditions]
    stage = "searching C, encoding"
    found = work_through(counted_condition, jobs, crew=crew, stage=stage, progress=progress)
    pieces, plain = [], []
    for (rows, condition), counted in zip(conditions, found, strict=True):
        plain.append(counted["plain"])
        files.put("", rows, condition, counted["plain"])
        if condition.forces_g:
            counts = with_force(counted["plain"], counted["forced"], condition.scaled_rows)
            files.put("texture", rows, condition, counts)
            pieces.append(piece_of(condition, counted))
    return plain, joined_matrix(pieces) if pieces else None


def _encode_with(
    conditions: Sequence[tuple[list[int], Condition]],
    plain: Sequence[NDArray[Any]],
    force: ForceMatrix,
    files: _Files,
    way: str,
    crew: Crew,
    progress: Progress,
) -> None:
    """Encode with a C that is known: each texture's own, or ``blind`` their mean."""
    jobs = []
    for _, condition in conditions:
        texture, speed = condition.trials[0].texture, condition.trials[0].speed_mm_s
        forces = tuple(sorted({trial.force_g for trial in condition.trials}))
        given = tuple(
            force.texture_blind(speed, f) if way == "blind" else force.of(texture, speed, f)
            for f in forces
        )
        jobs.append(condition._replace(forces_g=forces, given=given))
    stage = f"encoding with {'texture-blind C' if way == 'blind' else 'C'}"
    found = work_through(counted_condition, jobs, crew=crew, stage=stage, progress=progress)
    for (rows, _), job, counts, counted in zip(conditions, jobs, plain, found, strict=True):
        both = with_force(counts, counted["forced"], job.scaled_rows)
        files.put(way, rows, job, both)
