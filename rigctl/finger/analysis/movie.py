"""The movie of a recorded scan: its values at each moment, their picture, and the file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.movies import (
    FRAME_S,
    Movie,
    Progress,
    new_movie_figure,
    write_clock,
    write_head,
    write_movie_file,
)
from rigctl.analysis.report.figures import FAINT, MUTED, STYLE, TEXT, show_dollars
from rigctl.bench.textures import find_texture, plate_names, printed_heights
from rigctl.bench.world_file import world_from_header
from rigctl.encoder.features import WINDOW_MS
from rigctl.errors import SessionError, WrongUse
from rigctl.finger.analysis.classifier import COVERAGE
from rigctl.finger.layout import spike_counts
from rigctl.finger.scaled_time import BATCH_SAMPLES, N_WINDOWS, ScaledWindows
from rigctl.finger.session import FingerSession
from rigctl.finger.values import (
    MARKS_MM,
    N_FINGER_TAXELS,
    PLATE_MM,
    FingerTrialRow,
    PredictionRow,
)
from rigctl.session.header import SessionHeader
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import PLATE_WIDTH_MM, SAMPLE_RATE_HZ, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

CELL_MM = 0.25
NM_PER_MM = 1_000_000
Floats = NDArray[np.float64]
LEAD_S = 0.4
"""The movie begins before the first mark and ends after the second one."""
TRAIL_S = 0.4
ROW_COLOURS = ("#00629e", "#c24e00", "#5b3fa8")
"""Of the sensor's rows, along the travel; taxels count row by row."""
BLUE = "#1f4fd1"
TAXEL_PITCH_MM = 5.0
"""Distance of taxel centres (Materials and Methods, Tactile Sensor Array)."""
SMALL = 8
PLAIN_SHADE = 0.88
TRACE_SHARE = 0.94
"""Height of a trace, as a share of its row."""
SPEED_OVER_S = 0.05
"""The thin line of the velocity is the slope of the track over this time, both ways."""
TITLE: Any = {"size": 8.5, "loc": "left", "color": TEXT, "pad": 4}
RIGHT, WRONG = "#1a7f37", "#cf222e"
SIZE_IN = (11.2, 6.5)
PLATE = (0.052, 0.676, 0.93, 0.202)
READINGS, VELOCITY = (0.052, 0.34, 0.25, 0.255), (0.052, 0.095, 0.25, 0.205)
SPIKES, FEATURES = (0.345, 0.34, 0.375, 0.255), (0.345, 0.095, 0.375, 0.195)
ANSWER, BARS = (0.79, 0.385, 0.2, 0.23), (0.835, 0.095, 0.155, 0.235)
"""Left, bottom, width and height of the axes, as shares of the figure."""


class PlateRelief(NamedTuple):
    """Printed heights along a plate, float64 (cells,) in mm, a cell of 0.25 mm after the other.

    ``words``: the texture in a few words, such as "waves, 16 mm apart".
    """

    heights_mm: NDArray[np.float64]
    words: str


def plate_relief(header: SessionHeader, texture: str, path: Path) -> PlateRelief | None:
    """Return the relief of a plate, or None where it is not known.

    It is not on a real rig, and not in the world of another version of rigctl.
    """
    if not header.simulated:
        return None
    try:
        world = world_from_header(header.simulation, path)
    except SessionError:
        return None
    if world is None or texture not in plate_names(world.parameters):
        return None
    plate = find_texture(texture, world.parameters)
    along_mm = np.arange(0.0, PLATE_MM, CELL_MM) + CELL_MM / 2
    heights = printed_heights(plate, along_mm, world.parameters)
    if plate.height == 0.0:
        return PlateRelief(np.zeros_like(along_mm), plate.group)
    space_mm = world.parameters.base_space_mm * plate.space
    return PlateRelief(heights, f"{plate.group}, {space_mm:g} mm apart")


