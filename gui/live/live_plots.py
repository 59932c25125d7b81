"""The live plots: force, speed, traces and raster over one time axis; heat map and rates."""

from __future__ import annotations

from typing import Any, Protocol

from PySide6.QtCore import QElapsedTimer, QPointF, QRectF, QTimer, Signal
from PySide6.QtGui import QResizeEvent

from gui.live.earlier_trials import EarlierTrials, TrialSpan
from gui.live.eye_filter import EyeFilter
from gui.live.live_data import LiveData, ValueScale
from gui.live.navigation import Cursors, Navigation
from gui.live.raster import FULL_SCALE_HZ, HeatMap, RateBars, label_rates
from gui.live.time_plots import NOW, PAUSED, SINCE_START, SetPointPlot, TimePlots
from gui.widgets.data_ages import DataAges, StaleCovers
from gui.widgets.plot_axes import BOTTOM_PX, PlotGrid, fixed_plot, reserve
from gui.widgets.theme import Theme, scaled_px, text_scale
from rigctl.engine.live_file import LiveReader
from rigctl.session.sensor_layout import PAPER_SENSOR, SensorLayout

_RIGHT_PX, _MORE_FOR_TEXTS_PX = 216, 130
"""Width of the right column, and what texts twice as large add to it."""
_GAP_PX = 26
"""Between the columns: half a number of the time axis, and half of one of the rates, meet there."""
_SLOW_REFRESH_MS = 100  # numbers that change thirty times a second are unreadable
LEAST_GAIN, MOST_GAIN = 0.25, 100.0
RESIZED_MS = 10
"""Qt serves a timer without an interval in the turn that paints the window in its new size."""


def gap_px() -> int:
    """Return the room between the plots over time and the right column."""
    return scaled_px(_GAP_PX)


def right_column_px() -> int:
    """Return the width of the heat maps and rates beside the plots over time."""
    return _RIGHT_PX + round((text_scale() - 1) * _MORE_FOR_TEXTS_PX)


class LiveView(Protocol):
    """A view of the present beside the plots over time."""

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme and the size of the texts."""

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Show another sensor."""

    def refresh_at(self, data: LiveData, position: int) -> None:
        """Show the data up to a position; called ten times a second."""


