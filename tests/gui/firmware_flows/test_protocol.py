"""A protocol on the firmware, from Start to the figure of its trials."""

from __future__ import annotations

from pathlib import Path

from rigctl.session.verify import verify
from tests.gui.rig_window import RigWindow
from tests.gui.running_engine import ridges
from tests.gui.steps import click

TWO_TRIALS = ridges("two-trials", 2) + "[trial]\ntravel_mm = 60\n"


def test_two_trials_are_recorded_verified_and_looked_at(rig: RigWindow, tmp_path: Path) -> None:
    window, protocol = rig.window, tmp_path / "two.toml"
    protocol.write_text(TWO_TRIALS)
    rig.start(protocol, tmp_path)
    rig.until(lambda: rig.status.run.state == "done")
    folder = Path(rig.status.run.session)
    assert verify(folder).problems == []
    strip, tab = window.run_end_strip, window.analysis_tab
    rig.until(strip.isVisible)
    assert folder.name in strip.text.text()
    click(strip.analyse_button)
    rig.until(lambda: tab.trial_view.data is not None and not tab.reader.is_busy)
    assert tab.panel.model.rowCount() == 2
    assert "2 of 2 trials committed" in tab.panel.about.text()
    tab.panel.run_box.method.setCurrentIndex(0)
    click(tab.panel.run_box.run_button)
    rig.until(lambda: not tab.worker.is_busy)
    rig.until(lambda: bool(tab.panel.run_box.result.text()))
    assert "trial" in tab.panel.run_box.result.text()
