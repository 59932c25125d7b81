"""The pages of one recorded trial: readings and spikes, force and speed, features."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from PySide6.QtCore import Qt

from gui.analysis.compare.compare_view import CompareView
from gui.analysis.compare.responses import ResponseGrid
from gui.analysis.export.export_button import ExportButton
from gui.analysis.export.picture_file import Picture, widget_picture, with_foot
from gui.analysis.export.picture_foot import foot_text
from gui.analysis.export.value_file import SIMULATED, yes_or_no
from gui.analysis.tasks.task_values import TrialData
from gui.analysis.trial_view import TrialView
from gui.analysis.trials.course_view import CourseView
from gui.analysis.trials.features_view import FeaturesView
from gui.widgets.layouts import PageTabs
from gui.widgets.theme import Theme
from rigctl.values import SAMPLE_RATE_HZ


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
        self.save_button = ExportButton()
        self.addTab(self.readings, "Readings and spikes")
        self.addTab(self.course, "Force and speed")
        self.addTab(self.features, "Features")
        self.addTab(self.compare, "Compare")
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
        self.course.show_course(data.course if data else None, heading)
        self.features.show_features(data.features if data else None, heading)
        self.compare.show_taxels(data.layout.n_taxels if data else 0)
        self.save_button.setEnabled(data is not None)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme to every page."""
        for page in (self.readings, self.course, self.features, self.compare):
            page.set_theme(theme)

    def file_stem(self) -> str:
        """Return the trial and the page as the beginning of a file's name."""
        origin = "-simulated" if self.is_simulated else ""
        if self.currentWidget() is self.compare:
            return f"compare{origin}"
        trial = self.data.title.partition(":")[0] if self.data else "trial"
        page = f"{trial} {self.tabText(self.currentIndex())}".lower().replace(" ", "-")
        return f"{page}{origin}"

    @property
    def is_simulated(self) -> bool:
        """Whether any of the data of the page in front is simulated."""
        grid = self.compare.grid
        if self.currentWidget() is self.compare and grid is not None:
            return grid.simulated
        return self.data is not None and self.data.simulated

    def picture(self) -> Picture:
        """Return the page in front above a line that names the trial and where it comes from."""
        page = self.currentWidget()
        assert page is not None
        is_one = self.data is not None and page is not self.compare
        title = self.data.title if is_one and self.data else ""
        figure = self.features.graphics if page is self.features else page
        return with_foot(widget_picture(figure), foot_text(title, simulated=self.is_simulated))

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
            return _course_values(data)
        if page is self.features and data.features is not None:
            return _feature_values(data)
        if page is self.compare:
            return _response_values(self.compare.grid)
        return _readings(data)


def _readings(data: TrialData) -> ValueTable:
    n_samples, n = data.samples.shape
    taxels = tuple(f"T{taxel + 1} (counts)" for taxel in range(n))
    trains = [f"{kind} {taxel + 1} (spikes)" for kind in ("SA", "RA") for taxel in range(n)]
    counts = data.spike_counts
    time_s = np.arange(n_samples) / SAMPLE_RATE_HZ
    return ValueTable(("time (s)", *taxels, *trains), (time_s, *data.samples.T, *counts.T))


def _course_values(data: TrialData) -> ValueTable:
    """Return the load cell's readings, and the drum's speed at the same times."""
    assert data.course is not None
    course = data.course
    speed = np.full(len(course.force_s), np.nan)
    if len(course.speed_s):
        speed = np.interp(course.force_s, course.speed_s, course.speed_mm_s)
    names = ("time (s)", "force (g)", "speed (mm/s)")
    return ValueTable(names, (course.force_s, course.force_g, speed))


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
