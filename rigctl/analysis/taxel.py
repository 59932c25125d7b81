"""One taxel of one trial on its way through the encoder: as figure, table and movie."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.cache import Resources
from rigctl.analysis.files import atomic_file
from rigctl.analysis.force_scaling import ScaledBy, choose_reference, sa_factors, trials_to_encode
from rigctl.analysis.movies import (
    FRAME_S,
    Movie,
    Progress,
    check_movie_file,
    new_movie_figure,
    write_clock,
    write_head,
    write_movie_file,
)
from rigctl.analysis.report.figures import (
    DPI,
    FAINT,
    MUTED,
    RA_COLOUR,
    STYLE,
    TEXT,
    caption,
    new_figure,
    save_figure,
)
from rigctl.analysis.settings import AnalysisSettings, check_reference_force
from rigctl.analysis.spike_counts import (
    PreparedTrials,
    RangesOver,
    count_conditions,
    group_by_condition,
    join_searched_c,
    prepare_trials,
)
from rigctl.analysis.stimulation import (
    channels_of,
    check_stimulation_file,
    describe_limits,
    pulses_of,
    to_text,
)
from rigctl.analysis.trial_set import TrialRef, TrialSet, join_sessions, open_trials
from rigctl.config.text_file import shorten
from rigctl.encoder.encoder import encode_trials, membrane_mv
from rigctl.encoder.features import REFERENCE_SPEED_MM_S
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, EncoderParameters, RaDerivative
from rigctl.encoder.ra_filter import ra_signals
from rigctl.errors import WrongUse
from rigctl.session.header import IMPORTED
from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

Floats = NDArray[np.float64]
CHANNELS = ("SA", "RA")
MAX_LETTERS = 20
"""Of a texture's name, in a title."""
COLUMNS = (
    "sample", "time_s", "reading", "low_passed", "derivative", "sa_current", "ra_current",
    "sa_mv", "ra_mv", "sa_spikes", "ra_spikes",
)  # fmt: skip
_FORMATS = ("%d", "%.3f", "%.6f", "%.6f", "%.6f", "%.4f", "%.4f", "%.4f", "%.4f", "%d", "%d")
SA_COLOUR = "#1f4fd1"
COLOURS = (SA_COLOUR, RA_COLOUR)
HEIGHTS_OF_2C = (2.2, 1.6, 0.5, 1.6, 0.5)
HEIGHTS_OF_2D = (1.7, 1.2, 1.2, 1.3, 0.5, 1.2, 1.3, 0.5, 0.9)
"""Relative heights of the panels of Figure 2C, and of Figure 2D with the scaled spikes below."""
SHOWN_TRIAL = ("L", 80.0, 500.0)
"""Texture, speed and force of the paper's Figure 2C."""
SHOWN_S = 1.0
"""Length of the paper's Figure 2C."""
FORMATS = (".svg", ".png", ".pdf")
SIZE_IN = (9.6, 8.6)
MAX_WORDS = 110
"""Of the words below the title: the clock stands beside them."""
MOVIE_S = 10.0
"""How long a movie plays, whatever the length of the section."""


def trials_origin(trials: TrialSet) -> str:
    """Return the origin of the data, for the foot of a figure."""
    rigs = {str(source["rig"]) for source in trials.provenance}
    bench = "Imported recordings" if rigs == {IMPORTED} else "Real bench"
    bench = "Simulated bench" if trials.simulated else bench
    first, n = trials.paths[0].name, len(trials.paths)
    rest = f" and {n - 1} more" if n > 1 else ""
    return f"{bench} · session {first}{rest} · {len(trials.trials):,} trials"


def check_selection(trials: TrialSet, trial: int | None, taxel: int | None) -> None:
    """Raise WrongUse for a trial or a taxel, counted from 1, that the set does not have."""
    if taxel is not None and not 1 <= taxel <= trials.n_taxels:
        raise WrongUse(f"there is no taxel {taxel}: choose 1 to {trials.n_taxels}")
    if trial is not None and not any(t.trial_id == trial for t in trials.trials):
        raise WrongUse(f"no session has a committed trial {trial} with motion")


