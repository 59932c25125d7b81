"""One attempt of a session of the drum, read and encoded in blocks: a long one takes no memory.

A view has the whole of a long trial as the lowest and highest readings of many samples, and asks
for a section of it as fine as its pixels.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gui.analysis.task_values import Section, TrialCourse, TrialData, TrialFeatures
from gui.live.drum_course import DrumCourse, thin_out
from gui.live.sample_history import CAPACITY_S, SampleHistory
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import SAMPLE_RATE_HZ, TrialMark

if TYPE_CHECKING:
    from rigctl.encoder.normalisation import Normalisation
    from rigctl.session.session import Session

Samples = NDArray[np.uint16]
Spikes = NDArray[np.uint8]
Blocks = Iterable[tuple[Samples, Spikes]]

BLOCK_SAMPLES = 1 << 16
MANY_SAMPLES = 100_000
"""A longer trial is sent by the lowest and highest of its samples."""
MOST_PLACES = 1 << 15
"""Of the whole of a long trial."""
COURSE_S, COURSE_POINTS = 600.0, 100_000
"""Force and speed are read in such parts; more points in all are thinned out."""


class EncodedTrial:
    """An attempt that is encoded from rest, as the live encoder does.

    The encoder's state at the beginning of each block is kept, so that any section is encoded from
    there.
    """

    def __init__(self, session: Session, row: int, ranges: Normalisation) -> None:
        from rigctl.encoder.encoder import Encoder

        self.session, self.row = session, row
        self.n_samples = session.sample_count(row)
        self._states = [Encoder(ranges)]

    @property
    def title(self) -> str:
        """Number, condition and verdict."""
        row = self.session.trials[self.row]
        return (
            f"Trial {row['trial_id']}: plate {row['texture']}, {row['speed_mm_s']:g} mm/s, "
            f"{row['force_g']:g} g, {row['verdict']}"
        )

    def blocks(self, first: int = 0, end: int | None = None) -> Iterator[tuple[Samples, Spikes]]:
        """Yield the samples ``first`` … ``end - 1`` in blocks, and their spikes."""
        end = self.n_samples if end is None else min(end, self.n_samples)
        number = min(first // BLOCK_SAMPLES, len(self._states) - 1)
        encoder = self._states[number].copy()
        for start in range(number * BLOCK_SAMPLES, end, BLOCK_SAMPLES):
            if start == len(self._states) * BLOCK_SAMPLES:
                self._states.append(encoder.copy())
            samples = self._read(start, min(start + BLOCK_SAMPLES, end))
            spikes = encoder.encode(samples)
            skipped = max(0, first - start)
            if skipped < len(samples):
                yield samples[skipped:], spikes[skipped:]

    def section(self, first: int, end: int, factor: int) -> Section:
        """Return samples, or the lowest and highest of ``factor`` of them, and force and speed.

        ``factor``: a power of two. The section begins where a group of so many samples does.
        """
        first -= first % factor
        first_s = first / SAMPLE_RATE_HZ if first else -np.inf
        end_s = end / SAMPLE_RATE_HZ if end < self.n_samples else np.inf
        course = read_course(self.session, self.row, first_s, end_s)
        n_taxels = self.session.sensor_layout.n_taxels
        return fold_blocks(self.blocks(first, end), n_taxels, factor, first)._replace(course=course)

    def voltage_mv(self, taxel: int, first: int, end: int) -> NDArray[np.float64]:
        """Return the membrane voltage of SA and RA of a taxel, from 0, float64 (n, 2) in mV."""
        number = min(first // BLOCK_SAMPLES, len(self._states) - 1)
        encoder = self._states[number].copy()
        for start in range(number * BLOCK_SAMPLES, first, BLOCK_SAMPLES):
            encoder.encode(self._read(start, min(start + BLOCK_SAMPLES, first)))
        n = self.session.sensor_layout.n_taxels
        return encoder.membrane_mv(self._read(first, end))[:, [taxel, n + taxel]]

    def train(self, row: int) -> NDArray[np.int64]:
        """Return the samples of the spikes of one train, SA taxel 1 … n, then RA 1 … n."""
        found, at = [np.zeros(0, np.int64)], 0
        for _, spikes in self.blocks():
            found.append(np.flatnonzero(spikes[:, row]) + at)
            at += len(spikes)
        return np.concatenate(found)

    def _read(self, first: int, end: int) -> Samples:
        return np.ascontiguousarray(self.session.samples(self.row, first, end))


def sample_blocks(session: Session, row: int) -> Iterator[Samples]:
    """Yield the samples of an attempt in blocks."""
    for start in range(0, session.sample_count(row), BLOCK_SAMPLES):
        yield session.samples(row, start, start + BLOCK_SAMPLES)


def fold_blocks(blocks: Blocks, n_taxels: int, factor: int, first: int = 0) -> Section:
    """Return blocks of a trial, the first of which begins with a sample, as a section."""
    none = np.zeros((0, n_taxels), np.uint16)
    empty = none, none, np.zeros((0, 2 * n_taxels), np.uint8)
    folded = [empty, *(_fold(samples, spikes, factor) for samples, spikes in blocks)]
    low, high, spikes = (np.concatenate(part) for part in zip(*folded, strict=True))
    return Section(first, factor, low, low if factor == 1 else high, spikes)


def _fold(samples: Samples, spikes: Spikes, factor: int) -> tuple[Samples, Samples, Spikes]:
    if factor == 1:
        return samples, samples, spikes
    starts = np.arange(0, len(samples), factor)
    low, high = (fold.reduceat(samples, starts, axis=0) for fold in (np.minimum, np.maximum))
    return low, high, np.maximum.reduceat(spikes, starts, axis=0)


def finer(factor: int) -> int:
    """Return the highest power of two that is no larger, at most a block."""
    return min(1 << (factor.bit_length() - 1), BLOCK_SAMPLES)


def whole_factor(n_samples: int) -> int:
    """Return how many samples a place of the overview of a trial has, a power of two."""
    if n_samples <= MANY_SAMPLES:
        return 1
    return 1 << (n_samples // MOST_PLACES).bit_length()


def read_trial(trial: EncodedTrial, path: str) -> TrialData:
    """Return an attempt of the session at a path for the views. Raises SessionError."""
    layout = trial.session.sensor_layout
    windows = _FeatureWindows(trial, float(trial.session.trials[trial.row]["speed_mm_s"]))
    return TrialData(
        trial.title,
        fold_blocks(windows.count(trial.blocks()), layout.n_taxels, whole_factor(trial.n_samples)),
        layout,
        read_course(trial.session, trial.row),
        windows.features(),
        trial.session.header.simulated,
        trial.n_samples,
        (path, trial.row),
        trial.session.trial_marks(trial.row),
    )


class _FeatureWindows:
    """Adds up the speed-scaled features, or those of plain time for a trial without motion."""

    def __init__(self, trial: EncodedTrial, speed_mm_s: float) -> None:
        from rigctl.encoder.features import FeatureLayout

        self._n_samples, self._speed_mm_s = trial.n_samples, speed_mm_s
        is_scaled = speed_mm_s > 0
        self._layout = FeatureLayout.covering([trial.n_samples], [speed_mm_s], scaled=is_scaled)
        n_rows = 2 * trial.session.sensor_layout.n_taxels
        self._counts = np.zeros((self._layout.n_windows, n_rows))

    def count(self, blocks: Blocks) -> Iterator[tuple[Samples, Spikes]]:
        """Yield the blocks of a trial, and count their spikes."""
        starts, at = self._layout.window_starts(self._speed_mm_s), 0
        for samples, spikes in blocks:
            sums = np.zeros((len(spikes) + 1, spikes.shape[1]), np.int64)
            np.cumsum(spikes, axis=0, out=sums[1:])
            self._counts += np.diff(sums[np.clip(starts - at, 0, len(spikes))], axis=0)
            at += len(spikes)
            yield samples, spikes

    def features(self) -> TrialFeatures:
        """Return what was counted: SA in Hz, RA as counts."""
        layout, values = self._layout, self._counts.T.copy()
        durations_s = layout.window_durations_s(self._n_samples, self._speed_mm_s)
        sa = values[: len(values) // 2]
        np.divide(sa, durations_s, out=sa, where=durations_s > 0)
        window_mm = layout.reference_mm_s * layout.window_ms / 1000 if layout.scaled else 0.0
        return TrialFeatures(values, window_mm, layout.window_ms)


def read_course(
    session: Session, row: int, first_s: float = -np.inf, end_s: float = np.inf
) -> TrialCourse:
    """Return force and speed of an attempt, or from ``first_s`` to before ``end_s``."""
    edges_s = _course_edges(session, row, first_s, end_s)
    most = COURSE_POINTS // (len(edges_s) - 1)
    parts = [_read_course(session, row, *edges, most) for edges in pairwise(edges_s)]
    columns = zip(*(part[:4] for part in parts), strict=True)
    force_s, force_g, speed_s, speed_mm_s = map(np.concatenate, columns)
    return TrialCourse(force_s, force_g, speed_s, speed_mm_s, *parts[0][4:])


def _course_edges(session: Session, row: int, first_s: float, end_s: float) -> list[float]:
    length_s = session.sample_count(row) / SAMPLE_RATE_HZ
    inner = np.arange(COURSE_S, length_s - COURSE_S / 2, COURSE_S)
    return [first_s, *inner[(inner > first_s) & (inner < end_s)].tolist(), end_s]


def _read_course(
    session: Session, row: int, first_s: float, end_s: float, most: int
) -> TrialCourse:
    trial, drum = session.trials[row], session.drum(row, first_s, end_s)
    columns: list[NDArray[np.float64]] = []
    for at_s, values in (
        (drum.loadcell_s, drum.loadcell["force_g"]),
        (drum.polls_s, drum.polls["speed_mm_s"]),
    ):
        outside = (at_s < first_s) | (at_s >= end_s)
        columns += thin_out(at_s[~outside], np.asarray(values[~outside], np.float64), most)
    force_s, force_g, speed_s, speed_mm_s = columns
    planned = float(trial["force_g"]), float(trial["speed_mm_s"])
    return TrialCourse(force_s, force_g, speed_s, speed_mm_s, *planned)


COURSE_NAMES = ("time (s)", "force (g)", "speed (mm/s)")


def reading_names(n_taxels: int) -> tuple[str, ...]:
    """Return the names of the columns of a table of readings and spikes."""
    taxels = tuple(f"T{taxel + 1} (counts)" for taxel in range(n_taxels))
    trains = [f"{kind} {taxel + 1} (spikes)" for kind in ("SA", "RA") for taxel in range(n_taxels)]
    return "time (s)", *taxels, *trains


def reading_columns(first: int, samples: Samples, spikes: Spikes) -> tuple[NDArray[Any], ...]:
    """Return the columns of a table of readings and spikes from a sample on."""
    return (first + np.arange(len(samples))) / SAMPLE_RATE_HZ, *samples.T, *spikes.T


def course_columns(course: TrialCourse) -> tuple[NDArray[np.float64], ...]:
    """Return the load cell's times and readings, and the drum's speed at the same times."""
    speed = np.full(len(course.force_s), np.nan)
    if len(course.speed_s):
        speed = np.interp(course.force_s, course.speed_s, course.speed_mm_s)
    return course.force_s, course.force_g, speed


def table_parts(trial: EncodedTrial, *, of_course: bool) -> Iterator[tuple[NDArray[Any], ...]]:
    """Yield the columns of readings and spikes, or of force and speed, part after part."""
    session, row = trial.session, trial.row
    if of_course:
        for edges in pairwise(_course_edges(session, row, -np.inf, np.inf)):
            yield course_columns(_read_course(session, row, *edges, sys.maxsize))
        return
    first = 0
    for samples, spikes in trial.blocks():
        yield reading_columns(first, samples, spikes)
        first += len(samples)


class ReplayTrial(NamedTuple):
    """A section of a trial as the live views keep it: sample 0 of the trial is at position 0.

    ``low``, ``high``: uint16 (n_taxels,), each taxel's lowest and highest reading in the trial.
    ``n_samples``: of the whole trial. ``row``: of the attempt. ``marks``: what people noted on it.
    """

    title: str
    simulated: bool
    layout: SensorLayout
    history: SampleHistory
    drum: DrumCourse
    low: NDArray[np.uint16]
    high: NDArray[np.uint16]
    n_samples: int
    row: int
    marks: tuple[TrialMark, ...] = ()


AHEAD_S = 60
SECTION_S = CAPACITY_S + AHEAD_S
"""Of a longer trial, a replay has so much: the longest span, and what comes next."""


def replay_trial(trial: EncodedTrial, right: int) -> ReplayTrial:
    """Return the section of a trial around a position for the live views."""
    n, layout = trial.n_samples, trial.session.sensor_layout
    length = SECTION_S * SAMPLE_RATE_HZ
    end = min(n, max(right + AHEAD_S * SAMPLE_RATE_HZ, length))
    first = max(0, end - length)
    history = SampleHistory(layout.n_taxels, 2 * layout.n_taxels, max(1, min(n, length)))
    for block in trial.blocks(first, end):
        first += append_samples(history, first, *block)
    low, high = _range(trial)
    drum, whole_s = DrumCourse(), (-np.inf, np.inf)
    times_s = ((first - length) / SAMPLE_RATE_HZ, end / SAMPLE_RATE_HZ) if n > length else whole_s
    append_course(drum, read_course(trial.session, trial.row, *times_s))
    simulated = trial.session.header.simulated
    marks = trial.session.trial_marks(trial.row)
    about = trial.title, simulated, layout
    return ReplayTrial(*about, history, drum, low, high, n, trial.row, marks)


def _range(trial: EncodedTrial) -> tuple[Samples, Samples]:
    """Return each taxel's lowest and highest reading, uint16 (n_taxels,) each; 0 without any."""
    ends = [
        (part.min(axis=0), part.max(axis=0)) for part in sample_blocks(trial.session, trial.row)
    ]
    none = np.zeros(trial.session.sensor_layout.n_taxels, np.uint16)
    low = np.min([low for low, _ in ends], axis=0) if ends else none
    return low, np.max([high for _, high in ends], axis=0) if ends else none


def append_samples(history: SampleHistory, first: int, samples: Samples, spikes: Spikes) -> int:
    """Append the samples of a trial from ``first`` on; return how many."""
    counters = np.arange(first, first + len(samples), dtype=np.int64)
    flags = np.zeros(len(samples), np.uint8)
    return history.append(counters / SAMPLE_RATE_HZ, counters, samples, flags, spikes)


def append_course(drum: DrumCourse, course: TrialCourse) -> None:
    """Append force and speed of a trial at the times of the load cell."""
    if not np.isfinite(course.speed_s).any():
        return
    known = np.isfinite(course.force_s)
    at_s, force_g = thin_out(course.force_s[known], course.force_g[known], CAPACITY_S * 50)
    columns: dict[str, Any] = {
        "force_g": force_g,
        "force_set_g": np.full(len(at_s), course.planned_g),
        "speed_mm_s": np.interp(at_s, course.speed_s, course.speed_mm_s),
        "speed_set_mm_s": np.full(len(at_s), course.planned_mm_s),
    }
    drum.append(at_s * SAMPLE_RATE_HZ, columns)
