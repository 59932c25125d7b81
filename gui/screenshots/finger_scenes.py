"""The moving finger: before a run, and while scans are named."""

from __future__ import annotations

from collections.abc import Iterator

from gui.finger.scan_record import AnswerState
from gui.screenshots.camera import THEMES
from gui.screenshots.recordings import FINGER_SEED
from gui.screenshots.scene import SAVE_IN, Scene, Studio
from gui.shell.main_window import MainWindow

MIN_NAMED, MIN_WINDOWS = 3, 9


def finger_scenes(studio: Studio) -> Iterator[Scene]:
    """Show the idle tab, then an answer that grows or is right.

    Each theme has a run of its own: a change of the theme delays its answers.
    """
    window, setup = studio.window, studio.window.finger_tab.setup
    window.show_panel("finger")
    setup.out.setText(SAVE_IN)
    yield Scene("finger-idle")
    studio.camera.wait(lambda: studio.recordings.has_model)
    setup.choose_stage("run")
    setup.seed.setValue(int(FINGER_SEED))
    setup.unasked.setChecked(True)
    for choice in THEMES:
        window.set_theme(choice)
        _run_finger(studio)
        window.analysis_tab.run_end_strip.hide()
        yield Scene("finger", lambda: _grows(window), choice)


def _run_finger(studio: Studio) -> None:
    """Run the real-time stage on a new engine until some scans are named."""
    tab, wait = studio.window.finger_tab, studio.camera.wait
    if tab.link.is_connected:
        tab.link.request("abort")
        wait(lambda: tab.link.status.run.has_ended)
        tab.link.close()
    tab.setup.model.setText(str(studio.recordings.model))
    tab.setup.out.setText(str(studio.work))
    wait(tab.run_box.buttons["Start"].isEnabled)
    tab.run_box.buttons["Start"].click()
    wait(lambda: tab.link.status.run.is_active)
    tab.setup.out.setText(SAVE_IN)
    tab.setup.model.setText(f"{SAVE_IN}/{studio.recordings.model.name}")
    wait(lambda: tab.link.status.run.classified >= MIN_NAMED)


def _grows(window: MainWindow) -> bool:
    """Return whether the answer is right, or grows and has seen most of the plate."""
    record = window.finger_tab.view.record
    row = record.prediction
    is_late = row is not None and row.windows >= MIN_WINDOWS
    return record.state is AnswerState.RIGHT or (record.state is AnswerState.GROWING and is_late)