def chosen_trial(trials: TrialSet, trial_id: int | None = None) -> int:
    """Return the row of a trial, by default of that nearest to the paper's Figure 2C.

    Of several sessions with a trial of this number, the first counts. Raises WrongUse for a trial
    with gaps.
    """
    texture, speed, force = SHOWN_TRIAL
    if trial_id is not None:
        matching = [row for row, t in enumerate(trials.trials) if t.trial_id == trial_id]
        if not matching:
            raise WrongUse(f"trial {trial_id} has gaps or no C: choose another for the figure")
        return matching[0]

    def distance(row: int) -> tuple[bool, float, float]:
        t = trials.trials[row]
        return t.texture != texture, abs(t.speed_mm_s - speed), abs(t.force_g - force)

    return min(range(len(trials.trials)), key=distance)


@dataclass(frozen=True, slots=True)
class TaxelCourse:
    """The signals of the paper's Figure 2D for one taxel, one value a sample.

    ``reading``: float64 (n,), 0–1, as encoded. ``low_passed``: the reading behind the RA filter.
    ``derivative``: its change, in ``derivative_unit``. ``current``: float64 (n, 2), SA and RA,
    mV/ms. ``membrane_mv``: float64 (n, 2). ``spikes``: int32 sample indices of SA and of RA.
    ``c``: the factor on the SA current. ``time_scale``: that of equation 2 on the times of spikes.
    """

    title: str
    words: str
    origin: str
    simulated: bool
    reading: Floats
    low_passed: Floats
    derivative: Floats
    derivative_unit: str
    current: Floats
    membrane_mv: Floats
    spikes: tuple[NDArray[np.int32], NDArray[np.int32]]
    c: float = 1.0
    time_scale: float = 1.0

    @property
    def duration_s(self) -> float:
        """Length of the trial."""
        return len(self.reading) / SAMPLE_RATE_HZ


def load_course(
    trials: TrialSet,
    ranges: Normalisation,
    parameters: EncoderParameters,
    trial_id: int | None = None,
    taxel: int | None = None,
    c: Floats | None = None,
    reference_mm_s: float = REFERENCE_SPEED_MM_S,
) -> TaxelCourse:
    """Return the signals of a trial and taxel, by default of the trial of Figure 2C.

    The default taxel has the largest standard deviation. ``c``: factors on the SA current, float64
    (n_trials, n_taxels). ``reference_mm_s``: the speed of scaled time. Raises WrongUse for a trial
    that is not in the set.
    """
    row = chosen_trial(trials, trial_id)
    trial = trials.trials[row]
    with open_trials(trials.files) as reader:
        samples = reader.read(trial)
    index = taxel - 1 if taxel else int(ranges.apply(samples).std(axis=0).argmax())
    factor = 1.0 if c is None else float(c[row, index])
    own = replace(ranges, low=ranges.low[[index]], high=ranges.high[[index]])
    words = _words(trials, trial, index, ranges, parameters, None if c is None else factor)
    simulated = bool(trials.provenance[trial.session]["simulated"])
    texts = (_title(trial, index), words, trials_origin(trials), simulated)
    course = _encode(samples[:, [index]], own, parameters, factor, texts)
    return replace(course, time_scale=trial.speed_mm_s / reference_mm_s)


def write_course(course: TaxelCourse, path: Path) -> None:
    """Write each sample as a line of text, behind a line that says whose they are and the units."""
    n = len(course.reading)
    counts = [np.bincount(train, minlength=n) for train in course.spikes]
    signals = (course.reading, course.low_passed, course.derivative)
    columns = (np.arange(n), np.arange(n) / SAMPLE_RATE_HZ, *signals, *course.current.T)
    units = (
        f"time in s, reading and low_passed 0–1, derivative {course.derivative_unit}, currents "
        f"mV/ms, v in mV, spikes a sample; {SAMPLE_RATE_HZ} samples a second"
    )
    comment = f"# {course.title}; {course.words}; {course.origin}; {units}\n"
    with path.open("w", encoding="utf-8") as file:
        file.write(f"{comment}{','.join(COLUMNS)}\n")
        table = np.column_stack((*columns, *course.membrane_mv.T, *counts))
        np.savetxt(file, table, fmt=",".join(_FORMATS))


