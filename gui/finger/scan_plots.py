"""The newest scan: velocity over time, spikes in scaled time, and the present readings."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QImage, QPainter, QTransform
from PySide6.QtWidgets import QGraphicsItem

from gui.live.raster import MEAN_SAMPLES, HeatMap
from gui.live.sample_history import SampleHistory
from gui.widgets.plot_axes import (
    BOTTOM_PX,
    LEFT_PX,
    PlotGrid,
    colour_axes,
    fixed_plot,
    most_ticks,
    reserve,
    time_ticks,
)
from gui.widgets.theme import Theme, blend, rgb, scaled_px
from rigctl.finger.board_messages import BATCH_SAMPLES, SampleFlag
from rigctl.finger.live_file import FingerLiveReader
from rigctl.finger.plan import ScanQuality
from rigctl.finger.status import CurrentScan
from rigctl.finger.values import N_FINGER_TAXELS, PredictionRow, VelocityProfile
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import SAMPLE_RATE_HZ, Verdict

BATCH_S = BATCH_SAMPLES / SAMPLE_RATE_HZ


UNASKED = CurrentScan(texture="")
"""Before anything is asked for."""


def scan_name(asked: CurrentScan) -> str:
    """Return the number of a scan in the planned order, and of an attempt that is not the first."""
    return f"{asked.trial_id}" + (f", attempt {asked.attempt}" if asked.attempt > 1 else "")


class AnswerState(StrEnum):
    """The verdict on the newest answer; only the answer to a whole scan is right or wrong."""

    NONE = "none"
    GROWING = "growing"
    RIGHT = "right"
    WRONG = "wrong"
    UNKNOWN = "unknown"


class ScanRecord:
    """Batches and answers of one scan after the other.

    ``scan`` is the board's number, which counts attempts; ``asked``: what the operator was asked to
    do in the scan, with its number in the planned order. ``first_sure``: the first answer that kept
    the error rate that was asked for. ``reasons``: why the scan does not count. ``version`` changes
    with every event.
    """

    def __init__(self) -> None:
        self.version = 0
        self.scan = -1
        self.asked = UNASKED
        self.prediction: PredictionRow | None = None
        self.first_sure: PredictionRow | None = None
        self.reasons: tuple[str, ...] = ()
        self._announced = UNASKED
        self._edges: list[tuple[float, float]] = []
        self._velocities_mm_s: list[float] = []

    def clear(self) -> None:
        """Forget the scan, as when another engine is connected."""
        self._begin(-1)
        self._announced = UNASKED

    def announce(self, asked: CurrentScan) -> None:
        """Take what the operator is asked for; it holds from the next scan on."""
        self._announced = asked

    def add_batch(self, data: Mapping[str, Any]) -> None:
        """Take the event ``batch``: the velocity, and the way and time scaled so far."""
        names = ("scaled_s", "distance_mm", "velocity_mm_s")
        scaled_s, distance_mm, velocity_mm_s = (float(data[name]) for name in names)
        self._follow(int(data["scan"]))
        if not self._edges:  # a window that joins in a scan knows nothing before this batch
            batch_s = min(BATCH_S, scaled_s)
            self._edges = [(scaled_s - batch_s, distance_mm - velocity_mm_s * batch_s)]
        if scaled_s > self._edges[-1][0]:
            self._edges.append((scaled_s, distance_mm))
            self._velocities_mm_s.append(velocity_mm_s)

    def add_prediction(self, data: Mapping[str, Any]) -> PredictionRow:
        """Take the event ``prediction`` and return its answer."""
        row = PredictionRow(**{name: data[name] for name in PredictionRow._fields})
        self._follow(row.scan)
        self.prediction = row
        if row.decided and self.first_sure is None:
            self.first_sure = row
        return row

    def add_trial(self, data: Mapping[str, Any]) -> None:
        """Take the event ``trial``: the scan is stored, and counts or does not."""
        self.version += 1
        is_good = data.get("verdict") == Verdict.COMMITTED
        self.reasons = () if is_good else tuple(map(str, data.get("reasons") or ("broken off",)))

    @property
    def state(self) -> AnswerState:
        """The verdict on the newest answer."""
        row = self.prediction
        if row is None:
            return AnswerState.NONE
        if not row.is_final:
            return AnswerState.GROWING
        if not row.known:
            return AnswerState.UNKNOWN
        return AnswerState.RIGHT if row.texture == self.asked.texture else AnswerState.WRONG

    @property
    def edges_s(self) -> NDArray[np.float64]:
        """Begin of the first known batch, and the end of each, s in the scan, (batches + 1,)."""
        return np.array([at_s for at_s, _ in self._edges] or [0.0])

    @property
    def edges_mm(self) -> NDArray[np.float64]:
        """The way at the times of :attr:`edges_s`, mm, (batches + 1,)."""
        return np.array([at_mm for _, at_mm in self._edges] or [0.0])

    @property
    def velocities_mm_s(self) -> NDArray[np.float64]:
        """The velocity of each batch, (batches,)."""
        return np.array(self._velocities_mm_s)

    def _follow(self, scan: int) -> None:
        self.version += 1
        if scan != self.scan:
            self._begin(scan)
            self.asked = self._announced

    def _begin(self, scan: int) -> None:
        self.version += 1
        self.scan = scan
        self.asked = UNASKED
        self.prediction = self.first_sure = None
        self.reasons = ()
        self._edges, self._velocities_mm_s = [], []


SPAN_MM = 210.0
"""The way between the marks, and what a velocity's error may add."""
WINDOW_MM = 10.0


