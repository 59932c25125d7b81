"""A recorded trial is shown by the layers of its own session's sensor."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

from gui.analysis.tasks.task_values import TrialData
from gui.analysis.trial_view import TrialView
from gui.widgets.theme import LIGHT
from rigctl.session.format.metadata.sensor_layout import SensorLayout


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
    view.show_trial(TrialData("trial 1", samples, every_row, every_row, layout))
    shown = view.spikes_plot.getAxis("left")._tickLevels[0]
    assert [name for _, name in shown] == groups
    assert view.samples_plot.viewRange()[1] == [-n, 0]
    assert view.spikes_plot.viewRange()[1] == [-2 * n, 0]
    assert len(view.samples_plot.getAxis("left")._tickLevels[0]) <= 10
    view.hide()