def _encode(
    samples: NDArray[np.uint16],
    ranges: Normalisation,
    parameters: EncoderParameters,
    c: float,
    texts: tuple[str, str, str, bool],
) -> TaxelCourse:
    scale = np.array([[c]])
    (spikes,) = encode_trials([samples], ranges, parameters, sa_scale=scale)
    x = ranges.apply(samples)
    low_passed, derivative, ra_current = (signal[:, 0] for signal in ra_signals(x, parameters))
    sa_current = c * parameters.sa_gain * x[:, 0]
    per_sample = parameters.ra_derivative is RaDerivative.PER_SAMPLE
    return TaxelCourse(
        *texts,
        reading=x[:, 0],
        low_passed=low_passed,
        derivative=derivative,
        derivative_unit="1/sample" if per_sample else "1/s",
        current=np.column_stack([sa_current, ra_current]),
        membrane_mv=membrane_mv(samples, ranges, parameters, sa_scale=scale),
        spikes=(spikes.train(0), spikes.train(1)),
        c=c,
    )


def _title(trial: TrialRef, index: int) -> str:
    return (
        f"Texture {shorten(trial.texture, MAX_LETTERS)} at {trial.speed_mm_s:g} mm/s and "
        f"{trial.force_g:g} g, taxel {index + 1} of trial {trial.trial_id}"
    )


def _words(
    trials: TrialSet,
    trial: TrialRef,
    index: int,
    ranges: Normalisation,
    parameters: EncoderParameters,
    c: float | None,
) -> str:
    layout = trials.sensor_layout
    place = f"row {layout.row_of(index) + 1}, column {index % layout.columns + 1}"
    if len(layout.layers) > 1:
        place = f"layer {layout.layers[layout.layer_of(index)]}, {place}"
    span = f"0–1: {ranges.low[index]}–{ranges.high[index]} {ranges.reading.unit}"
    scaled = "without C" if c is None else f"SA current times C = {c:.4g}"
    session = trials.paths[trial.session].name
    return f"{place} · {span} · encoder {parameters.name} · {scaled} · session {session}"


class Section(NamedTuple):
    """The part of a trial that is shown, in seconds since the trial window opened."""

    start_s: float
    end_s: float


class _Trace(NamedTuple):
    """A line whose points appear at ``at_s``, ascending."""

    line: Line2D
    at_s: Floats
    x: Floats
    y: Floats


