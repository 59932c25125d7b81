"""Sessions to a file of spikes, C and windows: ``rigctl encode``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl import __version__
from rigctl.analysis.data.atomic_directory import atomic_directory
from rigctl.analysis.data.cache import Arrays, key_of
from rigctl.analysis.data.trial_set import TrialRef, TrialSet, join_sessions, opened
from rigctl.analysis.features.representations import why_no_force
from rigctl.analysis.features.spike_counts import (
    ConditionGroup,
    PreparedTrials,
    RangesOver,
    Resources,
    c_of,
    c_of_trials,
    count,
    count_with,
    groups_of,
    only_files,
    prepare,
    through,
    with_c,
    with_own_c,
)
from rigctl.analysis.report.example_taxel import check_shown, taxel_picture, write_samples
from rigctl.analysis.report.paper_figures import draw_taxel
from rigctl.config.resources import source_commit
from rigctl.encoding.batch import window_counts
from rigctl.encoding.encoder import encode_trials
from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.force_matrix import REFERENCE_FORCE_G, ForceMatrix
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.errors import WrongUse
from rigctl.session.files.spike_file import EncodingInfo, SpikeFileWriter, train_names
from rigctl.session.read.sample_index import SampleFiles

CHUNK = 64
FILE = "spikes.h5"


class ScaledBy(StrEnum):
    """Which C multiplies the SA current of the spikes that are written."""

    NONE = "none"
    TEXTURE = "texture"
    BLIND = "blind"


@dataclass(frozen=True, slots=True)
class EncodeRequest:
    """What is to be encoded and how. ``trial``, ``taxel``: of a figure and a table, or None."""

    sessions: tuple[Path, ...]
    out: Path
    parameters: EncoderParameters = DEFAULT
    reference_g: float = REFERENCE_FORCE_G
    ranges: RangesOver | Normalisation = RangesOver.ALL
    scaled_by: ScaledBy = ScaledBy.NONE
    trial: int | None = None
    taxel: int | None = None


class Encoded(NamedTuple):
    """Where the file is, what it holds, and what is to be said."""

    file: Path
    trials: int
    spikes: int
    force: ForceMatrix | None
    remarks: tuple[str, ...]


class SpikeJob(NamedTuple):
    """Some trials to be encoded; ``scale``: float64 (n, n_taxels) on the SA current, or None."""

    files: SampleFiles
    trials: tuple[TrialRef, ...]
    normalisation: Normalisation
    parameters: EncoderParameters
    scale: NDArray[np.float64] | None


def encode_sessions(request: EncodeRequest, made_utc: str, means: Resources) -> Encoded:
    """Encode and write the folder ``request.out``, which appears whole or not at all.

    Raises SessionError or WrongUse for what cannot be encoded, DiskFault where nothing can be
    written. What was finished before an interruption is kept.
    """
    trials = join_sessions(request.sessions)
    check_shown(trials, request.trial, request.taxel)
    means.crew.must_see(trials.paths)
    with atomic_directory(request.out) as folder:
        ground = prepare(trials, means, request.ranges)
        lacking = why_no_force(ground.trials, request.reference_g)
        if lacking and request.scaled_by is not ScaledBy.NONE:
            raise WrongUse(f"--scaled-by {request.scaled_by} needs C. {lacking}")
        groups = groups_of(ground, request.parameters, request.reference_g, with_c=not lacking)
        counted = list(count(ground, groups, means))
        force = c_of(groups, counted)
        remarks = tuple(filter(None, (*ground.trials.remarks, lacking)))
        encoding = _encoding(request, ground, force, remarks, made_utc)
        with SpikeFileWriter(folder / FILE, encoding) as file:
            n_spikes = _write_spikes(file, request, ground, force, means)
            counts = _scaled(request, ground, groups, counted, force, means)
            _write_windows(file, ground, groups, counts)
        if request.trial is not None or request.taxel is not None:
            _show(request, ground, folder)
    remarks = (*remarks, *means.kept.remarks, *means.crew.remarks)
    return Encoded(request.out / FILE, len(ground.trials.trials), n_spikes, force, remarks)


def spikes_of(job: SpikeJob) -> Arrays:
    """``counts`` (n, n_trains), spikes of each train in the file's order; ``samples``: theirs."""
    with opened(job.files) as reader:
        samples = reader.all_of(job.trials)
    order = [row for _, row in train_names(job.normalisation.n_taxels)]
    found = encode_trials(samples, job.normalisation, job.parameters, sa_scale=job.scale)
    counts = np.array([np.diff(spikes.row_start)[order] for spikes in found])
    trains = [spikes.train(row) for spikes in found for row in order]
    longest = max(map(len, samples))
    return {
        "counts": counts.astype(np.min_scalar_type(counts.max(initial=0))),
        "samples": np.concatenate(trains).astype(np.min_scalar_type(longest)),
    }