class LivePlots(PlotGrid):
    """All plots of :class:`gui.live.live_data.LiveData`; :meth:`refresh` pulls what they show."""

    lines_changed = Signal()
    """The cursors have moved."""
    gain_changed = Signal(float)
    """How many times as high the traces are drawn."""

    def __init__(self, theme: Theme, sensor: SensorLayout = PAPER_SENSOR) -> None:
        super().__init__()
        self.sensor_layout = sensor
        self.data = LiveData(self.sensor_layout.n_taxels)
        self.navigation = Navigation()
        self.cursors = Cursors()
        self.value_scale = ValueScale()
        self.caption_paused = PAUSED
        self._since_numbers = QElapsedTimer()
        self._theme = theme
        self._resized = QTimer(self, interval=RESIZED_MS, singleShot=True)
        self._resized.timeout.connect(self._draw_resized)
        self.views: list[LiveView] = []
        self.time_plots = TimePlots(self.cells, theme, self.sensor_layout)
        self._earlier_trials = EarlierTrials(self.time_plots, theme)
        self._earlier: tuple[list[TrialSpan], int] = ([], 0)
        self._build_right_column(theme)
        boxes = [plot.getViewBox() for plot in self.time_plots.plots]
        self.stale_covers = StaleCovers(*boxes, self.heat_map, self._rate_plot.getViewBox())
        self.set_theme(theme)
        self.navigation.changed.connect(self.draw)

    def refresh(self, live: LiveReader) -> None:
        """Take the new samples; draw them unless the user looks back."""
        self.pull(live)
        self.draw_new()

    def pull(self, live: LiveReader) -> None:
        """Take the new samples; those of another sensor wait for the status that describes it."""
        if live.n_taxels == self.sensor_layout.n_taxels:
            self.data.pull(live)
        self._follow()

    def draw_new(self) -> None:
        """Draw what is new, unless the user looks back."""
        if not self.navigation.is_paused:
            self.draw()

    def show_ages(self, ages: DataAges) -> None:
        """Cover what is no longer live; what the user looks back at stays as it was."""
        self.stale_covers.show_ages(DataAges() if self.navigation.is_paused else ages)

    def draw(self) -> None:
        """Draw what the time window shows."""
        self._follow()
        data, window = self.data, self.navigation.window
        if (eye := self.time_plots.traces.eye) is not None:
            eye.follow(data.history)
        self.time_plots.set_range(data.low, data.high)
        self.time_plots.refresh(data.history, data.drum, window, self.devicePixelRatioF())
        self._show_lines()
        self._show_earlier()
        is_due = not self._since_numbers.isValid() or self._since_numbers.hasExpired(
            _SLOW_REFRESH_MS
        )
        if is_due or self.navigation.is_paused:
            self._since_numbers.start()
            self._refresh_right_column(min(window.right, self.navigation.newest))

    def show_earlier(self, trials: list[TrialSpan], taxel: int) -> None:
        """Put trials behind the one that begins at the left, with the readings of a taxel."""
        self._earlier = (trials, taxel)

    def draw_lines(self) -> None:
        """Draw events and cursors only."""
        self._show_lines()
        self.lines_changed.emit()

    @property
    def span(self) -> int:
        """Samples in the width of the plots."""
        return self.navigation.window.span

    @property
    def width_px(self) -> float:
        """Width of the time axis."""
        return self._area(0).width()

    def share_at(self, at: QPointF) -> float | None:
        """Return the place of a point of the widget in the time axis, 0–1, None outside."""
        area = self._area(0)
        share = (at.x() - area.left()) / max(area.width(), 1.0)
        return share if 0.0 <= share <= 1.0 else None

    def taxel_at(self, at: QPointF) -> int | None:
        """Return the taxel, from 0, whose band is at a point of the widget."""
        area, taxels = self._area(2), self.time_plots.taxels
        if not area.contains(at):
            return None
        row = int((at.y() - area.top()) / area.height() * len(taxels))
        return taxels[min(row, len(taxels) - 1)]

    def course_at(self, at: QPointF) -> tuple[SetPointPlot, float] | None:
        """Return force or speed where they, or their axis, are at a point of the widget.

        The second is the point's share of the height, 0 at the bottom.
        """
        for number, course in enumerate(self.time_plots.courses):
            area = self._area(number)
            if area.top() <= at.y() <= area.bottom() and at.x() <= area.right():
                return course, (area.bottom() - at.y()) / area.height()
        return None

    def show_whole_courses(self) -> None:
        """Show the whole axes of force and speed."""
        for course in self.time_plots.courses:
            course.show_part(None)

    def set_span(self, span_s: float) -> None:
        """Show so many seconds."""
        self.navigation.set_span(span_s)

    def clear_history(self) -> None:
        """Remove all samples, as when another rig is connected."""
        self.data.clear()
        self.navigation.resume()
        self.navigation.align_to(None)
        self.show_earlier([], 0)
        self.cursors.clear()
        self._since_numbers.invalidate()

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Group taxels and trains by the layers of the sensor; of another number begin anew."""
        if layout.n_taxels != self.sensor_layout.n_taxels:
            self.clear_history()
            self.data.set_sensor(layout.n_taxels)
        if layout != self.sensor_layout:
            self._set_layout(layout)

    def _set_layout(self, layout: SensorLayout) -> None:
        self.sensor_layout = layout
        self.time_plots.set_sensor_layout(layout)
        for view in self.views:
            view.set_sensor_layout(layout)
        self._show_rate_rows()

    def show_data(self, data: LiveData, layout: SensorLayout) -> None:
        """Show other data, of a sensor with any number of taxels."""
        self.data = data
        if layout != self.sensor_layout:
            self._set_layout(layout)

    def toggle_alone(self, taxel: int) -> None:
        """Show one taxel alone, or all again."""
        every = tuple(range(self.sensor_layout.n_taxels))
        self.show_taxels(every if self.time_plots.taxels == (taxel,) else (taxel,))

    def show_taxels(self, taxels: tuple[int, ...]) -> None:
        """Show only these taxels, from 0, in traces, raster and rates."""
        self.time_plots.show_taxels(taxels)
        self._show_rate_rows()
        self.draw()

    def set_value_scale(self, scale: ValueScale) -> None:
        """Show readings in counts or volts."""
        if scale != self.value_scale:
            self.value_scale = scale
            self.time_plots.set_value_scale(scale)
            self.heat_map.set_value_scale(scale)

    def set_gain(self, gain: float) -> None:
        """Draw the traces ``gain`` times as high."""
        gain = min(max(gain, LEAST_GAIN), MOST_GAIN)
        self.time_plots.set_view(gain, self.time_plots.traces.eye)
        self.gain_changed.emit(gain)
        self.draw()

    def set_eye_filter(self, eye: EyeFilter | None) -> None:
        """Draw the traces filtered."""
        self.time_plots.set_view(self.time_plots.traces.gain, eye)
        self.draw()

    def set_rates_per_mm(self, is_per_mm: bool) -> None:
        """Show spikes per mm of texture that passed, or per second."""
        self.rate_bars.is_per_mm = is_per_mm
        label_rates(self._rate_plot, self._theme, is_per_mm)
        self._since_numbers.invalidate()
        self.draw()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme to all plots."""
        self._theme = theme
        self.colour(theme, self._rate_plot)
        self.time_plots.set_theme(theme)
        for view in self.views:
            view.set_theme(theme)
        self._earlier_trials.set_theme(theme)
        self.cells.layout.setColumnFixedWidth(1, right_column_px())
        self.cells.layout.setHorizontalSpacing(gap_px())
        self.keep_readable()
        self.draw()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Draw and paint in the new size, in a turn of its own: the window itself takes one."""
        super().resizeEvent(event)
        if hasattr(self, "_rate_plot"):
            self.graphics.setUpdatesEnabled(not self.isVisible())
            self._resized.start()

    def _draw_resized(self) -> None:
        self.draw()
        self.graphics.setUpdatesEnabled(True)

    def _build_right_column(self, theme: Theme) -> None:
        self.heat_map = HeatMap(theme, self.sensor_layout)
        self.rate_bars = RateBars(theme, self.sensor_layout)
        self.add_view(self.heat_map, row=0, rowspan=3)
        self._rate_plot = fixed_plot(self.cells, 3, 1)
        reserve(self._rate_plot, "bottom", BOTTOM_PX)
        label_rates(self._rate_plot, theme, self.rate_bars.is_per_mm)
        self._rate_plot.getAxis("left").hide()
        self._rate_plot.setXRange(0, FULL_SCALE_HZ, padding=0)
        self._rate_plot.invertY(True)
        self._rate_plot.addItem(self.rate_bars)
        self.views.append(self.rate_bars)
        self._show_rate_rows()

    def add_view(self, view: Any, row: int, rowspan: int = 1) -> None:
        """Put a :class:`LiveView` that is a ``QGraphicsWidget`` into the right column."""
        self.cells.addItem(view, row=row, col=1, rowspan=rowspan)
        self.views.append(view)

    def _show_rate_rows(self) -> None:
        self.rate_bars.show_rows(self.time_plots.raster.rows)
        self._rate_plot.setYRange(0, len(self.rate_bars.rows), padding=0)

    def _refresh_right_column(self, position: int) -> None:
        for view in self.views:
            view.refresh_at(self.data, position)

    def _area(self, plot: int) -> QRectF:
        """Return the inside of a plot in pixels of the widget."""
        view = self.time_plots.plots[plot].getViewBox()
        return QRectF(self.graphics.mapFromScene(view.sceneBoundingRect()).boundingRect())

    def _show_lines(self) -> None:
        window = self.navigation.window
        self.time_plots.show_lines(self.data.marks.lines(window), *self.cursors.lines(window))

    def _show_earlier(self) -> None:
        trials, taxel = self._earlier
        if trials and self.navigation.is_aligned:
            self._earlier_trials.show(self.data, self.navigation.window, trials, taxel)
        else:
            self._earlier_trials.clear()

    def _follow(self) -> None:
        history, drum, navigation = self.data.history, self.data.drum, self.navigation
        navigation.follow(history.oldest, history.newest, drum.newest)
        still = self.caption_paused if navigation.is_paused else NOW
        self.time_plots.set_caption(SINCE_START if navigation.is_aligned else still)
