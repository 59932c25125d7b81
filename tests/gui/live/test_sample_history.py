"""Minutes of samples: nothing is lost, whatever the level of detail."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

from gui.live.drum_course import thin_out
from gui.live.raster import Raster, ScrollingImage
from gui.live.sample_history import SampleHistory, TimeWindow
from gui.live.time_plots import Traces
from gui.widgets.theme import LIGHT
from rigctl.engine.live_file import Ring
from rigctl.session.sensor_layout import SensorLayout
from tests.gui.fake_engine import FakeEngine

PAPER = SensorLayout.default(18)
WIDTH, HEIGHT = 400, 180


def append(
    history: SampleHistory, first: int, samples: np.ndarray, at_s: float | None = None
) -> None:
    """Append samples with counters from ``first``, and a spike of SA-1 at each reading of 1000."""
    n = len(samples)
    counters = np.arange(first, first + n, dtype=np.int64)
    spikes = np.zeros((n, 36), np.uint8)
    spikes[:, 0] = samples[:, 0] == 1000
    time_s = counters / 1000 if at_s is None else at_s + np.arange(n) / 1000
    flags = np.zeros(n, np.uint8)
    history.append(time_s, counters, samples.astype(np.uint16), flags, spikes)


def show(image: ScrollingImage, history: SampleHistory, right: int, span: int) -> np.ndarray:
    """Draw a window; return its pixels from left to right."""
    image.refresh(history, TimeWindow(right, span, right), WIDTH, HEIGHT, 1.0)
    return np.roll(image._pixels, -(image._head + 1), axis=1)


def test_a_ring_keeps_the_newest_rows_in_order() -> None:
    ring, written = Ring(1000, np.dtype(np.int64)), 0
    for n in (1, 700, 999, 1000, 2500, 3):
        ring.append(np.arange(written, written + n))
        written += n
        kept = ring.between(ring.first, ring.end)
        assert kept.tolist() == list(range(max(0, written - 1000), written))
        assert ring.count_below(np.array([written - 2])).tolist() == [max(written - 2, 0)]


def test_columns_cover_every_sample_once() -> None:
    history = SampleHistory(18, 36, 20_000)
    append(history, 12_345, np.zeros((10_000, 18)))
    columns = history.columns(12_345 * 777 // 10_000, 22_344 * 777 // 10_000, 777, 10_000)
    assert columns.start[0] == 0 and columns.start[-1] == 10_000
    assert np.all(np.diff(columns.start)[1:-1] >= 12)
    assert not columns.missing.any() and not columns.blank.any()


def test_columns_of_lost_samples_are_marked() -> None:
    history = SampleHistory(18, 36, 20_000)
    append(history, 0, np.zeros((1000, 18)))
    append(history, 1400, np.zeros((600, 18)))
    columns = history.columns(0, 250, 500, 5000)
    assert np.array_equal(np.flatnonzero(columns.missing), np.arange(100, 140))
    assert np.array_equal(np.flatnonzero(columns.blank), np.arange(200, 251))


@pytest.mark.parametrize("span", [1000, 10_000, 60_000, 300_000])
def test_one_sample_of_a_spike_is_visible_over_any_span(qapp: QApplication, span: int) -> None:
    history = SampleHistory(18, 36, 320_000)
    samples = np.full((310_000, 18), 100)
    samples[309_500, 0] = 1000
    for part in np.array_split(samples, 97):
        append(history, history.counters.end, part)
    traces = show(Traces(LIGHT, PAPER), history, 309_999, span)
    background = traces[:, :1]
    assert (traces != background).any(axis=0).sum() in (1, 2, 3)
    raster = show(Raster(LIGHT, PAPER), history, 309_999, span)
    lit = np.flatnonzero((raster != raster[:, :1]).any(axis=0))
    assert len(lit) >= 1
    assert abs(lit.mean() - (WIDTH - 1 - 499 * WIDTH / span)) <= 1 + 2 * WIDTH / span


def test_the_oldest_samples_make_room_and_memory_stays(qapp: QApplication) -> None:
    history = SampleHistory(18, 36, 50_000)
    for step in range(30):
        append(history, 7000 * step, np.full((7000, 18), step))
    assert len(history) == 50_000 and history.oldest == 160_000
    show(Traces(LIGHT, PAPER), history, 209_999, 50_000)
    low, high = history.extremes(history.columns(330, 419, 100, 50_000))
    assert (low[:, 0] >= 22).all() and (high[-1] == 29).all()


def test_scrolling_to_and_fro_gives_the_same_picture(
    qapp: QApplication, engine: FakeEngine
) -> None:
    history, moved = SampleHistory(18, 36, 60_000), Traces(LIGHT, PAPER)
    for skip in (0, 300, 0):
        engine.write_samples(16_000, skip=skip)
        history.pull(engine.live)
    for right in (48_000, 30_000, 29_990, 24_000, 33_000, 47_000, 11_000, 40_123):
        picture = show(moved, history, right, 10_000)
        assert np.array_equal(picture, show(Traces(LIGHT, PAPER), history, right, 10_000))
    engine.close()


def test_a_restarted_board_goes_on_behind_a_gap() -> None:
    history = SampleHistory(18, 36, 20_000)
    append(history, 5000, np.ones((100, 18)), at_s=50.0)
    append(history, 0, np.full((30, 18), 9), at_s=50.6)
    positions = history.counters.between(0, 130)
    assert positions[99] == 5099 and positions[100] == pytest.approx(5600, abs=2)
    assert np.all(np.diff(positions) > 0) and history.newest == positions[-1]


def test_a_thinned_course_keeps_its_extremes() -> None:
    values = np.zeros(50_000)
    values[31_234], values[77] = 9.0, -4.0
    time_s, thin = thin_out(np.arange(50_000) / 80, values)
    assert len(thin) <= 1510 and len(time_s) == len(thin)
    assert thin.max() == 9.0 and thin.min() == -4.0
