"""A recorded trial is shown by the layers of its own session's sensor."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

from gui.analysis.task_values import TrialCourse
from gui.analysis.trial_pages import CourseView
from gui.analysis.trial_sections import fold_blocks
from gui.analysis.trial_view import TrialView
from gui.widgets.theme import LIGHT
from rigctl.session.sensor_layout import SensorLayout
from tests.gui.made_trials import made_trial


@pytest.mark.parametrize(
    ("layout", "groups"),
    [
        (SensorLayout.default(9), ["SA", "RA"]),
        (SensorLayout.default(18), ["SAI", "RAI", "SAII", "RAII"]),
        (SensorLayout(1, 20, ("skin", "core")), ["SA skin", "RA skin", "SA core", "RA core"]),
    ],
)
def test_groups_are_those_of_the_sensor(
    qapp: QApplication, layout: SensorLayout, groups: list[str]
) -> None:
    n = layout.n_taxels
    samples = np.arange(100 * n, dtype=np.uint16).reshape(100, n)
    every_row = np.arange(2 * n)
    view = TrialView(LIGHT)
    view.show_trial(made_trial(samples, every_row, every_row, layout))
    shown = view.spikes_plot.getAxis("left")._tickLevels[0]
    assert [name for _, name in shown] == groups
    assert view.samples_plot.viewRange()[1] == [-n, 0]
    assert view.spikes_plot.viewRange()[1] == [-2 * n, 0]
    assert len(view.samples_plot.getAxis("left")._tickLevels[0]) <= 10
    view.hide()


def test_a_long_trial_is_drawn_by_its_extremes_and_a_part_of_it_sample_by_sample(
    qapp: QApplication,
) -> None:
    """A path through ten minutes of samples took seconds at each painting, and STOP waited."""
    n, layout = 600_000, SensorLayout.default(18)
    samples = np.full((n, 18), 500, np.uint16)
    samples[123_456] = 1000  # a single reading that no view may lose
    samples[400_000:400_010, 3] = np.arange(10)
    row, at = np.repeat(np.arange(36), 20_000), np.tile(np.arange(0, n, 30), 36)
    spikes = np.zeros((n, 36), np.uint8)
    spikes[at, row] = 1
    view = TrialView(LIGHT)
    view.resize(900, 600)
    view.show()
    view.section_requested.connect(
        lambda first, end, _: view.show_section(
            fold_blocks([(samples[first:end], spikes[first:end])], 18, 1, first)
        )
    )
    view.show_trial(made_trial(samples, row, at, layout))
    drawn = [len(item.getData()[0]) for plot in plots_of(view) for item in plot.items]
    assert sum(drawn) < 300_000
    x, y = view.samples_plot.items[0].getData()
    pixel_s = n / 1000 / view.samples_plot.getViewBox().width()
    assert 0 <= 123.456 - x[np.argmax(y)] < pixel_s and np.ptp(y[: len(y) // 9]) > 0.8
    view.samples_plot.setXRange(399.9, 400.2, padding=0)
    x, y = view.samples_plot.items[0].getData()
    steps = np.flatnonzero((x >= 400) & (x < 400.0095))
    assert len(x) < 9 * 400 and np.all(np.diff(y[steps][-10:]) >= 0)
    x, _ = view.spikes_plot.items[0].getData()
    assert set(np.round(np.diff(np.unique(x)), 3)) == {0.03}
    view.close()


def test_force_and_speed_of_an_hour_are_drawn_by_their_extremes_and_a_part_point_by_point(
    qapp: QApplication,
) -> None:
    at_s = np.arange(288_000) / 80
    force_g, speed_mm_s = np.full(len(at_s), 250.0), np.full(len(at_s), 40.0)
    force_g[123_456] = 900.0  # a single reading that no view may lose
    force_g[200_000:200_010] = np.nan
    view = CourseView(LIGHT)
    view.show_course(TrialCourse(at_s, force_g, at_s, speed_mm_s, 250.0, 40.0), "Trial 1")
    x, y = view.force_plot.items[0].getData()
    assert len(x) < 2000 and abs(x[np.nanargmax(y)] - at_s[123_456]) < 5
    assert np.isnan(y[np.searchsorted(x, at_s[200_000]) - 1])
    view.force_plot.setXRange(at_s[1000], at_s[1100], padding=0)
    for plot, values in ((view.force_plot, force_g), (view.speed_plot, speed_mm_s)):
        x, y = plot.items[0].getData()
        assert np.array_equal(x, at_s[1000:1101]) and np.array_equal(y, values[1000:1101])
    view.force_plot.setXRange(at_s[500] + 0.001, at_s[500] + 0.002, padding=0)
    assert view.force_plot.items[0].getData()[0].tolist() == at_s[500:502].tolist()
    view.show_course(None)
    view.close()


def plots_of(view: TrialView) -> tuple[Any, Any]:
    return view.samples_plot, view.spikes_plot
