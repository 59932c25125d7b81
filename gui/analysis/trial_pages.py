"""The pages of a trial: samples and spikes, force and speed, features, and responses compared."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import ceil
from typing import Any, NamedTuple

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, Qt, Signal
from PySide6.QtWidgets import QWidget

from gui.analysis.export import ExportButton, Picture, foot_text, widget_picture, with_foot
from gui.analysis.open_sessions import NeuronResponse, ResponseGrid
from gui.analysis.overlay_view import OverlayView
from gui.analysis.quality_view import QualityView
from gui.analysis.task_values import Section, TrialCourse, TrialData, TrialFeatures
from gui.analysis.trial_overlay import TrialOverlay
from gui.analysis.trial_sections import COURSE_NAMES, course_columns, reading_columns, reading_names
from gui.analysis.trial_view import LEAST_PX, TrialView, add_marks, wider
from gui.analysis.value_file import SIMULATED, data_words, yes_or_no
from gui.live.drum_course import SHOWN_POINTS, thin_out
from gui.widgets.labels import label
from gui.widgets.layouts import ComboBox, PageTabs, hbox, push_button, vbox
from gui.widgets.plot_axes import (
    ColourScale,
    Plot,
    PlotGrid,
    colour_axes,
    fixed_plot,
    label_axis,
    reserve,
    reserve_right,
    text_width_px,
    time_plot,
    title_plot,
    whole_ticks,
)
from gui.widgets.theme import Theme, scaled_px, text_scale
from rigctl.values import SAMPLE_RATE_HZ, TrialMark

COURSE_FACTOR = 1024
"""Samples in a group of a section that is read for its force and speed."""


class CourseView(PlotGrid):
    """Two plots over the time since the trial's first sample; dashes are what was planned.

    Of many points in view the lowest and highest of groups are drawn: STOP waits for a painting.
    """

    section_requested = Signal(int, int, int)
    """As that of :class:`gui.analysis.trial_view.TrialView`."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.course: TrialCourse | None = None
        self.heading, self._n_samples = "", 0
        self._marks: tuple[TrialMark, ...] = ()
        self._section: Section | None = None
        self.force_plot = time_plot(self.cells, 0, "Force (g)", last=False)
        self.speed_plot = time_plot(self.cells, 1, "Speed (mm/s)", last=True)
        self.speed_plot.setLabel("bottom", "Time since the first sample (s)")
        self.speed_plot.setXLink(self.force_plot)
        for plot in (self.force_plot, self.speed_plot):
            plot.setMouseEnabled(x=True, y=False)
        self._curves: list[pg.PlotCurveItem] = []
        self.force_plot.getViewBox().sigXRangeChanged.connect(lambda *_: self._draw())
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.colour(theme, self.force_plot, self.speed_plot)
        self.reserve_plots(*LEAST_PX)
        reserve_right(self.cells)
        self.show_course(self.course, self.heading, self._marks, self._n_samples)

    def show_course(
        self,
        course: TrialCourse | None,
        heading: str = "",
        marks: tuple[TrialMark, ...] = (),
        n_samples: int = 0,
    ) -> None:
        """Show force, speed and notes of the trial that the heading names, or nothing.

        ``n_samples``: of a long trial, whose sections can be read.
        """
        self.course, self.heading, self._marks = course, heading, marks
        self._n_samples, self._section = n_samples, None
        self.show_heading(self.force_plot, heading, self._theme)
        for plot in (self.force_plot, self.speed_plot):
            plot.clear()
        self._curves = []
        if course is None:
            return
        times = np.concatenate([course.force_s, course.speed_s])
        times = times[np.isfinite(times)]
        if len(times):
            self.force_plot.setXRange(times.min(), times.max(), padding=0.01)
        theme = self._theme
        self._add(self.force_plot, course.force_g, theme.force, course.planned_g)
        self._add(self.speed_plot, course.speed_mm_s, theme.speed, course.planned_mm_s)
        add_marks((self.force_plot, self.speed_plot), marks, theme)
        self._draw()

    def _add(self, plot: Plot, y: NDArray[np.float64], colour: str, planned: float) -> None:
        """Add an empty curve to a plot with room for these values, and what was planned."""
        self._curves.append(pg.PlotCurveItem(pen=pg.mkPen(colour, width=1), connect="finite"))
        plot.addItem(self._curves[-1])
        dashes = pg.mkPen(self._theme.set_point, width=1, style=Qt.PenStyle.DashLine)
        plot.addItem(pg.InfiniteLine(planned, angle=0, pen=dashes))
        known = y[np.isfinite(y)]
        low, high = min(0.0, known.min(initial=0.0)), max(planned, known.max(initial=0.0))
        plot.setYRange(low, high + 0.05 * (high - low or 1.0), padding=0)

    def show_section(self, section: Section) -> None:
        """Show all points of a part of the trial."""
        self._section = section
        self._draw()

    def _draw(self) -> None:
        """Draw what is in view, and a point beyond each end; request what was left out there."""
        if self.course is None or not self._curves:
            return
        left_s, right_s = self.force_plot.getViewBox().viewRange()[0]
        ends = np.clip([left_s * SAMPLE_RATE_HZ, right_s * SAMPLE_RATE_HZ], 0, self._n_samples)
        first, end = int(ends[0]), int(ends[1])
        section = self._section
        is_read = section is not None and section.first <= first and section.end >= end
        course = section.course if section is not None and is_read else self.course
        assert course is not None
        values = (course.force_s, course.force_g), (course.speed_s, course.speed_mm_s)
        for curve, (x, y) in zip(self._curves, values, strict=True):
            before, after = np.flatnonzero(x <= left_s)[-1:], np.flatnonzero(x >= right_s)[:1]
            part = slice(before.sum(), after.sum() + 1 if len(after) else None)
            curve.setData(*thin_out(x[part], y[part]))
            if not is_read and first < end and len(x[part]) < SHOWN_POINTS:
                is_read = True
                self.section_requested.emit(*wider(first, end, self._n_samples), COURSE_FACTOR)


