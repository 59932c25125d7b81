"""A recorded session: its trials, what the analyses say, and a replay."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from gui.analysis.run_box import METHODS, PAPER, QUICK
from gui.finger.scan_record import AnswerState
from gui.screenshots.camera import THEMES
from gui.screenshots.drum_scenes import file_name
from gui.screenshots.scene import FINGER_SEED, SAVE_IN, Scene, Studio
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


REPLAYED_MS = 1200
FEW_DRAWS = 2


def recorded_scenes(studio: Studio) -> Iterator[Scene]:
    """Show the pages of a trial, the figure of the quick check, a report, and the replay."""
    window, wait = studio.window, studio.camera.wait
    wait(lambda: studio.recordings.has_session)
    window.show_panel("analysis")
    window.analysis_tab.panel.open_session(str(studio.recordings.session))
    yield from _trial_pages(studio)
    yield from _analyses(studio)
    yield from _replay(studio)


def _is_idle(studio: Studio) -> bool:
    tab = studio.window.analysis_tab
    return not (tab.worker.is_busy or tab.reader.is_busy)


def _trial_pages(studio: Studio) -> Iterator[Scene]:
    panel, pages = studio.window.analysis_tab.panel, studio.window.analysis_tab.trial_view
    idle = partial(_is_idle, studio)
    studio.camera.wait(lambda: idle() and panel.model.rowCount() > 0)
    panel.table.selectRow(panel.model.rowCount() // 2 + 1)
    studio.camera.wait(idle)
    for index in range(pages.count()):
        pages.setCurrentIndex(index)
        if pages.currentWidget() is pages.compare:
            panel.table.selectAll()
            pages.compare.button.click()
            studio.camera.wait(idle)
        yield Scene(f"trial-{file_name(pages.tabText(index))}", idle)
    pages.setCurrentIndex(0)


def _analyses(studio: Studio) -> Iterator[Scene]:
    tab, box = studio.window.analysis_tab, studio.window.analysis_tab.panel.run_box
    box.form.fields["iterations"].setValue(FEW_DRAWS)
    for name, method in (("classified", QUICK), ("results", PAPER)):
        box.method.setCurrentText(METHODS[method].name)
        box.run_button.click()
        studio.camera.wait(partial(_is_idle, studio))
        yield Scene(name, lambda: tab.results_view.is_whole)
    results = tab.results_view
    for index in range(1, results.count()):
        results.setCurrentIndex(index)
        yield Scene(f"results-{file_name(results.tabText(index))}", lambda: results.is_whole)


def _replay(studio: Studio) -> Iterator[Scene]:
    window, page = studio.window, studio.window.replay.page
    window.replay.show()
    page.open(str(studio.recordings.session))
    studio.camera.wait(lambda: not page.worker.is_busy and page.play.isEnabled())
    page.play.click()
    studio.camera.wait(lambda: page.player.position > REPLAYED_MS)
    page.play.click()
    yield Scene("replay", lambda: not page.worker.is_busy)
    window.replay.hide()