def scan_samples(history: SampleHistory) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Return the samples of the newest scan: their numbers in it (n,), and their spikes (n, 9).

    Empty if the scan's first sample is no longer in the history.
    """
    oldest, end = history.flags.first, history.flags.end
    flags = history.flags.between(oldest, end)
    firsts = np.flatnonzero(flags & SampleFlag.FIRST)
    if not len(firsts):
        return np.zeros(0, np.int64), np.zeros((0, N_FINGER_TAXELS), np.uint8)
    first = int(firsts[-1])
    outside = np.flatnonzero((flags[first:] & SampleFlag.IN_SCAN) == 0)
    rows = oldest + first, oldest + first + int(outside[0]) if len(outside) else end
    counters = history.counters.between(*rows)
    return counters - counters[0], history.spikes.between(*rows)


class ScaledRaster(QGraphicsItem):
    """One row a taxel, T1 at the top; a tick is a pixel column with at least one spike.

    Its rectangle in plot units is ``0 … SPAN_MM`` by ``0 … 9``. Only samples of batches whose
    velocity is known have a place: the newest spikes appear at most a batch later.
    """

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.theme = theme
        self._pixels = np.zeros((1, 1), np.uint32)
        self._ratio = 1.0
        self._drawn: tuple[object, ...] = ()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme; the next refresh redraws everything."""
        self.theme = theme
        self._drawn = ()

    def refresh(
        self, history: SampleHistory, record: ScanRecord, width: int, height: int, ratio: float
    ) -> None:
        """Draw the scan for a view of ``width`` × ``height`` logical pixels, if it changed."""
        shape = (max(1, round(height * ratio)), max(1, round(width * ratio)))
        wanted = (shape, ratio, record.version)
        if wanted != self._drawn:
            self._drawn, self._ratio = wanted, ratio
            self._draw(shape, *_placed_spikes(history, record))
            self.update()

    @property
    def ticks(self) -> NDArray[np.bool_]:
        """Which pixel columns of each taxel have a spike, bool (9, columns)."""
        edges = _row_edges(len(self._pixels))
        middles = (edges[:-1] + edges[1:]) // 2
        is_ink: NDArray[np.bool_] = self._pixels[middles] == rgb(self.theme.groups[0])
        return is_ink

    def boundingRect(self) -> QRectF:
        """Return the rectangle in plot units."""
        return QRectF(0.0, 0.0, SPAN_MM, float(N_FINGER_TAXELS))

    def paint(self, painter: QPainter, *_: object) -> None:
        """Paint the pixels."""
        area = painter.worldTransform().mapRect(self.boundingRect())
        height, width = self._pixels.shape
        image = QImage(self._pixels.data, width, height, 4 * width, QImage.Format.Format_RGB32)
        image.setDevicePixelRatio(self._ratio)
        painter.save()
        painter.setWorldTransform(QTransform())
        painter.drawImage(round(area.left()), round(area.top()), image)
        painter.restore()

    def _draw(
        self, shape: tuple[int, int], taxel: NDArray[np.int64], at_mm: NDArray[np.float64]
    ) -> None:
        height, width = shape
        theme = self.theme
        pixels = np.full(shape, rgb(theme.plot), np.uint32)
        edges = _row_edges(height)
        for row in range(1, N_FINGER_TAXELS, 2):
            pixels[edges[row] : edges[row + 1]] = rgb(blend(theme.muted, theme.plot, 0.07))
        windows = np.arange(WINDOW_MM, SPAN_MM, WINDOW_MM)
        pixels[:, (windows / SPAN_MM * width).astype(np.int64)] = rgb(
            blend(theme.muted, theme.plot, 0.35)
        )
        column = (at_mm / SPAN_MM * width).astype(np.int64)
        is_visible = column < width
        for row in range(N_FINGER_TAXELS):
            ink = column[(taxel == row) & is_visible]
            pixels[edges[row] + 1 : edges[row + 1], ink] = rgb(theme.groups[0])
        self._pixels = pixels