WINDOW_HINT = "Point at a window to read its value"
KINDS = {"SA": "Hz", "RA": "spikes"}
"""Kind of the neurons and unit of their features."""
_SCALES = {"SA": "Rate (Hz)", "RA": "Count (spikes)"}
_SCALE_PX, _SCALE_AXIS_PX, _SCALE_GAP_PX = 12, 52, 5
_TAXEL_STEP = 4
_Ticks = list[tuple[float, str]]


class FeaturesView(PlotGrid):
    """SA and RA features with their colour scales; a line says what the pointer is on."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme, self.heading = theme, ""
        self.features: TrialFeatures | None = None
        self.plots = [
            time_plot(self.cells, row, f"{kind} neuron", last=kind == "RA")
            for row, kind in enumerate(KINDS)
        ]
        self.images = [pg.ImageItem(axisOrder="row-major") for _ in KINDS]
        self.scales = [
            _colour_scale(plot, image) for plot, image in zip(self.plots, self.images, strict=True)
        ]
        self.plots[1].setXLink(self.plots[0])
        self.plots[1].getViewBox().sigResized.connect(lambda _: self._number_windows())
        self.value = label(WINDOW_HINT, "muted")
        self.value.setContentsMargins(8, 2, 8, 2)
        layout = self.layout()
        assert layout is not None
        layout.addWidget(self.value)
        self.graphics.scene().sigMouseMoved.connect(self._point_at)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.colour(theme, *self.plots)
        for scale, name in zip(self.scales, _SCALES.values(), strict=True):
            scale.colour(theme, name)
        self.reserve_plots(*LEAST_PX)
        self.show_features(self.features, self.heading)

    def show_features(self, features: TrialFeatures | None, heading: str = "") -> None:
        """Show the features of the trial that the heading names, or nothing."""
        self.features, self.heading = features, heading
        self.show_heading(self.plots[0], heading, self._theme)
        self.value.setText(WINDOW_HINT)
        if features is None:
            for image in self.images:
                image.clear()
            return
        n, windows = len(features.values) // 2, features.values.shape[1]
        ticks = [(taxel + 0.5, f"T{taxel + 1}") for taxel in range(0, n, _TAXEL_STEP)]
        for plot, image, scale, part in zip(
            self.plots, self.images, self.scales, (0, n), strict=True
        ):
            values = features.values[part : part + n]
            image.setImage(values, autoLevels=False)
            scale.show_levels(0.0, max(1.0, float(values.max(initial=0.0))))
            plot.setXRange(0, windows, padding=0)
            plot.setYRange(0, n, padding=0)
            plot.getAxis("left").setTicks([ticks, []])
        highest = float(self.images[1].levels[1])
        self.scales[1].axis.setTicks([whole_ticks(highest), []])
        self._number_windows()

    def value_text(self, row: int, window: int) -> str:
        """Return the value of a train (SA 1 … n, RA 1 … n) in a window, with its unit."""
        assert self.features is not None
        values = self.features.values
        n = len(values) // 2
        kind, unit = list(KINDS.items())[row // n]
        name = f"{kind} of taxel {row % n + 1}, window {window + 1}"
        return f"{name}: {values[row, window]:.4g} {unit}"

    def _number_windows(self) -> None:
        """Number the windows in their middle, as many as there is room for."""
        if (features := self.features) is None:
            return
        width_px = self.plots[1].getViewBox().width()
        ticks = window_ticks(features.values.shape[1], width_px)
        for plot in self.plots:
            plot.getAxis("bottom").setTicks([ticks, []])
        length = f"{features.window_ms} ms"
        if features.window_mm:
            length = f"{features.window_mm:g} mm of texture"
        label_axis(self.plots[1], "bottom", f"Window, {length} each", self._theme)

    def _point_at(self, place: QPointF) -> None:
        if self.features is None:
            return
        n, windows = len(self.features.values) // 2, self.features.values.shape[1]
        for number, plot in enumerate(self.plots):
            if plot.getViewBox().sceneBoundingRect().contains(place):
                at = plot.getViewBox().mapSceneToView(place)
                column, row = int(np.floor(at.x())), int(np.floor(at.y()))
                if 0 <= column < windows and 0 <= row < n:
                    self.value.setText(self.value_text(number * n + row, column))


def window_ticks(n_windows: int, width_px: float) -> _Ticks:
    """Return places and numbers of windows, 1, 2, 3 … or 1, 6, 11 … where there is less room."""
    room_px = 2 * text_width_px(f"{n_windows}")
    step = next((s for s in (1, 2, 5, 10, 20) if n_windows * room_px <= s * width_px), 50)
    return [(window + 0.5, f"{window + 1}") for window in range(0, n_windows, step)]


def _colour_scale(plot: Plot, image: pg.ImageItem) -> ColourScale:
    """Add an image to a plot, and the scale of its colours beside it; taxel 1 is at the top."""
    plot.invertY(True)
    plot.addItem(image)
    scale = ColourScale(image, pg.colormap.get("viridis"), _SCALE_PX)
    plot.grid.setColumnFixedWidth(4, _SCALE_GAP_PX)
    plot.grid.addItem(scale, 2, 5)
    reserve(scale, "right", _SCALE_AXIS_PX)
    return scale


HINT = (
    "Choose a neuron. Compare shows the selected trials, or all that the filter lets through, by "
    "condition; Lay over those that are selected, or one of each open session, in one plot."
)
OVERLAY_TIP = (
    "Show the selected trials (Ctrl, Shift) over each other; of several open sessions and one "
    "selected trial, the trial of each that is most like it"
)
COLUMNS, LEFT_PX = 3, 44
LEAST_CELL_PX = 185, 240
"""Width and height of a raster with its rates."""
MOST_TICKS = 4


class CompareView(QWidget):
    """Responses of one neuron by plate, speed and force."""

    compare_requested = Signal(int, str)
    """The neuron's train (T_SA-1 … n, then T_RA-1 … n) and its name."""
    overlay_requested = Signal(int, bool)
    """The neuron's taxel, from 0, and whether it is RA."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.grid: ResponseGrid | None = None
        self.neuron = ComboBox()
        self.button = push_button("Compare", self._compare)
        self.overlay_button = push_button("Lay over", self.request_overlay, OVERLAY_TIP)
        self.note = label(HINT, "muted", wraps=True)
        self.plots = pg.GraphicsLayoutWidget()
        self.rasters: list[Plot] = []
        self.rates: list[Plot] = []
        head = (self.neuron, self.button, self.overlay_button, self.note)
        self._column = vbox(hbox(*head, wide=3, margins=(8, 6, 8, 4)), self.plots, tall=1)
        self.setLayout(self._column)
        self.show_taxels(0)
        self.set_theme(theme)

    @cached_property
    def overlaid(self) -> OverlayView:
        """The trials over each other, made when they are first needed, or by the window's turn."""
        view = OverlayView(self._theme)
        view.set_theme(self._theme)
        view.hide()
        self._column.addWidget(view, 1)
        return view

    def show_taxels(self, n_taxels: int) -> None:
        """Offer the neurons of a sensor."""
        if self.neuron.count() != 2 * n_taxels:
            self.neuron.clear()
            names = [f"T_{k}-{i + 1}" for k in ("SA", "RA") for i in range(n_taxels)]
            self.neuron.addItems(names)
        for button in (self.button, self.overlay_button):
            button.setEnabled(n_taxels > 0)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.plots.setBackground(theme.panel)
        reserve_right(self.plots.ci)
        if "overlaid" in vars(self):
            self.overlaid.set_theme(theme)
        if self.overlay is None:
            self.show_grid(self.grid)

    def show_grid(self, grid: ResponseGrid | None) -> None:
        """Show conditions, or a hint without any."""
        self._turn_to(grid, None)
        self.plots.clear()
        self.rasters, self.rates = [], []
        if grid is None or not grid.conditions:
            self.note.setText(HINT if grid is None else "No trial with samples is selected.")
            return
        dashes = "Line: mean of the trials; dashes: mean ± standard deviation."
        origin = f"{data_words(simulated=True)}. " if grid.simulated else ""
        self.note.setText(f"{origin}{grid.neuron}. {dashes} {grid.left_out}")
        top = max(float((c.mean_hz + c.sd_hz).max(initial=1.0)) for c in grid.conditions)
        columns = min(max(1, int(COLUMNS / text_scale())), len(grid.conditions))
        for number, condition in enumerate(grid.conditions):
            self._add(*divmod(number, columns), condition, top)
        rows = ceil(len(grid.conditions) / columns)
        self.plots.setMinimumSize(
            *(map(scaled_px, (columns * LEAST_CELL_PX[0], rows * LEAST_CELL_PX[1])))
        )

    def show_overlay(self, overlay: TrialOverlay) -> None:
        """Show trials over each other, of the neuron that is chosen from then on."""
        self._turn_to(None, overlay)
        self.show_taxels(overlay.n_taxels)
        self.neuron.setCurrentIndex(overlay.taxel + overlay.is_ra * overlay.n_taxels)
        self.note.setText(self.overlaid.note)

    @property
    def overlay(self) -> TrialOverlay | None:
        """The trials that are shown over each other, None where conditions are."""
        return self.overlaid.overlay if "overlaid" in vars(self) else None

    @property
    def is_simulated(self) -> bool:
        """Whether any of the data is simulated."""
        shown = self.overlay or self.grid
        return shown is not None and shown.simulated

    def values(self) -> ValueTable:
        """Return the numbers of what is shown."""
        return ValueTable(*self.overlaid.values()) if self.overlay else _response_values(self.grid)

    def request_overlay(self) -> None:
        """Ask for trials of the neuron to lay over each other."""
        n = max(1, self.neuron.count() // 2)
        is_ra, taxel = divmod(max(0, self.neuron.currentIndex()), n)
        self.overlay_requested.emit(taxel, bool(is_ra))

    def _turn_to(self, grid: ResponseGrid | None, overlay: TrialOverlay | None) -> None:
        self.grid = grid
        if overlay is not None or self.overlay is not None:
            self.overlaid.show_overlay(overlay)
            self.overlaid.setVisible(overlay is not None)
        self.plots.setVisible(overlay is None)

    def _compare(self) -> None:
        self.compare_requested.emit(self.neuron.currentIndex(), self.neuron.currentText())

    def _add(self, row: int, column: int, condition: NeuronResponse, top_hz: float) -> None:
        raster = fixed_plot(self.plots.ci, 2 * row, column)
        rate = fixed_plot(self.plots.ci, 2 * row + 1, column)
        title_plot(raster, condition.name, self._theme.text)
        raster.getAxis("bottom").setStyle(showValues=False)
        rate.setLabel("bottom", "Time (s)")
        end_s = float(condition.at_s[-1] + condition.at_s[0]) if len(condition.at_s) else 1.0
        for plot, name in ((raster, "Trial"), (rate, "Rate (Hz)")):
            plot.setLabel("left", name)
            reserve(plot, "left", LEFT_PX)
            plot.setXRange(0, end_s, padding=0)
            colour_axes(plot, self._theme)
        raster.setYRange(0, len(condition.trial_ids), padding=0)
        raster.getAxis("left").setTicks([trial_ticks(condition.trial_ids)])
        rate.setYRange(0, 1.05 * top_hz, padding=0)
        self._draw(raster, rate, condition)
        self.rasters.append(raster)
        self.rates.append(rate)

    def _draw(self, raster: Plot, rate: Plot, condition: NeuronResponse) -> None:
        pen = pg.mkPen(self._theme.groups[0], width=1)
        times = np.concatenate([*condition.spikes_s, np.empty(0)])
        trial = np.repeat(np.arange(len(condition.spikes_s)), list(map(len, condition.spikes_s)))
        x, y = np.repeat(times, 2), (trial[:, None] + np.array([0.1, 0.9])).ravel()
        raster.addItem(pg.PlotCurveItem(x, y, connect="pairs", pen=pen))
        dashes = pg.mkPen(self._theme.muted, width=1, dash=[4, 3])
        for sign in (-1, 1):
            band = np.maximum(condition.mean_hz + sign * condition.sd_hz, 0.0)
            rate.addItem(pg.PlotCurveItem(condition.at_s, band, pen=dashes))
        rate.addItem(pg.PlotCurveItem(condition.at_s, condition.mean_hz, pen=pen))


def trial_ticks(trial_ids: Sequence[int]) -> list[tuple[float, str]]:
    """Return places and numbers of at most four trials: each stands in the middle of its row."""
    step = max(1, -(-len(trial_ids) // MOST_TICKS))
    return [(index + 0.5, str(trial_ids[index])) for index in range(0, len(trial_ids), step)]


class ValueTable(NamedTuple):
    """What a page shows as numbers: names with units, and columns of equal length."""

    names: tuple[str, ...]
    columns: tuple[Any, ...]


class TrialPages(PageTabs):
    """All that was recorded of one trial, and what the encoder makes of it."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.readings, self.course = TrialView(theme), CourseView(theme)
        self.features, self.compare = FeaturesView(theme), CompareView(theme)
        self.quality = QualityView(theme)
        self.save_button = ExportButton()
        self.addTab(self.readings, "Readings")
        self.addTab(self.course, "Force and speed")
        self.addTab(self.features, "Features")
        self.addTab(self.compare, "Compare")
        self.addTab(self.quality, "Quality")
        self.setCornerWidget(self.save_button, Qt.Corner.TopRightCorner)
        self.save_button.setEnabled(False)

    @property
    def data(self) -> TrialData | None:
        """The trial that is shown."""
        return self.readings.data

    def show_trial(self, data: TrialData | None) -> None:
        """Show a trial, or a hint without one."""
        self.readings.show_trial(data)
        heading = data.heading if data is not None else ""
        n_samples = data.n_samples if data is not None and data.is_long else 0
        course, marks = (data.course, data.marks) if data else (None, ())
        self.course.show_course(course, heading, marks, n_samples)
        self.features.show_features(data.features if data else None, heading)
        self.compare.show_taxels(data.layout.n_taxels if data else 0)
        self.save_button.setEnabled(data is not None)
        if data is None or (self.quality.judged and self.quality.judged.path != data.place[0]):
            self.quality.show_judged(None)
        if self.quality.isVisible():
            self.quality.shown.emit()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme to every page."""
        for page in (self.readings, self.course, self.features, self.compare, self.quality):
            page.set_theme(theme)

    def file_stem(self) -> str:
        """Return the trial and the page as the beginning of a file's name."""
        origin = "-simulated" if self.is_simulated else ""
        if self.currentWidget() is self.compare:
            return f"{'laid-over' if self.compare.overlay else 'compare'}{origin}"
        if self.currentWidget() is self.quality:
            return f"quality{origin}"
        trial = self.data.title.partition(":")[0] if self.data else "trial"
        page = f"{trial} {self.tabText(self.currentIndex())}".lower().replace(" ", "-")
        return f"{page}{origin}"

    @property
    def is_simulated(self) -> bool:
        """Whether any of the data of the page in front is simulated."""
        if self.currentWidget() is self.compare and (self.compare.grid or self.compare.overlay):
            return self.compare.is_simulated
        return self.data is not None and self.data.simulated

    def picture(self) -> Picture:
        """Return the page in front above a line that names the trial and where it comes from."""
        page = self.currentWidget()
        assert page is not None
        is_one = self.data is not None and page not in (self.compare, self.quality)
        title = self.data.title if is_one and self.data else ""
        figure = self.features.graphics if page is self.features else page
        return with_foot(widget_picture(figure), foot_text(title, simulated=self.is_simulated))

    def recorded_values(self) -> tuple[str, int, bool] | None:
        """Return path and row of a long trial that is in front, and whether it is its force.

        Its numbers are written from the session; None where :meth:`values` has all.
        """
        page = self.currentWidget()
        if self.data is None or not self.data.is_long or page not in (self.readings, self.course):
            return None
        return *self.data.place, page is self.course

    def values(self) -> ValueTable:
        """Return the numbers of the page in front with their origin; without a trial none."""
        if self.data is None:
            return ValueTable((), ())
        names, columns = self._numbers(self.data)
        said = np.full(len(columns[0]), yes_or_no(self.is_simulated))
        return ValueTable((*names, SIMULATED), (*columns, said))

    def _numbers(self, data: TrialData) -> ValueTable:
        page = self.currentWidget()
        if page is self.course and data.course is not None:
            return ValueTable(COURSE_NAMES, course_columns(data.course))
        if page is self.features and data.features is not None:
            return _feature_values(data)
        if page is self.compare:
            return self.compare.values()
        if page is self.quality:
            return ValueTable(*self.quality.values())
        return _readings(data)


def _readings(data: TrialData) -> ValueTable:
    section = data.overview
    names = reading_names(data.layout.n_taxels)
    return ValueTable(names, reading_columns(section.first, section.low, section.spikes))


def _response_values(grid: ResponseGrid | None) -> ValueTable:
    """Return mean and deviation of the rate in the bins that all conditions fill."""
    conditions = grid.conditions if grid else ()
    n = min((len(one.at_s) for one in conditions), default=0)
    names, columns = ["time (s)"], [conditions[0].at_s[:n] if conditions else np.empty(0)]
    for one in conditions:
        names += [f"{one.name}: mean (Hz)", f"{one.name}: standard deviation (Hz)"]
        columns += [one.mean_hz[:n], one.sd_hz[:n]]
    return ValueTable(tuple(names), tuple(columns))


def _feature_values(data: TrialData) -> ValueTable:
    assert data.features is not None
    values = data.features.values
    n = len(values) // 2
    names = [f"SA {i + 1} (Hz)" for i in range(n)] + [f"RA {i + 1} (spikes)" for i in range(n)]
    return ValueTable(("window", *names), (np.arange(1, values.shape[1] + 1), *values))