class TaxelPanels:
    """Axes, one above the other, with the signals of a section; :meth:`show_until` cuts them.

    ``axes``: as many as ``HEIGHTS_OF_2C`` or, with every signal, ``HEIGHTS_OF_2D``.
    """

    def __init__(self, axes: list[Axes], course: TaxelCourse, section: Section) -> None:
        self._course, self._section = course, section
        self._traces: list[_Trace] = []
        every_signal = len(axes) == len(HEIGHTS_OF_2D)
        rows = iter(axes)
        self._add_readings(next(rows), every_signal)
        if every_signal:
            label = f"derivative\n({course.derivative_unit})"
            self._add_signal(next(rows), label, course.derivative, RA_COLOUR)
        for channel in range(len(CHANNELS)):
            self._add_neuron(rows, channel, every_signal)
        if every_signal:
            self._add_scaled(next(rows))
        for panel in axes[:-1]:
            panel.tick_params(labelbottom=False)
        axes[-1].set_xlim(*section)
        axes[-1].set_xlabel("time since the trial window opened (s)")

    def show_until(self, at_s: float) -> None:
        """Show what there was up to a moment, in seconds since the trial window opened."""
        for trace in self._traces:
            n = int(np.searchsorted(trace.at_s, at_s, side="right"))
            trace.line.set_data(trace.x[:n], trace.y[:n])

    def _add_readings(self, axes: Axes, every_signal: bool) -> None:
        course = self._course
        if not every_signal:
            self._add_signal(axes, "reading\n(0–1)", course.reading, TEXT)
            return
        self._add_signal(axes, "reading\n(0–1)", course.reading, MUTED, "reading I(t)")
        self._trace(axes, course.low_passed, RA_COLOUR, 1.2, "low-passed, for RA")
        axes.legend(loc="upper right", ncols=2, fontsize=8, framealpha=0.85, edgecolor=FAINT)
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.35 * (high - low))

    def _add_neuron(self, rows: Any, channel: int, every_signal: bool) -> None:
        course, name, colour = self._course, CHANNELS[channel], COLOURS[channel]
        if every_signal:
            label = f"{name} current\n(mV/ms)"
            self._add_signal(next(rows), label, course.current[:, channel], colour)
        voltage = course.membrane_mv[:, channel]
        self._add_signal(next(rows), f"{name} v(t)\n(mV)", voltage, colour, width=0.7)
        self._add_spikes(next(rows), channel)

    def _add_signal(
        self,
        axes: Axes,
        label: str,
        values: Floats,
        colour: str,
        name: str | None = None,
        width: float = 1.0,
    ) -> None:
        self._trace(axes, values, colour, width, name)
        axes.set_ylabel(label)
        axes.set_xlim(*self._section)
        axes.set_ylim(*_limits(values[self._shown(len(values))]))

    def _trace(
        self, axes: Axes, values: Floats, colour: str, width: float, name: str | None
    ) -> None:
        shown = self._shown(len(values))
        at_s = np.arange(len(values))[shown] / SAMPLE_RATE_HZ
        (line,) = axes.plot(at_s, values[shown], color=colour, lw=width, label=name)
        self._traces.append(_Trace(line, at_s, at_s, values[shown]))

    def _add_spikes(self, axes: Axes, channel: int) -> None:
        """Draw the spikes: a tick from 0 to 1 at each."""
        at_s = self._ticks(axes, channel, (0.0, 1.0))
        axes.set(ylim=(-0.1, 1.1), yticks=[], xlim=tuple(self._section))
        axes.set_ylabel("spikes", rotation=0, ha="right", va="center", size=8, color=MUTED)
        if not len(at_s):
            style: Any = {"ha": "center", "va": "center", "size": 8, "color": MUTED}
            axes.text(0.5, 0.5, f"no {CHANNELS[channel]} spike", transform=axes.transAxes, **style)

    def _add_scaled(self, axes: Axes) -> None:
        """Draw the spikes of both neurons in scaled time since the section's start, SA on top."""
        scale = self._course.time_scale
        for channel in range(len(CHANNELS)):
            self._ticks(axes, channel, (1.1 - channel * 1.1, 2.1 - channel * 1.1), scale)
        axes.set(ylim=(-0.1, 2.2), yticks=[0.5, 1.6], yticklabels=CHANNELS[::-1])
        axes.tick_params(axis="y", length=0, labelsize=8)
        axes.set_ylabel(f"scaled\n(× {scale:.3g})", size=8, color=MUTED)

    def _ticks(
        self, axes: Axes, channel: int, y: tuple[float, float], scale: float = 1.0
    ) -> Floats:
        """Draw the spikes of the section as one broken line; return their times."""
        start_s, end_s = self._section
        at_s = self._course.spikes[channel] / SAMPLE_RATE_HZ
        at_s = at_s[(at_s >= start_s) & (at_s < end_s)]
        x = np.repeat(start_s + scale * (at_s - start_s), 3)
        heights = np.tile([*y, np.nan], len(at_s))
        (line,) = axes.plot(x, heights, color=COLOURS[channel], lw=0.9, solid_capstyle="butt")
        self._traces.append(_Trace(line, np.repeat(at_s, 3), x, heights))
        return np.asarray(at_s)

    def _shown(self, n: int) -> slice:
        first = round(self._section.start_s * SAMPLE_RATE_HZ)
        return slice(min(first, n), min(round(self._section.end_s * SAMPLE_RATE_HZ), n))


def _limits(values: Floats) -> tuple[float, float]:
    """Return the limits of an axis around values, also where all are equal."""
    low, high = float(values.min()), float(values.max())
    margin = 0.06 * (high - low) or 0.5
    return low - margin, high + margin


def draw_taxel(course: TaxelCourse, stem: Path, start_s: float = 0.0) -> Path:
    """Draw reading, voltages and spikes of a second to ``stem``.svg and .png."""
    section = Section(start_s, min(start_s + SHOWN_S, course.duration_s))
    figure = _figure(course, section, (9.5, 5.6), HEIGHTS_OF_2C)
    shown = f"{section.start_s:g} to {section.end_s:g} s" if start_s else "up to its first second"
    title = f"{course.title}, {shown} (as Fig. 2C)"
    return save_figure(figure, stem, title, course.origin)


def draw_every_signal(course: TaxelCourse, section: Section, stem: Path) -> Path:
    """Draw every signal of a section to ``stem``.svg and .png; return the PNG."""
    figure = _every_signal(course, section)
    return save_figure(figure, stem, _title_of(course), course.origin)