@dataclass(frozen=True, slots=True, eq=False)
class ScanTimeline:
    """A scan. Every time is in seconds since its first sample.

    Readings and positions have the time at which they were taken; batches, spikes, windows and
    answers that at which the computer had them.

    ``reading_s`` float64 (n,), ``readings`` float64 (n, 9): shares of each taxel's range.
    ``track_s``, ``along_mm``, ``across_mm`` float64 (m,): valid positions, on the plate.
    ``batch_start_s``, ``batch_end_s``, ``batch_mm_s``, ``batch_known_s`` float64 (batches,): the
    mean velocities that the board used. ``spike_mm``, ``spike_known_s`` float64 (k,) and
    ``spike_taxel`` int64 (k,): spikes in scaled time, as distance. ``rates_hz`` float64
    (windows, 9) with ``window_known_s``. ``answer_s`` float64 (answers,) with ``answers``.
    """

    session: Path
    trial: FingerTrialRow
    simulated: bool
    sensor_layout: SensorLayout
    relief: PlateRelief | None
    window_mm: float
    duration_s: float
    reading_s: Floats
    readings: Floats
    track_s: Floats
    along_mm: Floats
    across_mm: Floats
    batch_start_s: Floats
    batch_end_s: Floats
    batch_mm_s: Floats
    batch_known_s: Floats
    spike_mm: Floats
    spike_known_s: Floats
    spike_taxel: NDArray[np.int64]
    rates_hz: Floats
    window_known_s: Floats
    answer_s: Floats
    answers: tuple[PredictionRow, ...]


def read_timeline(path: Path, trial_id: int | None = None) -> ScanTimeline:
    """Return the scan of a trial; by default of the last committed one.

    Of several attempts the committed one is taken, else the last one with a scan. Raises
    SessionError for another kind of folder, :class:`WrongUse` for a trial without a scan.
    """
    with FingerSession.open(path) as session:
        return _timeline(session, _index_of(session, trial_id))


def _index_of(session: FingerSession, trial_id: int | None) -> int:
    rows = session.trials
    scanned = (rows["first_sample"] >= 0) & (rows["count"] > 0)
    committed = scanned & (rows["verdict"] == Verdict.COMMITTED.value)
    if trial_id is None:
        if not committed.any():
            raise WrongUse(f"{session.path} has no committed scan: name a rejected one by --trial")
        return int(np.flatnonzero(committed)[-1])
    own = rows["trial_id"] == trial_id
    if not own.any():
        raise WrongUse(
            f"{session.path} has no trial {trial_id}: `rigctl info {session.path}` says how many "
            "it has"
        )
    if not (own & scanned).any():
        raise WrongUse(
            f"trial {trial_id} of {session.path} has no scan, the finger did not pass the marks: "
            "name another trial"
        )
    return int(np.flatnonzero(own & (committed if (own & committed).any() else scanned))[-1])


def _timeline(session: FingerSession, index: int) -> ScanTimeline:
    trial, start_s = session.trial_row(index), session.scan_start_s(index)
    batches, windows, answers = (
        session.batches(index),
        session.windows(index),
        session.predictions(index),
    )
    ends = np.cumsum(batches["samples"], dtype=np.float64) / SAMPLE_RATE_HZ
    track = session.track(index)
    track = track[(track["valid"] == 1) & np.isfinite(track["along_mm"])]
    spike_mm, spike_batch, spike_taxel = _scaled_spikes(session, index)
    batch_known_s = batches["reported_s"] - start_s
    return ScanTimeline(
        session=session.path,
        trial=trial,
        simulated=session.header.simulated,
        sensor_layout=session.sensor_layout,
        relief=plate_relief(session.header, trial.texture, session.path),
        window_mm=WINDOW_MS * session.header.reference_um_per_s / NM_PER_MM,
        duration_s=trial.count / SAMPLE_RATE_HZ,
        reading_s=(session.counters(index) - trial.first_counter) / SAMPLE_RATE_HZ,
        readings=session.normalisation(index).apply(session.samples(index)),
        track_s=track["at_s"] - start_s,
        along_mm=track["along_mm"],
        across_mm=track["across_mm"],
        batch_start_s=ends - batches["samples"] / SAMPLE_RATE_HZ,
        batch_end_s=ends,
        batch_mm_s=batches["velocity_um_s"] / 1000.0,
        batch_known_s=batch_known_s,
        spike_mm=spike_mm,
        spike_known_s=batch_known_s[spike_batch],
        spike_taxel=spike_taxel,
        rates_hz=ScaledWindows(spike_counts(windows), windows["real_ms"].astype(np.int64)).rates_hz,
        window_known_s=windows["arrived_s"] - start_s,
        answer_s=np.array([answer.at_s for answer in answers], np.float64) - start_s,
        answers=answers,
    )