def _row_edges(height: int) -> NDArray[np.int64]:
    return np.arange(N_FINGER_TAXELS + 1) * height // N_FINGER_TAXELS


def _placed_spikes(
    history: SampleHistory, record: ScanRecord
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return taxel (k,) and way in mm (k,) of each spike in the batches that are scaled."""
    numbers, spikes = scan_samples(history)
    edges = np.rint(record.edges_s * SAMPLE_RATE_HZ).astype(np.int64)
    # A scan has started whose first batch is not scaled: the record is of the scan before.
    is_of_record = len(numbers) > 0 and numbers[-1] + 1 >= edges[-1]
    begin, end = np.searchsorted(numbers, edges[[0, -1]]) if is_of_record else (0, 0)
    sample, taxel = np.nonzero(spikes[begin:end])
    return taxel, np.interp(numbers[begin + sample], edges, record.edges_mm)


HISTORY_S = 20
"""Longer than the slowest scan that counts."""
_RIGHT_PX = 132
ZONES_PX = 54
"""Room for the names of the speeds, right of the plot of the velocity."""
_TICK_MM = 100  # ticks that a narrow plot can show
_TICK_TAXELS = 4
_LEAST_PX = 128
"""Width and height of a plot whose texts can be read."""
_SLOW_REFRESH_FRAMES = 3
_LEAST_SPAN_S = 2.0
_LEAST_TOP_MM_S = 250.0
_ROW_STRETCH = (3, 4)


class ScanPlots(PlotGrid):
    """Plots of one scan; :meth:`refresh` pulls the samples that they show."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.history = SampleHistory(
            n_taxels=N_FINGER_TAXELS, n_rows=N_FINGER_TAXELS, capacity=HISTORY_S * SAMPLE_RATE_HZ
        )
        self._frame = -1
        self._version = -1
        self._quality = ScanQuality()
        self._build_velocity_plot()
        self._build_raster_plot(theme)
        self.heat_map = HeatMap(theme, SensorLayout.default(N_FINGER_TAXELS))
        self.cells.addItem(self.heat_map, row=0, col=1, rowspan=2)
        self.cells.layout.setHorizontalSpacing(10)
        for row, stretch in enumerate(_ROW_STRETCH):
            self.cells.layout.setRowStretchFactor(row, stretch)
        self.set_theme(theme)
        self._refresh_velocity(ScanRecord())

    def refresh(self, live: FingerLiveReader, record: ScanRecord) -> None:
        """Draw the new samples and batches."""
        self.history.pull(live)
        self._refresh_raster(record)
        if record.version != self._version:
            self._version = record.version
            self._refresh_velocity(record)
        self._frame += 1
        if self._frame % _SLOW_REFRESH_FRAMES == 0:
            low, high = (np.asarray(side, float) for side in live.normalisation)
            end = self.history.samples.end
            newest = self.history.samples.between(end - MEAN_SAMPLES, end)
            self.heat_map.refresh(newest, low, high)

    def clear_history(self) -> None:
        """Remove all samples, as when another engine is connected."""
        self.history.clear()
        self._frame = self._version = -1

    def set_quality(self, quality: ScanQuality) -> None:
        """Show the limits between slow, medium and fast of another protocol."""
        self._quality = quality
        self._place_limits()
        self._version = -1

    @property
    def quality(self) -> ScanQuality:
        """The limits that are shown."""
        return self._quality

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme to all plots."""
        self.colour(theme, self._velocity_plot, self._raster_plot)
        self.raster.set_theme(theme)
        self.heat_map.set_theme(theme)
        colour_axes(self._velocity_plot, theme, ("right",))
        self.cells.layout.setColumnFixedWidth(1, scaled_px(_RIGHT_PX))
        self.reserve_plots(_LEAST_PX, *(_LEAST_PX for _ in _ROW_STRETCH))
        self._velocity.setPen(pg.mkPen(theme.speed, width=2.4))
        for line in self._limits:
            line.setPen(pg.mkPen(theme.set_point, width=1.2, style=Qt.PenStyle.DashLine))
        self._version = -1

    @property
    def shown_velocities_mm_s(self) -> list[float]:
        """The heights of the steps that are drawn."""
        _, heights = self._velocity.getData()
        return list(map(float, heights)) if self._velocity.isVisible() else []

    @property
    def _limit_speeds(self) -> tuple[float, float]:
        return self._quality.slow_max_mm_s, self._quality.fast_min_mm_s

    def _build_velocity_plot(self) -> None:
        plot = self._velocity_plot = fixed_plot(self.cells, 0, 0)
        plot.setLabel("left", "mm/s")  # the line above names the velocity
        plot.setLabel("bottom", "Time (s)")
        reserve(plot, "left", LEFT_PX)
        reserve(plot, "bottom", BOTTOM_PX)
        self._velocity = pg.PlotCurveItem()
        self._limits = [pg.InfiniteLine(angle=0, movable=False) for _ in range(2)]
        plot.getAxis("right").setStyle(tickLength=0)
        reserve(plot, "right", ZONES_PX)
        for item in (*self._limits, self._velocity):
            plot.addItem(item)
        plot.getViewBox().sigResized.connect(lambda box: self._label_times(box.viewRange()[0][1]))
        self._place_limits()

    def _label_times(self, span_s: float) -> None:
        most = most_ticks(self._velocity_plot.getViewBox().width())
        ticks = time_ticks(0.0, span_s, most)
        self._velocity_plot.getAxis("bottom").setTicks([ticks, []])

    def _place_limits(self) -> None:
        for line, mm_s in zip(self._limits, self._limit_speeds, strict=True):
            line.setValue(mm_s)

    def _build_raster_plot(self, theme: Theme) -> None:
        plot = self._raster_plot = fixed_plot(self.cells, 1, 0)
        self.raster = ScaledRaster(theme)
        plot.setLabel("left", "Spikes")
        plot.setLabel("bottom", "Scaled time (mm)")
        reserve(plot, "left", LEFT_PX)
        reserve(plot, "bottom", BOTTOM_PX)
        plot.invertY(True)
        plot.setXRange(0, SPAN_MM, padding=0)
        plot.setYRange(0, N_FINGER_TAXELS, padding=0)
        names = [
            (taxel + 0.5, f"T{taxel + 1}") for taxel in range(0, N_FINGER_TAXELS, _TICK_TAXELS)
        ]
        plot.getAxis("left").setTicks([names, []])
        ways = [(float(mm), f"{mm}") for mm in range(0, round(SPAN_MM), _TICK_MM)]
        plot.getAxis("bottom").setTicks([ways, []])
        plot.addItem(self.raster)

    def _refresh_raster(self, record: ScanRecord) -> None:
        area = self._raster_plot.getViewBox().sceneBoundingRect()
        width = round(area.right()) - round(area.left())
        height = round(area.bottom()) - round(area.top())
        self.raster.refresh(self.history, record, width, height, self.devicePixelRatioF())

    def _refresh_velocity(self, record: ScanRecord) -> None:
        speeds = record.velocities_mm_s
        self._velocity.setVisible(len(speeds) > 0)
        if len(speeds):
            self._velocity.setData(record.edges_s, speeds, stepMode="center")
        span_s = max(_LEAST_SPAN_S, float(np.ceil(record.edges_s[-1])))
        top_mm_s = max(_LEAST_TOP_MM_S, 1.1 * float(speeds.max(initial=0.0)))
        self._velocity_plot.setXRange(0, span_s, padding=0)
        self._label_times(span_s)
        self._velocity_plot.setYRange(0, top_mm_s, padding=0)
        slow, fast = self._limit_speeds
        middles = (slow / 2, (slow + fast) / 2, (fast + top_mm_s) / 2)
        zones = list(zip(middles, ("slow", "medium", "fast"), strict=True))
        self._velocity_plot.getAxis("right").setTicks([zones, []])


def velocity_title(record: ScanRecord, quality: ScanQuality) -> str:
    """Return whose velocity is shown: scan and plate, the planned profile and what it asks for."""
    asked = record.asked
    profile = next((p for p in VelocityProfile if p.value == asked.profile), None)
    if profile is None:  # a window that joins in a scan does not know it
        return "Velocity"
    scan = f"Velocity in scan {scan_name(asked)}"
    return f"{scan} (plate {asked.texture}), planned: {profile} ({_demands(profile, quality)})"


def _demands(profile: VelocityProfile, quality: ScanQuality) -> str:
    ratio = f"at least {quality.change_ratio:g} × as fast as the"
    demands = {
        VelocityProfile.SLOW: f"below {quality.slow_max_mm_s:g} mm/s",
        VelocityProfile.MEDIUM: f"{quality.slow_max_mm_s:g} to {quality.fast_min_mm_s:g} mm/s",
        VelocityProfile.FAST: f"above {quality.fast_min_mm_s:g} mm/s",
        VelocityProfile.SLOW_TO_FAST: f"second half {ratio} first",
        VelocityProfile.FAST_TO_SLOW: f"first half {ratio} second",
    }
    return demands[profile]