def write_taxel_figure(course: TaxelCourse, section: Section, out: Path) -> None:
    """Write the figure of every signal of a section, as the end of the name says.

    Raises WrongUse as :func:`check_figure_file` does, DiskFault where it cannot be written.
    """
    import matplotlib as mpl

    check_figure_file(out)
    figure = _every_signal(course, section)
    caption(figure, _title_of(course), course.origin)
    date = "CreationDate" if out.suffix == ".pdf" else "Date"
    metadata = {"Software": None} if out.suffix == ".png" else {date: None}
    with (
        atomic_file(out) as partial,
        mpl.rc_context({"svg.hashsalt": "rigctl", "svg.fonttype": "none"}),
    ):
        figure.savefig(partial, format=out.suffix[1:], dpi=DPI, metadata=metadata)


def check_figure_file(out: Path) -> None:
    """Raise WrongUse for a name that is no figure's, or whose file exists."""
    if out.suffix not in FORMATS:
        raise WrongUse(f"{out} is none of {', '.join(FORMATS)}: give the file one of these ends")
    if out.exists():
        raise WrongUse(f"{out} already exists: name another file, or remove it")


def _title_of(course: TaxelCourse) -> str:
    return f"{course.title}: from the reading to scaled spikes (Fig. 2D)"


def _every_signal(course: TaxelCourse, section: Section) -> Figure:
    figure = _figure(course, section, (9.5, 9.0), HEIGHTS_OF_2D)
    figure.axes[0].set_title(course.words, size=8.5, loc="left", color=MUTED)
    return figure


def _figure(
    course: TaxelCourse, section: Section, size_in: tuple[float, float], heights: tuple[float, ...]
) -> Figure:
    figure, rows = new_figure(size_in, len(heights), 1, sharex=True, height_ratios=heights)
    TaxelPanels(list(rows), course, section)
    figure.align_ylabels(rows)
    return figure


def write_taxel_movie(
    course: TaxelCourse,
    section: Section,
    out: Path,
    progress: Progress,
    movie_s: float = MOVIE_S,
) -> None:
    """Write the movie of a section, which plays for ``movie_s``; for ``.png`` its last frame.

    Raises as :func:`rigctl.analysis.movies.write_movie_file` does.
    """
    write_movie_file(partial(taxel_movie, course, section, movie_s), out, progress)


def taxel_movie(course: TaxelCourse, section: Section, movie_s: float = MOVIE_S) -> Movie:
    """Return the movie of a section of a trial."""
    import matplotlib as mpl

    figure = new_movie_figure(SIZE_IN)
    with mpl.rc_context(STYLE):
        grid = {"left": 0.1, "right": 0.985, "top": 0.905, "bottom": 0.085, "hspace": 0.16}
        ratios = {"height_ratios": HEIGHTS_OF_2D, **grid}
        rows = figure.subplots(len(HEIGHTS_OF_2D), 1, sharex=True, gridspec_kw=ratios)
        panels = TaxelPanels(list(rows), course, section)
    figure.align_ylabels(rows)
    foot = f"{course.origin} · {_pace(section, movie_s)}"
    words = shorten(course.words, MAX_WORDS)
    write_head(figure, course.title, words, foot, course.simulated)
    clock = write_clock(figure)
    n_frames = ceil(movie_s / FRAME_S) + 1

    def set_frame(number: int) -> None:
        share = number / (n_frames - 1)
        at_s = section.start_s + share * (section.end_s - section.start_s)
        panels.show_until(at_s)
        clock.set_text(f"{at_s:.3f} s")

    return Movie(figure, n_frames, set_frame)


def _pace(section: Section, movie_s: float) -> str:
    """Return how fast the movie plays, in words."""
    slower = movie_s / (section.end_s - section.start_s)
    if slower < 1:
        return f"plays {1 / slower:.3g} times faster than real time"
    return f"plays {slower:.3g} times slower than real time"