def _write_spikes(
    file: SpikeFileWriter,
    request: EncodeRequest,
    ground: PreparedTrials,
    force: ForceMatrix | None,
    means: Resources,
) -> int:
    trials, scale = ground.trials.trials, None
    if force is not None and request.scaled_by is not ScaledBy.NONE:
        scale = c_of_trials(ground.trials, force, blind=request.scaled_by is ScaledBy.BLIND)
    jobs, keys = [], []
    for first in range(0, len(trials), CHUNK):
        rows = slice(first, first + CHUNK)
        of_rows = None if scale is None else scale[rows]
        files = only_files(ground.trials.files, trials[rows])
        jobs.append(
            SpikeJob(files, trials[rows], ground.normalisation, request.parameters, of_rows)
        )
        keys.append(_key(ground, request.parameters, rows, of_rows))
    total = 0
    for found in through(spikes_of, jobs, keys, "writing spikes", means):
        file.add(found["counts"], found["samples"])
        total += len(found["samples"])
    return total


def _key(
    ground: PreparedTrials,
    parameters: EncoderParameters,
    rows: slice,
    scale: NDArray[np.float64] | None,
) -> str:
    plain = parameters.as_dict()
    del plain["name"]
    ranges = ground.normalisation
    ways = (ranges.low, ranges.high, sorted(plain.items()), scale)
    return key_of("spikes", ground.hashes[rows], *ways)


def _scaled(
    request: EncodeRequest,
    ground: PreparedTrials,
    groups: Sequence[ConditionGroup],
    counted: Sequence[Arrays],
    force: ForceMatrix | None,
    means: Resources,
) -> Iterator[NDArray[Any]]:
    """Counts of each group with the C that the spikes were made with."""
    if force is None or request.scaled_by is ScaledBy.NONE:
        yield from (found["plain"] for found in counted)
    elif request.scaled_by is ScaledBy.TEXTURE:
        yield from (with_own_c(*both) for both in zip(groups, counted, strict=True))
    else:
        yield from count_with(ground, with_c(groups, force, blind=True), counted, means)


def _write_windows(
    file: SpikeFileWriter,
    ground: PreparedTrials,
    groups: Sequence[ConditionGroup],
    counts: Iterator[NDArray[Any]],
) -> None:
    n, n_taxels = len(ground.trials.trials), ground.trials.n_taxels
    order = [row for _, row in train_names(n_taxels)]
    layouts = _layouts(ground)
    tables = {
        name: (
            np.zeros((n, 2 * n_taxels, windows.n_windows), np.uint16),
            np.zeros((n, windows.n_windows)),
        )
        for name, windows in layouts.items()
    }
    for group, found in zip(groups, counts, strict=True):
        condition, speed = group.condition, group.condition.trials[0].speed_mm_s
        for name, windows in layouts.items():
            spikes, seconds = tables[name]
            spikes[group.rows] = window_counts(found, condition.cuts, speed, windows)[:, order]
            seconds[group.rows] = windows.seconds(condition.lengths, speed)
    for name, both in tables.items():
        file.add_windows(name, *both)


def _layouts(ground: PreparedTrials) -> dict[str, FeatureLayout]:
    return dict(zip(("unscaled", "speed_scaled"), ground.layouts, strict=True))


def _encoding(
    request: EncodeRequest,
    ground: PreparedTrials,
    force: ForceMatrix | None,
    remarks: Sequence[str],
    made_utc: str,
) -> EncodingInfo:
    trials = ground.trials
    return EncodingInfo(
        made_utc,
        f"{__version__} {source_commit()}".strip(),
        trials.simulated,
        trials.provenance,
        remarks,
        _columns(trials, ground.hashes),
        [name for name, _ in train_names(trials.n_taxels)],
        request.parameters,
        ground.normalisation,
        request.scaled_by,
        force,
        _layouts(ground),
    )


def _columns(trials: TrialSet, hashes: NDArray[np.uint64]) -> dict[str, Any]:
    """Columns of /trials: unit, meaning, values."""
    table = trials.trials
    lengths = [trial.place.stop - trial.place.start for trial in table]
    return {
        "session": ("", "number of its session in /inputs", _ints(t.session for t in table)),
        "row": ("", "its row in that session's /trials, from 0", _ints(t.row for t in table)),
        "trial_id": ("", "number in planned order, from 1", _ints(t.trial_id for t in table)),
        "texture": ("", "name of the plate", [t.texture for t in table]),
        "speed_mm_s": ("mm/s", "planned speed", np.array([t.speed_mm_s for t in table])),
        "force_g": ("g", "planned force", np.array([t.force_g for t in table])),
        "n_samples": ("samples", "length, 1 ms each", _ints(lengths)),
        "content": ("", "XXH3 (64 bits) of its samples' bytes", hashes),
    }


def _ints(values: Any) -> NDArray[np.int64]:
    return np.fromiter(values, np.int64)


def _show(request: EncodeRequest, ground: PreparedTrials, folder: Path) -> None:
    ways = (ground.normalisation, request.parameters, request.trial, request.taxel)
    picture = taxel_picture(ground.trials, *ways)
    draw_taxel(picture, folder / "taxel")
    write_samples(picture, folder / "taxel.csv")
