"""Two rigs in one window, each with an engine and a STOP of its own."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.shell.main_window import LEFT_PX
from gui.shell.rigs_window import RigCell, RigsWindow, connect_menu
from gui.widgets.labels import Level
from gui.widgets.theme import ThemeChoice
from rigctl.boards.drum_states import State
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from tests.gui.rig_window import RigWindow, opened_window
from tests.gui.running_engine import LONG
from tests.gui.steps import click, press_escape
from tests.gui.texts.cut import cut_texts

ADD, REMOVE = "Add a ri&g to this window", "Re&move this rig"


class Rigs(NamedTuple):
    """The window of two rigs, and both of its pages."""

    whole: RigsWindow
    left: RigWindow
    right: RigWindow

    def cell(self, rig: RigWindow) -> RigCell:
        """Return the rig's place in the strip."""
        return self.whole.cells[self.whole.windows.index(rig.window)]

    def press(self) -> None:
        """Let both drums press on their sensors."""
        for rig in (self.left, self.right):
            click(self.cell(rig).name)
            rig.bring_up()
            rig.press("approach")
        for rig in (self.left, self.right):
            rig.until_state(State.HOLD)


def _choose(rig: RigWindow, text: str) -> None:
    actions = {action.text(): action for _, action in rig.window.menus.actions()}
    actions[text].trigger()


@pytest.fixture(scope="module")
def rigs(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rigs]:
    """Yield a window of two drums, opened from its menu."""
    assert qapp is QApplication.instance()
    folder = tmp_path_factory.mktemp("rigs")
    for name in ("left", "right"):
        (folder / f"{name}.toml").write_text('[ports]\nsimulate = "virtual"\n')
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(folder))
        with opened_window() as left:
            connect_menu(left.window)
            assert left.window.isWindow(), "one rig has no strip"
            left.connect(str(folder / "left.toml"))
            _choose(left, ADD)
            whole = left.window.window()
            assert isinstance(whole, RigsWindow)
            right = RigWindow(whole.windows[1])
            right.connect(str(folder / "right.toml"))
            yield Rigs(whole, left, right)


def _state(cell: RigCell) -> tuple[Level, str]:
    cell.refresh()
    return cell.lamp.level, cell.state.text()


def _goes_on(rig: RigWindow) -> None:
    """Demand that the drum still presses, as its board says half a second later."""
    told_s = rig.status.at_s
    rig.until(lambda: rig.status.at_s > told_s + 0.5)
    assert rig.status.state is State.HOLD, rig.log


def test_each_stop_stops_its_rig_alone_and_escape_both(rigs: Rigs) -> None:
    rigs.press()
    left, right = rigs.left, rigs.right
    assert right.window.isVisible() and not left.window.isVisible()
    assert [rigs.cell(rig).name.text() for rig in (left, right)] == ["1 left", "2 right"]
    assert _state(rigs.cell(left)) == _state(rigs.cell(right))
    assert _state(rigs.cell(left))[0] is Level.OK and "HOLD" in _state(rigs.cell(left))[1]
    _choose(right, ADD)
    assert "once the others are at rest" in right.log and len(rigs.whole.cells) == 2
    click(rigs.cell(left).stop)
    left.until_state(State.ARMED)
    _goes_on(right)
    click(right.window.toolbar.stop_button)
    right.until_state(State.ARMED)
    rigs.press()
    press_escape(right.window.operate_panel.buttons["retract"])
    for rig in (left, right):
        rig.until_state(State.ARMED)


def test_keys_act_on_the_page_that_is_shown(rigs: Rigs) -> None:
    for number, rig in enumerate((rigs.left, rigs.right), start=1):
        QTest.keyClick(rigs.whole, Qt.Key(Qt.Key.Key_0 + number), Qt.KeyboardModifier.AltModifier)
        assert rig.window.isVisible() and rigs.cell(rig).name.isChecked()
    control = Qt.KeyboardModifier.ControlModifier
    QTest.keyClick(rigs.whole, Qt.Key.Key_2, control)
    right, left = (rig.window.docks.docks for rig in (rigs.right, rigs.left))
    assert not right["protocol"].visibleRegion().isEmpty()
    click(rigs.cell(rigs.left).name)
    assert left["protocol"].visibleRegion().isEmpty()