@dataclass(frozen=True, slots=True)
class EncodeRequest:
    """What to encode and how, and the files to write.

    ``settings``: windows, trained conditions, reference force, pulses. ``stimulation``: file of the
    pulses of one ``trial``. ``figure``, ``csv``, ``movie``:
    files of one ``taxel`` of one ``trial``; ``start_s``, ``seconds``: the section of figure and
    movie, the table has the whole trial.
    """

    sessions: tuple[Path, ...]
    parameters: EncoderParameters = DEFAULT
    settings: AnalysisSettings = field(default_factory=AnalysisSettings)
    ranges: RangesOver | Normalisation = RangesOver.ALL
    scaled_by: ScaledBy = ScaledBy.NONE
    trial: int | None = None
    taxel: int | None = None
    start_s: float = 0.0
    seconds: float = SHOWN_S
    figure: Path | None = None
    csv: Path | None = None
    movie: Path | None = None
    stimulation: Path | None = None

    @property
    def reference_g(self) -> float:
        """The force to which C scales the others."""
        return self.settings.conditions.reference_force_g

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of one taxel."""
        return tuple(filter(None, (self.figure, self.csv, self.movie, self.stimulation)))

    def check_files(self) -> None:
        """Raise WrongUse for a file that exists, or whose name has another end."""
        if self.figure is not None:
            check_figure_file(self.figure)
        if self.csv is not None and self.csv.exists():
            raise WrongUse(f"{self.csv} already exists: name another file, or remove it")
        if self.movie is not None:
            check_movie_file(self.movie)
        if self.stimulation is not None:
            check_stimulation_file(self.stimulation)


def encode_taxel(request: EncodeRequest, resources: Resources) -> tuple[str, ...]:
    """Write the files of a request; return remarks on the trials.

    Raises WrongUse for a trial, taxel or section that is not there and for files that exist,
    SessionError for what cannot be encoded, DiskFault where a file cannot be written.
    """
    request.check_files()
    trials = join_sessions(request.sessions, resources.progress, request.parameters.reading)
    check_selection(trials, request.trial, request.taxel)
    check_reference_force(request.settings, trials.forces_g)
    reference_g, _ = choose_reference(trials, request.reference_g)
    request = replace(request, settings=request.settings.with_reference_force(reference_g))
    trials = trials_to_encode(trials, reference_g, request.scaled_by)
    prepared = prepare_trials(trials, resources, request.ranges, request.settings)
    c = _searched_factors(request, prepared, resources)
    chosen = request.parameters, request.trial, request.taxel
    reference_mm_s = request.settings.windows.reference_speed_mm_s
    course = load_course(prepared.trials, prepared.normalisation, *chosen, c, reference_mm_s)
    section = _section_of(request, course)
    if request.figure is not None:
        write_taxel_figure(course, section, request.figure)
    if request.csv is not None:
        with atomic_file(request.csv) as partial:
            write_course(course, partial)
    if request.movie is not None:
        write_taxel_movie(course, section, request.movie, resources.progress)
    remarks = prepared.trials.remarks
    if request.stimulation is not None:
        remarks = (*remarks, _write_stimulation(request, prepared, c, request.stimulation))
    return remarks


def _write_stimulation(
    request: EncodeRequest, prepared: PreparedTrials, c: Floats | None, path: Path
) -> str:
    """Write the pulses of the chosen trial; return what the limits took, in a sentence."""
    trials, ranges = prepared.trials, prepared.normalisation
    settings = request.settings.stimulation
    channels = channels_of(settings, trials.sensor_layout)
    row = chosen_trial(trials, request.trial)
    trial = trials.trials[row]
    with open_trials(trials.files) as reader:
        samples = reader.read(trial)
    scale = None if c is None else c[[row]]
    (spikes,) = encode_trials([samples], ranges, request.parameters, sa_scale=scale)
    pulses = pulses_of(spikes, ranges.apply(samples), channels, settings)
    about = f"trial {trial.trial_id}, {trials_origin(trials)}"
    with atomic_file(path) as partial:
        partial.write_text(to_text(pulses, settings, about, path.suffix), encoding="utf-8")
    return describe_limits(pulses)


def _section_of(request: EncodeRequest, course: TaxelCourse) -> Section:
    if request.start_s >= course.duration_s:
        raise WrongUse(
            f"--start {request.start_s:g} is behind the end of the trial, which has "
            f"{course.duration_s:g} s: choose an earlier one"
        )
    return Section(request.start_s, min(request.start_s + request.seconds, course.duration_s))


def _searched_factors(
    request: EncodeRequest, prepared: PreparedTrials, resources: Resources
) -> NDArray[np.float64] | None:
    """Return the factors on the SA current; C is searched only where the request asks for it."""
    if request.scaled_by is ScaledBy.NONE:
        return None
    conditions = group_by_condition(
        prepared, request.parameters, request.reference_g, search_c=True
    )
    counted = list(count_conditions(prepared, conditions, resources))
    return sa_factors(prepared, join_searched_c(conditions, counted), request.scaled_by)
