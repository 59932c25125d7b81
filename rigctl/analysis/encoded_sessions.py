"""The spikes of sessions, with C and window counts, in one file: ``rigctl encode``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl import __version__
from rigctl.analysis.cache import Arrays, Resources, cache_key
from rigctl.analysis.files import atomic_directory
from rigctl.analysis.force_scaling import (
    ScaledBy,
    absence_sentence,
    choose_reference,
    force_scaling_obstacle,
    sa_factors,
    trials_to_encode,
)
from rigctl.analysis.settings import check_reference_force
from rigctl.analysis.spike_counts import (
    ConditionTask,
    PreparedTrials,
    count_conditions,
    count_with_given_c,
    encoder_items,
    files_of_trials,
    group_by_condition,
    inputs_of,
    join_searched_c,
    prepare_trials,
    replace_sa_counts,
)
from rigctl.analysis.taxel import (
    SHOWN_S,
    EncodeRequest,
    Section,
    check_selection,
    draw_every_signal,
    load_course,
    write_course,
)
from rigctl.analysis.trial_set import TrialRef, TrialSet, join_sessions, open_trials
from rigctl.config.resources import source_commit
from rigctl.encoder.batch import window_counts
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.features import FeatureLayout
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters
from rigctl.session.analysis_file import EncodingInfo, SpikeFileWriter
from rigctl.session.sample_index import SampleFiles

CHUNK = 64
US_PER_SAMPLE = 1000
FILE = "spikes.h5"


class Encoded(NamedTuple):
    """The file of spikes, its content, and remarks on it."""

    file: Path
    trials: int
    spikes: int
    force: ForceMatrix | None
    remarks: tuple[str, ...]


class _SpikeTask(NamedTuple):
    """Trials to encode; ``scale``: factors on the SA current, float64 (n, n_taxels), or None.

    ``order``: the encoder's row of each train of the file.
    """

    files: SampleFiles
    trials: tuple[TrialRef, ...]
    normalisation: Normalisation
    parameters: EncoderParameters
    scale: NDArray[np.float64] | None
    order: list[int]


def encode_sessions(
    request: EncodeRequest, out: Path, made_utc: str, resources: Resources
) -> Encoded:
    """Encode sessions and write the folder ``out``, which appears whole or not at all.

    Raises SessionError or WrongUse for what cannot be encoded, DiskFault where the folder cannot
    be written. The cache keeps the results of an interrupted run.
    """
    trials = join_sessions(request.sessions, resources.progress, request.parameters.reading)
    check_selection(trials, request.trial, request.taxel)
    resources.executor.check_visible(trials.paths)
    with atomic_directory(out) as folder:
        check_reference_force(request.settings, trials.forces_g)
        reference_g, choice = choose_reference(trials, request.reference_g)
        trials = trials_to_encode(trials, reference_g, request.scaled_by)
        obstacle = force_scaling_obstacle(trials, reference_g)
        prepared = prepare_trials(trials, resources, request.ranges, request.settings)
        conditions = group_by_condition(
            prepared, request.parameters, reference_g, search_c=not obstacle
        )
        counted = list(count_conditions(prepared, conditions, resources))
        force = join_searched_c(conditions, counted)
        absence = "" if force is None else absence_sentence(force)
        remarks = tuple(filter(None, (*prepared.trials.remarks, choice, obstacle, absence)))
        encoding = _encoding(request, prepared, force, remarks, made_utc)
        with SpikeFileWriter(folder / FILE, encoding) as file:
            n_spikes = _write_spikes(file, request, prepared, force, resources)
            counts = _scaled_counts(request, prepared, conditions, counted, force, resources)
            _write_windows(file, prepared, conditions, counts)
        if request.trial is not None or request.taxel is not None:
            _write_picture(
                request, prepared, sa_factors(prepared, force, request.scaled_by), folder
            )
    remarks = (*remarks, *resources.cache.remarks)
    return Encoded(out / FILE, len(prepared.trials.trials), n_spikes, force, remarks)


def _encode(task: _SpikeTask) -> Arrays:
    """Return ``counts`` (n, n_trains) and ``samples`` of the spikes, trains in the file's order."""
    with open_trials(task.files) as reader:
        samples = reader.read_block(task.trials).arrays
    order = task.order
    found = encode_trials(samples, task.normalisation, task.parameters, sa_scale=task.scale)
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
    prepared: PreparedTrials,
    force: ForceMatrix | None,
    resources: Resources,
) -> int:
    """Write the spikes of all trials and return their number."""
    trials, ranges, parameters = prepared.trials.trials, prepared.normalisation, request.parameters
    scale = sa_factors(prepared, force, request.scaled_by)
    order = _train_rows(prepared)
    tasks, keys = [], []
    for first in range(0, len(trials), CHUNK):
        rows = slice(first, first + CHUNK)
        c = None if scale is None else scale[rows]
        files = files_of_trials(prepared.trials.files, trials[rows])
        tasks.append(_SpikeTask(files, trials[rows], ranges, parameters, c, order))
        encoding = (encoder_items(parameters), inputs_of(files))
        encoder = (ranges.low, ranges.high, *encoding, c, np.array(order))
        keys.append(cache_key("spikes", prepared.hashes[rows], *encoder))
    total, reference_mm_s = 0, request.settings.windows.reference_speed_mm_s
    found_each = resources.map_cached(_encode, tasks, keys, "writing spikes")
    for task, found in zip(tasks, found_each, strict=True):
        counts, samples = found["counts"], found["samples"]
        speeds = np.array([trial.speed_mm_s for trial in task.trials])
        factors = np.repeat(speeds / reference_mm_s, counts.sum(axis=1, dtype=np.int64))
        file.add(counts, samples, np.rint(samples * (US_PER_SAMPLE * factors)).astype(np.int64))
        total += len(samples)
    return total


