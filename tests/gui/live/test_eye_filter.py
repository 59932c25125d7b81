"""Gain and filters change the traces for the eye, and nothing that is kept."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QApplication
from scipy.signal import butter, sosfilt, sosfilt_zi

from gui.live.eye_filter import EyeFilter
from gui.live.live_page import VIEW, LivePage
from gui.live.sample_history import SampleHistory
from gui.widgets.theme import LIGHT
from tests.gui.fake_engine import FakeEngine
from tests.gui.steps import click, wait_until

N = 4000


def touch() -> NDArray[np.uint16]:
    time_s = np.arange(N)[:, None] / 1000
    waves = 500 + 100 * np.sin(2 * np.pi * 2 * time_s) + 40 * np.sin(2 * np.pi * 80 * time_s)
    return np.repeat(np.rint(waves), 2, axis=1).astype(np.uint16)


def append(history: SampleHistory, first: int, samples: NDArray[np.uint16]) -> None:
    at = np.arange(first, first + len(samples))
    none = np.zeros(len(at), np.uint8)
    history.append(at / 1000, at, samples, none, np.zeros((len(at), 4), np.uint8))


def test_blocks_are_filtered_as_the_whole_and_a_gap_begins_anew() -> None:
    samples, history, eye = touch(), SampleHistory(2, 4, 10_000), EyeFilter(20.0, 200.0)
    for first in range(0, 3000, 37):
        append(history, first, samples[first : min(first + 37, 3000)])
        eye.follow(history)
    sos = np.concatenate(
        [butter(2, hz, kind, fs=1000, output="sos") for hz, kind in ((20, "high"), (200, "low"))]
    )
    rest = sosfilt_zi(sos)[:, :, None] * samples[0].astype(float)
    whole, _ = sosfilt(sos, samples[:3000].astype(float), axis=0, zi=rest)
    shown = eye.decode(eye.history.samples.between(0, 3000))
    assert np.abs(shown - whole).max() <= 0.5 / eye.scale + 1e-9
    assert np.abs(shown[500:]).max() < 60 and np.abs(shown[500:]).max() > 30  # 80 Hz, not 2 Hz
    append(history, 5000, samples[:500])
    eye.follow(history)
    assert np.allclose(eye.decode(eye.history.samples.between(3000, 3500)), shown[:500], atol=0.1)
    assert eye.history.newest == 5499 and eye.words == "20–200 Hz, for the eye alone"


@pytest.fixture
def page(qapp: QApplication, engine: FakeEngine) -> Iterator[LivePage]:
    """Yield a page with samples."""
    page = LivePage(LIGHT)
    page.resize(900, 700)
    page.show()
    engine.write_samples(N)
    page.refresh(engine.live)
    yield page
    page.close_files()
    page.close()


def test_the_plot_says_that_it_is_filtered_and_what_is_kept_stays(
    page: LivePage, engine: FakeEngine
) -> None:
    plots, traces = page.plots, page.plots.time_plots.traces
    before = plots.data.samples_before(N - 1, N).copy()
    click(page.bar.buttons[VIEW])
    page.eye_strip.high_pass.setCurrentText("5 Hz")
    wait_until(lambda: traces.eye is not None)
    engine.write_samples(500)
    page.refresh(engine.live)
    assert traces.eye is not None and traces.eye.history.newest == N + 499
    words = plots.time_plots._eye_words
    assert words.isVisible() and words.toPlainText() == "above 5 Hz, for the eye alone"
    assert np.array_equal(plots.data.samples_before(N - 1, N), before)
    low, high = traces.range_of(0)
    assert low == -high
    page.eye_strip.high_pass.setCurrentText("off")
    assert traces.eye is None and not words.isVisible()


def test_gain_and_the_wheel_with_ctrl_draw_the_traces_higher(page: LivePage) -> None:
    traces = page.plots.time_plots.traces
    low, high = traces.range_of(0)
    page.eye_strip.gain.setValue(4.0)
    assert traces.range_of(0)[1] - traces.range_of(0)[0] == pytest.approx((high - low) / 4)
    control, none = Qt.KeyboardModifier.ControlModifier, Qt.MouseButton.NoButton
    at, turn = QPointF(300, 300), QPoint(0, 120)
    phase = Qt.ScrollPhase.NoScrollPhase
    span = page.plots.navigation.window.span
    wheel = QWheelEvent(at, at, QPoint(), turn, none, control, phase, False)
    QApplication.sendEvent(page.plots.graphics.viewport(), wheel)
    assert page.eye_strip.gain.value() == pytest.approx(5.0)
    assert page.plots.navigation.window.span == span
