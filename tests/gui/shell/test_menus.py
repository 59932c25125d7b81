"""The menus hold every button, are grey with it, and give no key twice."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QShortcut
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QComboBox,
    QLineEdit,
    QMenu,
    QPushButton,
    QTableView,
    QWidget,
)

from gui.live.live_page import TaxelStrip
from gui.live.replay_page import ReplayPage
from gui.live.saver import SaveStrip
from gui.operate.operate_panel import PromptPanel
from gui.shell.main_window import MainWindow
from gui.shell.tools_controller import CommandPage
from gui.widgets.labels import Strip
from rigctl.boards.drum_states import State
from tests.gui.steps import Harness


def _action(window: MainWindow, menu: str, text: str) -> QAction:
    """Return the action in a menu with that text."""
    return next(a for m, a in window.menus.actions() if m == menu and a.text() == text)


def test_menus_hold_the_buttons_of_all_panels_and_are_grey_with_them(harness: Harness) -> None:
    window = harness.window
    window.show_panel("operate")
    harness.update(state=int(State.IDLE))
    tare, retract = _action(window, "Rig", "Tare"), _action(window, "Rig", "Retract")
    assert tare.isEnabled() and not retract.isEnabled()
    tare.trigger()
    assert harness.engine.commands == ["tare"]
    harness.update(state=int(State.HOLD))
    assert not tare.isEnabled() and retract.isEnabled()
    harness.update(state=int(State.IDLE), contact_may_stand=True)
    assert "Arm first" in tare.toolTip()
    abort = _action(window, "Rig → Protocol", "Abort")
    assert not abort.isEnabled()
    harness.update(run={"state": "running", "session": "/data/s"})
    assert abort.isEnabled()
    abort.trigger()
    assert harness.engine.commands == ["tare", "abort"]
    for panel, buttons in (
        ("Rig", window.operate_panel.buttons),
        ("Rig → Protocol", window.protocol_panel.buttons),
        ("Rig → Finger", window.finger_tab.run_box.buttons),
    ):
        for button in buttons.values():
            assert _action(window, panel, button.text()).isEnabled() == button.isEnabled()


def test_each_button_that_stays_is_in_a_menu(harness: Harness) -> None:
    """Questions and alarms have theirs where they stand, pages that a menu opens and those of
    results, which come and go, on them."""
    window = harness.window
    strips = window.findChildren(Strip) + window.findChildren(PromptPanel)
    pages = [window.attach.engines, window.start, window.help, window.file_browser]
    pages += [window.analysis_tab.sessions, window.own_plots]
    tools: list[QWidget] = list(window.findChildren(CommandPage))
    tools += [window.tools.calibrate_page, window.tools.setup_page]
    elsewhere: list[QWidget] = [*strips, *pages, *tools, window.run_end_strip]
    elsewhere += [window.drum.alarms.strip, *window.live_page.findChildren(TaxelStrip)]
    elsewhere.append(window.analysis_tab.results_view)
    elsewhere += window.findChildren(SaveStrip) + window.findChildren(ReplayPage)
    for menu in window.findChildren(QMenu):
        menu.aboutToShow.emit()  # lines take the texts that their buttons have now
    names = {action.text().replace("&", "") for _, action in window.menus.actions()}
    connect = dict.fromkeys(("Connect", "Cancel", "Disconnect"), "Connect or disconnect")
    same = {"Open": "Open a session …", **connect}
    missing = []
    for button in window.findChildren(QPushButton):
        name = button.accessibleName() or button.text().replace("&", "")
        name = same.get(name, name).removeprefix("Learning curve: ")
        is_elsewhere = any(part.isAncestorOf(button) for part in elsewhere)
        if name != "…" and not is_elsewhere and not any(text.endswith(name) for text in names):
            missing.append(name)
    assert missing == []


def test_jogs_faults_and_live_plots_are_in_the_menus(harness: Harness) -> None:
    window = harness.window
    window.show_panel("operate")
    harness.update(state=int(State.ARMED), simulated=True)
    jog, inject = _action(window, "Rig → Jog", "Jog −10 mm"), "Inject the chosen fault"
    assert _action(window, "Rig", inject).isEnabled()
    jog.trigger()
    assert harness.engine.requests == [("jog", {"mm": -10.0})]
    harness.update(state=int(State.HOLD), simulated=False)
    assert not jog.isEnabled() and "retract first" in jog.toolTip()
    assert not _action(window, "Rig", inject).isEnabled(), "a bench has no faults to inject"
    taxels = _action(window, "View → Controls of the live plots", "Taxels")
    taxels.trigger()
    assert window.live_page.taxel_strip.isVisible()
    taxels.trigger()
    assert not window.live_page.taxel_strip.isVisible()


def test_no_two_actions_have_the_same_keys(harness: Harness) -> None:
    keys = [key for row in harness.window.menus.rows() for key in [row.shortcut] if key]
    keys += [key.key().toString() for key in harness.window.findChildren(QShortcut)]
    assert len(keys) > 10 and len(set(keys)) == len(keys)


def test_every_control_is_reached_with_the_tab_key(harness: Harness) -> None:
    kinds = (QPushButton, QComboBox, QLineEdit, QAbstractSpinBox, QTableView)
    for panel in ("operate", "protocol", "analysis", "finger"):
        harness.window.show_panel(panel)
        controls = [w for kind in kinds for w in harness.window.findChildren(kind)]
        stop = harness.window.toolbar.stop_button  # takes no focus, as Esc does the same
        visible = [w for w in controls if w.isVisible() and w is not stop and not w.focusProxy()]
        mute = [w for w in visible if not w.focusPolicy() & Qt.FocusPolicy.TabFocus]
        inside = (QComboBox, QAbstractSpinBox, QTableView)
        assert visible and not [w for w in mute if not isinstance(w.parent(), inside)]