def _scaled_counts(
    request: EncodeRequest,
    prepared: PreparedTrials,
    conditions: Sequence[ConditionTask],
    counted: Sequence[Arrays],
    force: ForceMatrix | None,
    resources: Resources,
) -> Iterator[NDArray[Any]]:
    """Yield the counts of each condition with the C of the spikes."""
    if force is None or request.scaled_by is ScaledBy.NONE:
        yield from (found["plain"] for found in counted)
    elif request.scaled_by is ScaledBy.TEXTURE:
        for condition, found in zip(conditions, counted, strict=True):
            yield replace_sa_counts(found["plain"], found["forced"], condition.scaled_rows)
    else:
        yield from count_with_given_c(prepared, conditions, counted, force, resources, blind=True)


def _write_windows(
    file: SpikeFileWriter,
    prepared: PreparedTrials,
    conditions: Sequence[ConditionTask],
    counts: Iterator[NDArray[Any]],
) -> None:
    n, n_taxels = len(prepared.trials.trials), prepared.trials.n_taxels
    order = _train_rows(prepared)
    layouts = _layouts(prepared)
    tables = {
        name: (
            np.zeros((n, 2 * n_taxels, windows.n_windows), np.uint16),
            np.zeros((n, windows.n_windows)),
        )
        for name, windows in layouts.items()
    }
    for condition, found in zip(conditions, counts, strict=True):
        rows, speed = condition.rows, condition.speed_mm_s
        for name, windows in layouts.items():
            spikes, seconds = tables[name]
            spikes[rows] = window_counts(found, condition.bin_edges, speed, windows)[:, order]
            seconds[rows] = windows.window_durations_s(condition.lengths, speed)
    for name, (spikes, seconds) in tables.items():
        file.add_windows(name, spikes, seconds)


def _train_rows(prepared: PreparedTrials) -> list[int]:
    """Return the encoder's row of each train of the file."""
    return [row for _, row in prepared.trials.sensor_layout.train_names()]


def _layouts(prepared: PreparedTrials) -> dict[str, FeatureLayout]:
    return dict(zip(("unscaled", "speed_scaled"), prepared.layouts, strict=True))


def _encoding(
    request: EncodeRequest,
    prepared: PreparedTrials,
    force: ForceMatrix | None,
    remarks: Sequence[str],
    made_utc: str,
) -> EncodingInfo:
    trials = prepared.trials
    return EncodingInfo(
        made_utc,
        f"{__version__} {source_commit()}".strip(),
        trials.simulated,
        trials.provenance,
        remarks,
        _columns(trials, prepared.hashes),
        trials.sensor_layout,
        request.parameters,
        prepared.normalisation,
        request.scaled_by,
        force,
        _layouts(prepared),
    )


def _columns(trials: TrialSet, hashes: NDArray[np.uint64]) -> dict[str, Any]:
    """Return the columns of /trials: unit, meaning, values."""

    def values(name: str) -> NDArray[Any]:
        return np.array([getattr(trial, name) for trial in trials.trials])

    return {
        "session": ("", "number of its session in /inputs", values("session")),
        "row": ("", "its row in that session's /trials, from 0", values("row")),
        "trial_id": ("", "number in planned order, from 1", values("trial_id")),
        "texture": ("", "name of the plate", [trial.texture for trial in trials.trials]),
        "speed_mm_s": ("mm/s", "planned speed", values("speed_mm_s")),
        "force_g": ("g", "planned force", values("force_g")),
        "mount": ("", "mounting of the plate in its session, from 1", values("mount")),
        "n_samples": ("samples", "length, 1 ms each", values("n_samples")),
        "content": ("", "XXH3 (64 bits) of its samples' bytes", hashes),
    }


def _write_picture(
    request: EncodeRequest,
    prepared: PreparedTrials,
    c: NDArray[np.float64] | None,
    folder: Path,
) -> None:
    chosen = request.parameters, request.trial, request.taxel
    reference_mm_s = request.settings.windows.reference_speed_mm_s
    course = load_course(prepared.trials, prepared.normalisation, *chosen, c, reference_mm_s)
    section = Section(0.0, min(SHOWN_S, course.duration_s))
    draw_every_signal(course, section, folder / "taxel")
    write_course(course, folder / "taxel.csv")
