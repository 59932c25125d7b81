"""A day on the virtual rig, with the limits of a file: by hand, live plots, a queue of runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.live.live_page import COUNTS, TRIALS, VOLTS, LivePage
from gui.live.time_plots import SINCE_START
from gui.protocol.run_tasks import BAD, COMMITTED, TRIAL_COLUMNS
from rigctl.boards.drum_states import State
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.gui.live.test_live_page import LEFT, move, point, turn
from tests.gui.rig_window import RigWindow, rig_window
from tests.gui.steps import click, turn_wheel

RIG = '[ports]\nsimulate = "virtual"\n[limits]\nspeed_max_mm_s = 120\nforce_max_g = 900\n'
TWO_PLATES = """
name = "two-plates"
textures = ["D", "B"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 2
"""
B = "circular ridges, 1.2 mm high, every 6.2 mm"
STILL = 15
"""Statuses in which the time left of a paused run is compared: one and a half seconds."""
SPEED, FORCE, LOST = (
    TRIAL_COLUMNS.index(name) for name in ("Mean speed\n(mm/s)", "Mean force\n(g)", "Lost\nsamples")
)


@pytest.fixture(scope="module")
def rig(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RigWindow]:
    """Yield a window on a rig whose file has limits of its own."""
    folder = tmp_path_factory.mktemp("runtime")
    path = folder / "rig.toml"
    path.write_text(RIG)
    with rig_window(qapp, str(path), folder) as opened:
        yield opened


def test_set_points_keep_the_limits_of_the_file_and_a_refusal_says_why(rig: RigWindow) -> None:
    rig.window.show_panel("operate")
    operate = rig.window.operate_panel
    assert operate.set_points.allowed.text() == "Allowed: 20 to 120 mm/s, 50 to 900 g"
    for box, key, limit in (
        (operate.speed, Qt.Key.Key_PageUp, 120.0),
        (operate.force, Qt.Key.Key_PageDown, 50.0),
    ):
        box.setFocus()
        for _ in range(20):
            QTest.keyClick(box, key)
        assert box.value() == limit
    rig.window.engine_link.request("set", speed_mm_s=150.0, force_g=500.0)
    rig.until(lambda: "refused  set: " in rig.log)
    reason = rig.log.partition("refused  set: ")[2].splitlines()[0]
    assert reason.startswith("speed_mm_s 150 is outside this rig's limits, 20 to 120: choose one")


def test_in_contact_the_plate_is_locked_and_a_tare_is_refused(rig: RigWindow) -> None:
    rig.bring_up()
    operate = rig.window.operate_panel
    operate.speed.setValue(80)
    operate.force.setValue(500)
    rig.press("approach")
    rig.until_state(State.HOLD)
    operate.bench.inject.setFocus()
    boxes = operate.bench.plate, operate.speed, operate.force
    before = rig.status.texture, operate.speed.value(), operate.force.value()
    for box in boxes:
        turn_wheel(box)
    assert not operate.bench.plate.isEnabled() and "Locked: " in operate.bench.plate.toolTip()
    tare = operate.buttons["tare"]
    assert not tare.isEnabled() and tare.toolTip().startswith("Retract first")
    rig.window.engine_link.request("tare")
    rig.until(lambda: "refused  tare: " in rig.log)
    reason = rig.log.partition("refused  tare: ")[2].splitlines()[0]
    assert "in state HOLD (it is possible in IDLE or ARMED only)" in reason
    assert (rig.status.texture, operate.speed.value(), operate.force.value()) == before


def test_the_live_plots_look_back_on_the_drum_in_contact(rig: RigWindow) -> None:
    page = rig.window.live_page
    rig.press("run")
    rig.until_state(State.RUN)
    _see_values(page)
    _enlarge(page)
    turn(page, 0.5, 3)
    assert page.plots.navigation.window.span < 10_000
    click(page.bar.pause)
    rig.press("retract")
    rig.until_state(State.ARMED)


def _see_values(page: LivePage) -> None:
    """Pause, point at a reading and at the spikes, and see it in counts and in volts."""
    click(page.bar.pause)
    move(page, 2, 0.9, 4.5 / 18)
    QTest.mouseClick(page.plots.graphics.viewport(), LEFT, pos=point(page, 2, 0.9, 4.5 / 18))
    move(page, 2, 0.95, 4.5 / 18)
    assert "T5 " in page.cursor_label.text() and " counts" in page.cursor_label.text()
    assert " g · " in page.cursor_label.text()
    assert page.difference_label.text().startswith("From the reference +0.")
    page.bar.unit.setCurrentText(VOLTS)
    assert " V" in page.cursor_label.text()
    page.bar.unit.setCurrentText(COUNTS)


def _enlarge(page: LivePage) -> None:
    """Enlarge the taxel under the pointer, and show all again."""
    view, at = page.plots.graphics.viewport(), point(page, 2, 0.5, 4.5 / 18)
    QTest.mouseDClick(view, LEFT, pos=at)
    assert page.plots.time_plots.taxels == (4,)
    QTest.mouseDClick(view, LEFT, pos=at)
    assert len(page.plots.time_plots.taxels) == 18


def test_a_run_tells_what_comes_repeats_a_trial_and_starts_the_next(
    rig: RigWindow, tmp_path: Path
) -> None:
    protocol = tmp_path / "two-plates.toml"
    protocol.write_text(TWO_PLATES)
    panel = rig.window.protocol_panel
    rig.window.show_panel("protocol")
    panel.add_protocol(str(protocol))
    panel.out.setText(str(tmp_path))
    rig.until(panel.queue.add_button.isEnabled)
    click(panel.queue.add_button)
    rig.until(lambda: panel.queue.list.count() == 1)
    rig.start(protocol, tmp_path)
    session = Path(rig.status.run.session or "")
    rig.until(lambda: rig.status.run.trials_committed == 1)
    assert panel.run_rows["Progress"].text().startswith("1 of 4 trials, ")
    assert panel.run_rows["Next plate"].text() == f"B after this trial\n{B}"
    assert panel.run_rows["Finishes"].text().endswith("plus plate changes")
    _pause(rig)
    _repeat_first_trial(rig)
    click(panel.buttons["Resume"])
    _see_alignment(rig)
    rig.until(lambda: rig.window.prompt_panel.isVisible())
    assert panel.run_rows["Next plate"].text() == f"B now\n{B}"
    rig.confirm()
    rig.until(lambda: Path(rig.status.run.session or "") != session)
    rig.until(lambda: panel.queue.list.count() == 0 and rig.window.prompt_panel.isVisible())
    assert rig.window.health_strip.cells["trial"].value.text() == "–"
    click(rig.window.prompt_panel.abort)
    rig.until(lambda: rig.status.run.state == "aborted")
    _check(session)


def _pause(rig: RigWindow) -> None:
    """Pause between trials; the time left stands still while the finishing time moves on."""
    panel, link = rig.window.protocol_panel, rig.window.engine_link
    click(panel.buttons["Pause"])
    rig.until(lambda: rig.status.run.state == "paused")
    rig.until_state(State.ARMED, State.IDLE)
    left_s: list[float | None] = []
    link.status_changed.connect(lambda status: left_s.append(status.run.eta_s))
    rig.until(lambda: len(left_s) > STILL)
    assert len(set(left_s)) == 1


def _repeat_first_trial(rig: RigWindow) -> None:
    """Ask for the first trial again, and say why."""
    page = rig.window.protocol_panel.page
    if not rig.window.protocol_panel.shows_page:
        click(rig.window.protocol_panel.page_button)
    rig.until(lambda: len(page.attempts.rows) >= 1)
    texts = page.attempts.rows[0].texts
    assert page.attempts.rows[0].verdict == COMMITTED
    assert float(texts[SPEED]) == pytest.approx(120, rel=0.01)
    assert float(texts[FORCE]) == pytest.approx(500, rel=0.05) and texts[LOST] == "0"
    page.attempt_view.selectRow(0)
    QTest.keyClicks(page.text, "the plate slipped")
    click(page.buttons["repeat"])
    rig.until(lambda: page.attempts.rows[0].verdict == BAD)


def _see_alignment(rig: RigWindow) -> None:
    """Align the trials in the live plots; the one before is behind the present one."""
    page = rig.window.live_page
    click(rig.window.protocol_panel.page_button)
    click(page.bar.buttons[TRIALS])
    QTest.keyClick(page.alignment_strip.align, Qt.Key.Key_Space)
    axis = page.plots.time_plots.raster_plot.getAxis("bottom")
    rig.until(lambda: axis.labelText == SINCE_START)
    QTest.keyClick(page.alignment_strip.align, Qt.Key.Key_Space)
    click(page.bar.buttons[TRIALS])


def _check(folder: Path) -> None:
    """Every trial counts once, and the first one with the attempt that was asked for again."""
    with Session.open(folder) as session:
        counted = session.trials[session.committed()]
        assert sorted(counted["trial_id"].tolist()) == [1, 2, 3, 4]
        assert counted["attempt"][counted["trial_id"] == 1].tolist() == [2]
        assert [note.text for note in session.notes] == ["the plate slipped"]
    report = verify(folder)
    assert report.whole and report.trials_committed == 4, report.problems