def test_a_theme_is_that_of_all_rigs(rigs: Rigs) -> None:
    rigs.left.window.set_theme(ThemeChoice.DARK)
    assert rigs.right.window.appearance.choice is ThemeChoice.DARK
    assert rigs.right.window.appearance.theme.name == "dark"
    rigs.right.window.set_theme(ThemeChoice.LIGHT)
    assert rigs.left.window.appearance.theme.name == "light"


def test_large_texts_have_room_on_every_page_and_in_the_strip(rigs: Rigs) -> None:
    whole, left, right = rigs
    before = whole.size()
    click(rigs.cell(right).name)
    left.until(lambda: right.window.is_at_rest())
    right.window.set_text_size(150)
    whole.resize(1280, 800)
    for rig in (left, right):
        click(rigs.cell(rig).name)
        for _ in range(4):  # a wrapped text asks for its height once it has its width
            QApplication.processEvents()
        assert max(rig.window.docks.side_widths_px().values()) > 1.2 * LEFT_PX
        assert not cut_texts(whole.strip)
    left.window.set_text_size(100)
    whole.resize(before)


def test_a_rig_whose_engine_hangs_and_dies_leaves_the_other_alone(rigs: Rigs) -> None:
    rigs.press()
    left, right = rigs.left, rigs.right
    engine = left.window.engine_link.engine
    assert engine is not None
    os.kill(engine.pid, signal.SIGSTOP)
    try:
        left.until(lambda: _state(rigs.cell(left))[0] is Level.BAD)
        click(rigs.cell(left).stop)
        left.until(lambda: "press the emergency stop" in left.log)
        _goes_on(right)
    finally:
        os.kill(engine.pid, signal.SIGKILL)
    left.until(lambda: not left.window.engine_link.is_connected)
    assert _state(rigs.cell(left))[0] is Level.BAD, "nobody knows what it does"
    click(rigs.cell(left).stop)
    _goes_on(right)
    click(rigs.cell(right).stop)
    right.until_state(State.ARMED)
    left.connect(engine.rig)
    assert _state(rigs.cell(left))[0] is Level.OK


def test_a_disconnected_rig_leaves_the_window_and_its_number_is_free(rigs: Rigs) -> None:
    left, right, whole = rigs.left, rigs.right, rigs.whole
    _choose(right, REMOVE)
    assert "once it is disconnected" in right.log and len(whole.cells) == 2
    _choose(left, ADD)
    third = RigWindow(whole.windows[2])
    third.connect("virtual")
    click(third.window.toolbar.connect_button)
    third.until(lambda: not third.window.engine_link.is_connected)
    _choose(third, REMOVE)
    assert whole.windows == [left.window, right.window], third.log
    _choose(left, ADD)
    assert [cell.number for cell in whole.cells] == [1, 2, 3]
    _choose(RigWindow(whole.windows[2]), REMOVE)
    click(rigs.cell(right).name)
    assert right.window.isVisible()
    assert all(rig.window.engine_link.is_connected for rig in (left, right))


def test_closing_asks_about_the_run_of_each_rig(rigs: Rigs, tmp_path: Path) -> None:
    click(rigs.cell(rigs.right).name)
    protocol = tmp_path / "long.toml"
    protocol.write_text(LONG)
    rigs.right.start(protocol, tmp_path / "session")
    rigs.right.until(lambda: rigs.right.status.run.state == "running")
    click(rigs.cell(rigs.left).name)
    rigs.whole.close()
    assert rigs.whole.isVisible() and rigs.right.window.attach.closing.isVisible()
    click(rigs.right.window.attach.closing.stop)
    rigs.right.until(lambda: not rigs.whole.isVisible())
