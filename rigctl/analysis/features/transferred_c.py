"""C from another session: what it is worth here, measured by the SA rates that it was made for.

A change of the sensor voids C, so one that was searched on other recordings is never used without
a warning. C was made to bring each taxel's SA rate at a force to its rate at the reference force;
how far it misses that on the trials at hand is measured, beside the same without any C.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.trial_set import TrialRef, TrialSet, opened
from rigctl.analysis.data.wiring_check import check_learnt
from rigctl.analysis.execution.executor import HERE, Executor, Progress, work_through
from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.force_search import TOLERANCE_HZ, mean_sa_rates_hz
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.errors import WrongUse
from rigctl.session.files.force_matrix_file import load_force
from rigctl.session.files.source_sessions import content_digest
from rigctl.session.read.sample_index import SampleFile

Floats = NDArray[np.float64]
STAGE = "measuring the rate error of C"
COMPARING = "comparing sessions with those that C was searched on"


class RateError(NamedTuple):
    """SA rates at one speed and force against those at the reference, over textures and taxels.

    Means of the absolute differences in Hz with C and without, the largest with C, the mean rate
    aimed at, and from how many pairs of texture and taxel.
    """

    speed_mm_s: float
    force_g: float
    with_c_hz: float
    without_c_hz: float
    largest_hz: float
    aimed_hz: float
    pairs: int

    def as_dict(self) -> dict[str, float]:
        """By name, as JSON can hold it."""
        return {k: round(float(v), 4) for k, v in self._asdict().items()}


class ForceMatrixSource(NamedTuple):
    """Where a C is from that was not searched here; ``foreign``: sessions it has not seen."""

    file: Path
    force: ForceMatrix
    foreign: tuple[Path, ...]


class TransferredC(NamedTuple):
    """A C from elsewhere in use, with what it is worth here, in figures and in a sentence."""

    source: ForceMatrixSource
    misses: tuple[RateError, ...]
    sentence: str


class _RateJob(NamedTuple):
    """The trials of one texture and speed."""

    files: tuple[SampleFile, ...]
    trials: tuple[TrialRef, ...]
    normalisation: Normalisation
    parameters: EncoderParameters
    c: dict[float, Floats]
    reference_g: float


def c_of(
    file: Path, trials: TrialSet, progress: Progress = lambda stage, done, all_: None
) -> ForceMatrixSource:
    """C of a model or a spikes.h5, checked against a set. Raises SessionError and WrongUse."""
    force, inputs = load_force(file)
    check_learnt(file, inputs, trials.provenance)
    check_covers(trials, force, by_texture=True)
    return ForceMatrixSource(file, force, unseen_sessions(trials, inputs, progress))


def unseen_sessions(
    trials: TrialSet,
    learnt: Sequence[Mapping[str, Any]],
    progress: Progress = lambda stage, done, all_: None,
) -> tuple[Path, ...]:
    """Sessions of a set that are none of those ``learnt`` from, by content where that was noted."""
    contents = {source["content"] for source in learnt if "content" in source}
    names = {_name_of(source) for source in learnt if "content" not in source}
    found = []
    n = len(trials.paths)
    for number, (path, source) in enumerate(zip(trials.paths, trials.provenance, strict=True)):
        progress(COMPARING, number, n)
        if _name_of(source) not in names and content_digest(path) not in contents:
            found.append(path)
    progress(COMPARING, n, n)
    return tuple(found)


def _name_of(source: Mapping[str, Any]) -> tuple[Any, ...]:
    """What tells a session from others where no digest was kept."""
    keys = ("plan_hash", "begun_utc", "seed", "simulation_seed", "trials_committed")
    return tuple(source.get(key) for key in keys)


def transferred_c(
    source: ForceMatrixSource,
    trials: TrialSet,
    normalisation: Normalisation,
    parameters: EncoderParameters,
    *,
    crew: Executor = HERE,
    progress: Progress = lambda stage, done, all_: None,
) -> TransferredC:
    """Measure a C from elsewhere on the trials that it is to scale."""
    ways = (source.force, normalisation, parameters)
    misses = rate_errors(trials, *ways, crew=crew, progress=progress)
    said = f"C is taken from {source.file} and was not searched"
    if source.foreign:
        where = ", ".join(map(str, source.foreign))
        said = f"{warning(misses, source.force, where)}. {said}"
    return TransferredC(source, tuple(misses), said)


def check_covers(trials: TrialSet, force: ForceMatrix, *, by_texture: bool) -> None:
    """Raise WrongUse, naming session and trial, where C lacks what a trial needs."""
    if force.c.shape[1] != trials.n_taxels:
        raise WrongUse(
            f"{trials.paths[0]} has {trials.n_taxels} taxels, C was made for {force.c.shape[1]}"
        )
    for trial in trials.trials:
        lacks = ""
        if trial.speed_mm_s not in force.speeds_mm_s:
            known = ", ".join(f"{v:g}" for v in force.speeds_mm_s)
            lacks = f"was made at {trial.speed_mm_s:g} mm/s, C at {known} mm/s"
        elif trial.force_g not in force.forces_g:
            known = ", ".join(f"{f:g}" for f in force.forces_g)
            lacks = f"was made at {trial.force_g:g} g, C at {known} g"
        elif by_texture and trial.texture not in force.textures:
            lacks = f"has texture {trial.texture!r}, C is for {', '.join(force.textures)}"
        if lacks:
            raise WrongUse(
                f"{trials.paths[trial.session]}: trial {trial.trial_id} {lacks}: "
                "it cannot be scaled to force"
            )


def rate_errors(
    trials: TrialSet,
    force: ForceMatrix,
    normalisation: Normalisation,
    parameters: EncoderParameters,
    *,
    blind: bool = False,
    crew: Executor = HERE,
    progress: Progress = lambda stage, done, all_: None,
) -> list[RateError]:
    """How far C misses at each speed and force that has trials at the reference force too.

    ``blind``: the mean of C over its textures instead of the trial's own.
    """
    jobs = _jobs(trials, force, normalisation, parameters, blind)
    found = work_through(_misses_of, jobs, crew=crew, stage=STAGE, progress=progress)
    pooled: dict[tuple[float, float], list[Floats]] = {}
    for job, rates in zip(jobs, found, strict=True):
        for force_g, three in rates.items():
            pooled.setdefault((job.trials[0].speed_mm_s, force_g), []).append(three)
    return [_miss(*key, np.concatenate(parts, axis=1)) for key, parts in sorted(pooled.items())]


def warning(misses: Sequence[RateError], force: ForceMatrix, where: str) -> str:
    """The sentence that goes with every use of a C that was searched elsewhere."""
    start = (
        f"WARNING: C was searched on other recordings than {where}, and any change of the sensor "
        "voids it. "
    )
    if not misses:
        return start + (
            f"Its rate error cannot be measured here: no speed has trials both at "
            f"{force.reference_g:g} g and at another force"
        )
    parts = "; ".join(
        f"{m.speed_mm_s:g} mm/s, {m.force_g:g} g: {m.with_c_hz:.2f} Hz with C (at most "
        f"{m.largest_hz:.1f}), {m.without_c_hz:.2f} without, of {m.aimed_hz:.1f} Hz"
        for m in misses
    )
    worst = max(misses, key=lambda m: m.with_c_hz)
    helps = sum(m.with_c_hz < m.without_c_hz for m in misses)
    return start + (
        f"Mean miss of the SA rates at {force.reference_g:g} g: {parts}. A search on these "
        f"recordings would come within {TOLERANCE_HZ:g} Hz; the worst here is "
        f"{worst.with_c_hz:.2f} Hz, and C brings the rates nearer at {helps} of "
        f"{len(misses)} levels"
    )


def _jobs(
    trials: TrialSet,
    force: ForceMatrix,
    normalisation: Normalisation,
    parameters: EncoderParameters,
    blind: bool,
) -> list[_RateJob]:
    groups: dict[tuple[str, float], list[TrialRef]] = {}
    for trial in trials.trials:
        groups.setdefault((trial.texture, trial.speed_mm_s), []).append(trial)
    jobs = []
    for (texture, speed), members in sorted(groups.items()):
        if len({t.force_g for t in members}) < 2 or not (blind or texture in force.textures):
            continue
        if force.reference_g not in {t.force_g for t in members}:
            continue
        c = {
            f: force.texture_blind(speed, f) if blind else force.of(texture, speed, f)
            for f in sorted({t.force_g for t in members})
        }
        jobs.append(
            _RateJob(trials.files, tuple(members), normalisation, parameters, c, force.reference_g)
        )
    return jobs


def _misses_of(job: _RateJob) -> dict[float, Floats]:
    """By force other than the reference: rates aimed at, with C, without, float64 (3, n_taxels)."""
    with opened(job.files) as reader:
        samples = [(trial.force_g, reader.of(trial)) for trial in job.trials]
    ways = (job.normalisation, job.parameters)

    def rates(force_g: float, c: Any = None) -> Floats:
        return mean_sa_rates_hz([s for f, s in samples if f == force_g], *ways, c)

    aimed = rates(job.reference_g)
    return {
        f: np.stack([aimed, rates(f, c), rates(f)])
        for f, c in job.c.items()
        if f != job.reference_g
    }


def _miss(speed: float, force_g: float, rates: Floats) -> RateError:
    aimed, with_c, without = rates
    away = np.abs(with_c - aimed)
    return RateError(
        speed,
        force_g,
        float(away.mean()),
        float(np.abs(without - aimed).mean()),
        float(away.max()),
        float(aimed.mean()),
        rates.shape[1],
    )