def _scaled_spikes(
    session: FingerSession, index: int
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Return distance in mm, batch and taxel (from 0) of each spike whose batch was scaled."""
    velocities = session.velocities_um_s(index)
    sample, taxel = np.nonzero(session.scan_spikes(index)[: len(velocities) * BATCH_SAMPLES])
    per_sample = np.repeat(velocities, BATCH_SAMPLES)
    start_nm = np.cumsum(per_sample) - per_sample
    return start_nm[sample] / NM_PER_MM, sample // BATCH_SAMPLES, taxel


class MovieFrame(NamedTuple):
    """The values at ``at_s``, counted: the first ``n_readings`` of the readings, and so on.

    ``scan_s``: the time of the scan so far, from 0 to its end.
    ``finger_mm``: along and across the plate; None without a position so far. ``spikes``: bool
    (k,), those that the board has scaled. ``distance_mm``: from the start of the scan, by the
    tracker.
    """

    at_s: float
    scan_s: float
    finger_mm: tuple[float, float] | None
    n_positions: int
    n_readings: int
    n_batches: int
    spikes: NDArray[np.bool_]
    n_windows: int
    answer: PredictionRow | None
    distance_mm: float


def frame_times(timeline: ScanTimeline) -> NDArray[np.float64]:
    """Return the moments of the frames, float64 (frames,), evenly spaced."""
    last_s = max([timeline.duration_s, *timeline.answer_s.tolist()]) + TRAIL_S
    n_frames = int(np.ceil((last_s + LEAD_S) / FRAME_S)) + 1
    return FRAME_S * np.arange(n_frames, dtype=np.float64) - LEAD_S


def frame_at(timeline: ScanTimeline, at_s: float) -> MovieFrame:
    """Return what was there at a moment, in seconds since the scan's first sample."""
    n_positions = _count(timeline.track_s, at_s)
    finger = None
    if n_positions:
        last = n_positions - 1
        finger = float(timeline.along_mm[last]), float(timeline.across_mm[last])
    n_answers = _count(timeline.answer_s, at_s)
    return MovieFrame(
        at_s=at_s,
        scan_s=float(np.clip(at_s, 0.0, timeline.duration_s)),
        finger_mm=finger,
        n_positions=n_positions,
        n_readings=_count(timeline.reading_s, at_s),
        n_batches=_count(timeline.batch_known_s, at_s),
        spikes=timeline.spike_known_s <= at_s,
        n_windows=_count(timeline.window_known_s, at_s),
        answer=timeline.answers[n_answers - 1] if n_answers else None,
        distance_mm=_distance_mm(timeline, at_s),
    )


def _count(times_s: NDArray[np.float64], at_s: float) -> int:
    return int(np.searchsorted(times_s, at_s, side="right"))


def _distance_mm(timeline: ScanTimeline, at_s: float) -> float:
    """Return the way between the scan's start and a moment of it."""
    if not len(timeline.track_s):
        return 0.0
    until_s = float(np.clip(at_s, 0.0, timeline.duration_s))
    here, start = np.interp([until_s, 0.0], timeline.track_s, timeline.along_mm)
    return float(here - start)


class PlatePanel:
    """The plate from above with its marks, and the finger's nine taxels and path on it."""

    def __init__(self, axes: Axes, timeline: ScanTimeline) -> None:
        self._timeline = timeline
        half = PLATE_WIDTH_MM / 2
        _draw_plate(axes, timeline.relief, half)
        for mark, name in zip(MARKS_MM, ("first mark", "second mark"), strict=True):
            axes.axvline(mark, color=TEXT, lw=1.2, ls=(0, (4, 2)))
            axes.text(mark, half + 2, f"{name} {mark:g} mm", ha="center", va="bottom", size=SMALL)
        (self._path,) = axes.plot([], [], color=BLUE, lw=1.4)
        self._taxels = axes.scatter([], [], marker="s", s=44, linewidths=0.8, zorder=4)
        self._taxels.set_edgecolor("white")
        self._taxels.set_facecolor(list(taxel_colours(timeline.sensor_layout)))
        axes.set(xlim=(0, PLATE_MM), ylim=(-half, half), aspect="equal")
        axes.set_yticks([-half, 0, half])
        axes.tick_params(labelsize=SMALL)
        axes.spines[:].set_visible(True)
        axes.grid(visible=False)
        axes.set_xlabel("along the plate (mm)", size=SMALL, labelpad=1)
        axes.set_ylabel("across (mm)", size=SMALL)

    def update(self, frame: MovieFrame) -> None:
        """Move the finger."""
        shown, timeline = slice(0, frame.n_positions), self._timeline
        near = timeline.track_s[shown] >= -LEAD_S
        self._path.set_data(timeline.along_mm[shown][near], timeline.across_mm[shown][near])
        if frame.finger_mm is None:
            return
        places = taxel_places_mm(timeline.sensor_layout)
        self._taxels.set_offsets(places + np.array(frame.finger_mm))


class VelocityPanel:
    """The tracker's speed, and the mean of each batch once the board had used it."""

    def __init__(self, axes: Axes, timeline: ScanTimeline) -> None:
        self._timeline = timeline
        self._speed_mm_s = _speed_mm_s(timeline)
        (self._speed,) = axes.plot([], [], color=MUTED, lw=0.9, label="tracker")
        (self._means,) = axes.plot([], [], color=BLUE, lw=2.4, label="board, each 100 ms")
        self._now = time_axis(axes, timeline)
        inside = (timeline.track_s >= 0) & (timeline.track_s <= timeline.duration_s)
        seen = np.concatenate([timeline.batch_mm_s, self._speed_mm_s[inside], [1.0]])
        axes.set_ylim(0, 1.35 * float(seen.max()))
        axes.set_xlabel("time since the scan began (s)", size=SMALL, labelpad=1)
        axes.set_ylabel("velocity (mm/s)", size=SMALL)
        axes.legend(loc="upper left", ncols=2, frameon=False, fontsize=SMALL, borderpad=0.1)

    def update(self, frame: MovieFrame) -> None:
        """Show the velocities so far."""
        timeline, shown = self._timeline, slice(0, frame.n_positions)
        self._speed.set_data(timeline.track_s[shown], self._speed_mm_s[shown])
        ends = [timeline.batch_start_s, timeline.batch_end_s, timeline.batch_end_s]
        heights = [
            timeline.batch_mm_s,
            timeline.batch_mm_s,
            np.full_like(timeline.batch_mm_s, np.nan),
        ]
        self._means.set_data(*(_first_rows(rows, frame.n_batches) for rows in (ends, heights)))
        self._now.set_xdata([frame.at_s, frame.at_s])


class ReadingsPanel:
    """The readings of the nine taxels, each from the lowest to the highest of its range."""

    def __init__(self, axes: Axes, timeline: ScanTimeline) -> None:
        self._timeline = timeline
        colours = taxel_colours(timeline.sensor_layout)
        self._lines: list[Line2D] = [axes.plot([], [], color=c, lw=0.9)[0] for c in colours]
        self._now = time_axis(axes, timeline)
        taxel_axis(axes, timeline.sensor_layout)
        axes.tick_params(labelbottom=False)
        axes.set_title("readings, each from 0 to 1 of its taxel's range", **TITLE)

    def update(self, frame: MovieFrame) -> None:
        """Show the readings so far."""
        shown = slice(0, frame.n_readings)
        for taxel, line in enumerate(self._lines):
            # The axis of taxels points down.
            heights = taxel + 1 + TRACE_SHARE * (0.5 - self._timeline.readings[shown, taxel])
            line.set_data(self._timeline.reading_s[shown], heights)
        self._now.set_xdata([frame.at_s, frame.at_s])


class SpikesPanel:
    """The spikes of the nine taxels in scaled time, which is distance."""

    def __init__(self, axes: Axes, timeline: ScanTimeline) -> None:
        self._timeline = timeline
        colours = taxel_colours(timeline.sensor_layout)
        self._lines: list[Line2D] = [axes.plot([], [], color=c, lw=0.4)[0] for c in colours]
        distance_axis(axes, timeline)
        taxel_axis(axes, timeline.sensor_layout)
        axes.tick_params(labelbottom=False)
        axes.set_title(f"spikes in scaled time, windows of {timeline.window_mm:g} mm", **TITLE)

    def update(self, frame: MovieFrame) -> None:
        """Show the spikes of the batches that the board has scaled."""
        for taxel, line in enumerate(self._lines):
            at = self._timeline.spike_mm[frame.spikes & (self._timeline.spike_taxel == taxel)]
            y = np.tile([taxel + 1 - 0.4, taxel + 1 + 0.4, np.nan], len(at))
            line.set_data(np.repeat(at, 3), y)


class FeaturesPanel:
    """The features of Speed Scaled as an image: a column for each window, a row for each taxel."""

    def __init__(self, axes: Axes, timeline: ScanTimeline) -> None:
        rates = timeline.rates_hz[:N_WINDOWS]
        self._rates_hz = np.full((N_FINGER_TAXELS, N_WINDOWS), np.nan)
        self._rates_hz[:, : len(rates)] = rates.T
        extent = (0, N_WINDOWS * timeline.window_mm, N_FINGER_TAXELS + 0.5, 0.5)
        self._image: Any = axes.imshow(
            np.full_like(self._rates_hz, np.nan),
            extent=extent,
            aspect="auto",
            cmap="viridis",
            vmin=0.0,
            vmax=max([float(rates.max(initial=0.0)), 1.0]),
            interpolation="nearest",
        )
        bar = axes.figure.colorbar(self._image, cax=axes.inset_axes((1.025, 0.0, 0.025, 1.0)))
        bar.ax.set_title("Hz", size=SMALL, pad=3)
        bar.ax.tick_params(labelsize=SMALL - 1, length=2)
        distance_axis(axes, timeline)
        taxel_axis(axes, timeline.sensor_layout)
        axes.set_xlabel("distance in scaled time (mm)", size=SMALL, labelpad=1)
        axes.set_title(f"features: {N_FINGER_TAXELS} spike rates in {N_WINDOWS} windows", **TITLE)

    def update(self, frame: MovieFrame) -> None:
        """Show the windows so far."""
        shown = self._rates_hz.copy()
        shown[:, frame.n_windows :] = np.nan
        self._image.set_data(shown)


def time_axis(axes: Axes, timeline: ScanTimeline) -> Line2D:
    """Give axes the time of the scan; return the line that marks the moment."""
    axes.set_xlim(0, timeline.duration_s)
    axes.tick_params(labelsize=SMALL)
    return axes.axvline(0.0, color=MUTED, lw=0.8)


def distance_axis(axes: Axes, timeline: ScanTimeline) -> None:
    """Give axes the distance of the scan with a line at each window's edge."""
    edges = np.arange(N_WINDOWS + 1) * timeline.window_mm
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xticks(edges[::5])
    axes.set_xticks(edges, minor=True)
    axes.grid(axis="x", which="both", color=FAINT, lw=0.6)
    axes.tick_params(labelsize=SMALL)


def taxel_colours(layout: SensorLayout) -> tuple[str, ...]:
    """Return the colour of each taxel: that of its row."""
    rows = map(layout.row_of, range(layout.n_taxels))
    return tuple(ROW_COLOURS[row % len(ROW_COLOURS)] for row in rows)


def taxel_places_mm(layout: SensorLayout) -> NDArray[np.float64]:
    """Return each taxel's place from the sensor's middle, along and across, float64 (n, 2)."""
    row, column = np.divmod(np.arange(layout.n_taxels) % layout.per_layer, layout.columns)
    middle = (layout.rows - 1) / 2, (layout.columns - 1) / 2
    return TAXEL_PITCH_MM * np.stack([row - middle[0], column - middle[1]], axis=1)


def taxel_axis(axes: Axes, layout: SensorLayout) -> None:
    """Give axes a row for each taxel, the first on top, in the colours of the sensor's rows."""
    axes.set_ylim(N_FINGER_TAXELS + 0.5, 0.5)
    axes.set_yticks(range(1, N_FINGER_TAXELS + 1))
    axes.tick_params(axis="y", labelsize=SMALL - 1, length=0)
    for label, colour in zip(axes.get_yticklabels(), taxel_colours(layout), strict=True):
        label.set_color(colour)
    axes.set_ylabel("taxel", size=SMALL)


def _draw_plate(axes: Axes, relief: PlateRelief | None, half: float) -> None:
    """Draw the plate, its ridges light; one tone where it is smooth or not known."""
    heights = np.zeros(1) if relief is None else relief.heights_mm
    highest = float(heights.max())
    shade = 0.72 + 0.28 * heights / highest if highest else np.full(1, PLAIN_SHADE)
    extent = (0, PLATE_MM, -half, half)
    axes.imshow(
        shade[None], extent=extent, cmap="gray", vmin=0.0, vmax=1.02, interpolation="nearest"
    )


def _speed_mm_s(timeline: ScanTimeline) -> NDArray[np.float64]:
    """Return the slope of the track at each position, by the positions 50 ms before and after."""
    at_s = timeline.track_s
    if len(at_s) < 2:
        return np.zeros(len(at_s))
    early, late = at_s - SPEED_OVER_S, at_s + SPEED_OVER_S
    early, late = np.maximum(early, at_s[0]), np.minimum(late, at_s[-1])
    way = np.interp(late, at_s, timeline.along_mm) - np.interp(early, at_s, timeline.along_mm)
    speed: NDArray[np.float64] = way / (late - early)
    return speed


def _first_rows(columns: list[NDArray[np.float64]], n: int) -> NDArray[np.float64]:
    """Return the first n rows of three columns, one after the other: a broken line."""
    return np.stack(columns, axis=1)[:n].reshape(-1)


class AnswerPanel:
    """The answer large, ✓ green or ✗ red, above a bar for the probability of each texture."""

    def __init__(self, words: Axes, bars: Axes, timeline: ScanTimeline) -> None:
        self._plate = timeline.trial.texture
        self._textures = sorted({name for one in timeline.answers for name in one.probabilities})
        words.set_axis_off()
        style: dict[str, Any] = {"transform": words.transAxes, "ha": "center"}
        self._letter = words.text(0.5, 0.52, "", size=52, weight="bold", va="center", **style)
        self._says = words.text(0.5, 0.13, "", size=9.5, va="center", color=TEXT, **style)
        self._set = words.text(0.5, -0.03, "", size=SMALL, va="center", color=MUTED, **style)
        self._bars: Any = ()
        self._shares: list[Any] = []
        if self._textures:
            self._letter.set(text="–", color=FAINT)
            self._says.set_text("no answer yet")
            self._draw_bars(bars)
        else:
            self._says.set_text("this scan is not classified")
            bars.set_axis_off()

    def update(self, frame: MovieFrame) -> None:
        """Show the newest answer."""
        answer = frame.answer
        if answer is None:
            return
        correct = answer.texture == self._plate
        colour = RIGHT if correct else WRONG
        self._letter.set(text=f"{answer.texture} {'✓' if correct else '✗'}", color=colour)
        self._says.set_text(answer_words(answer))
        self._set.set_text(doubt_words(answer))
        for name, bar, share in zip(self._textures, self._bars, self._shares, strict=True):
            value = answer.probabilities.get(name, 0.0)
            bar.set_width(value)
            bar.set_color(colour if name == answer.texture else "#b6bfc9")
            share.set(text=f"{value:.0%}", x=value + 0.02)

    def _draw_bars(self, axes: Axes) -> None:
        places = range(len(self._textures))
        self._bars = axes.barh(list(places), [0.0] * len(self._textures), height=0.68)
        self._shares = [axes.text(0.02, place, "", va="center", size=SMALL) for place in places]
        names = [f"plate ▸ {name}" if name == self._plate else name for name in self._textures]
        axes.set_yticks(list(places), names)
        axes.tick_params(axis="y", length=0, labelsize=9)
        axes.tick_params(axis="x", labelsize=SMALL)
        axes.set(xlim=(0, 1.12), ylim=(len(self._textures) - 0.5, -0.5))
        axes.set_xticks([0, 0.5, 1], ["0", "50", "100"])
        axes.set_xlabel("probability (%)", size=SMALL, labelpad=1)


def answer_words(answer: PredictionRow) -> str:
    """Return what the answer rests on."""
    if answer.is_final:
        return f"final answer, {answer.seconds:.2f} s, {answer.distance_mm:.0f} mm"
    return f"so far, after {answer.windows} of {N_WINDOWS} windows"


def doubt_words(answer: PredictionRow) -> str:
    """Return how sure the answer is."""
    if not answer.known:
        return "unlike every trained texture"
    is_all = len(answer.texture_set) == len(answer.probabilities)
    names = "every texture" if is_all else " ".join(answer.texture_set)
    return f"{COVERAGE:.0%} set: {names}" + (" · sure enough to decide" if answer.decided else "")


def title_of(timeline: ScanTimeline) -> str:
    """Return the plate of a scan, with its texture where it is known."""
    relief = timeline.relief
    return f"Plate {timeline.trial.texture}" + (f": {relief.words}" if relief else "")


def words_of(timeline: ScanTimeline) -> str:
    """Return scan, stage and velocity profile, and the reasons where it was not committed."""
    trial = timeline.trial
    words = f"scan {trial.trial_id} of stage {trial.stage}, velocity profile {trial.profile}"
    if trial.verdict is not Verdict.COMMITTED:
        words += f"; {trial.verdict}: {'; '.join(trial.reasons)}"
    return words


def foot_of(timeline: ScanTimeline) -> str:
    """Return the origin of the scan and the movie's pace."""
    source = "Simulated finger" if timeline.simulated else "Recorded finger"
    return (
        f"{source} · session {timeline.session.name} · plays in real time, {1 / FRAME_S:g} frames "
        "a second; spikes, features and answers appear when the computer had them"
    )


def write_movie(timeline: ScanTimeline, out: Path, progress: Progress) -> None:
    """Write a movie in real time, or for ``.png`` its last frame.

    Raises as :func:`rigctl.analysis.movies.write_movie_file` does.
    """
    write_movie_file(partial(scan_movie, timeline), out, progress)


def scan_movie(timeline: ScanTimeline) -> Movie:
    """Return the movie of a scan, in real time."""
    import matplotlib as mpl

    figure, times = new_movie_figure(SIZE_IN), frame_times(timeline)
    add: Any = figure.add_axes
    with mpl.rc_context(STYLE):
        panels = (
            PlatePanel(add(PLATE), timeline),
            ReadingsPanel(add(READINGS), timeline),
            VelocityPanel(add(VELOCITY), timeline),
            SpikesPanel(add(SPIKES), timeline),
            FeaturesPanel(add(FEATURES), timeline),
            AnswerPanel(add(ANSWER), add(BARS), timeline),
        )
    texts = title_of(timeline), words_of(timeline), foot_of(timeline)
    write_head(figure, *texts, timeline.simulated)
    clock = write_clock(figure)

    def set_frame(number: int) -> None:
        frame = frame_at(timeline, float(times[number]))
        for panel in panels:
            panel.update(frame)
        clock.set_text(f"{frame.scan_s:.2f} s   {frame.distance_mm:.0f} mm")
        show_dollars(figure)

    return Movie(figure, len(times), set_frame, rare_colours=(RIGHT, WRONG))
