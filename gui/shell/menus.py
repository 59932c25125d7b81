"""The lines of the menus that press the panels' buttons, and those of rig and live views."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QAbstractButton, QMenu, QWidget

from gui.analysis.export import FORMATS, ExportButton
from gui.finger.finger_tab import FingerTab
from gui.link.engine_link import EngineLink
from gui.live.live_page import LivePage
from gui.live.navigation import SPANS_S
from gui.operate.calibrate import CalibratePage
from gui.operate.operate_panel import OperatePanel, PromptPanel
from gui.operate.setup_page import SetupPage
from gui.protocol.protocol_panel import ProtocolPanel
from gui.shell.actions import ActionRegistry
from gui.shell.docks import DockArea, PageStack
from gui.shell.drum_controller import DrumController
from gui.shell.user_settings import SPAN_KEY, UserSettings, is_span
from rigctl.engine.rpc.messages import LslScope

if TYPE_CHECKING:
    from gui.analysis.analysis_tab import AnalysisTab
    from gui.analysis.trial_list import TrialList

_CHANGES = (
    QEvent.Type.EnabledChange,
    QEvent.Type.ToolTipChange,
    QEvent.Type.ShowToParent,
    QEvent.Type.HideToParent,
)


class ButtonAction(QObject):
    """Lets an action click a button, be grey with it and take its name and tooltip.

    The name is that for screen readers where the button has one, else its text, behind ``prefix``.
    The action is grey as well while the button is taken away, such as that of a simulated fault.
    It belongs to the action, and lives as long.
    """

    def __init__(self, action: QAction, button: QAbstractButton, prefix: str = "") -> None:
        super().__init__(action)
        self._action, self._button, self._prefix = action, button, prefix
        action.triggered.connect(lambda _=False: button.click())
        button.installEventFilter(self)
        menu = action.parent()
        assert isinstance(menu, QMenu)
        menu.aboutToShow.connect(self._follow)  # no event tells of another text
        self._follow()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Follow a change of the button."""
        if event.type() in _CHANGES:
            self._follow()
        return False

    def _follow(self) -> None:
        button = self._button
        self._action.setText(self._prefix + (button.accessibleName() or button.text()))
        self._action.setEnabled(button.isEnabled() and not _is_taken_away(button))
        self._action.setToolTip(button.toolTip())


def _is_taken_away(button: QAbstractButton) -> bool:
    """Return whether a button itself was hidden, and not only the page or the panel that has it."""
    was_asked = button.testAttribute(Qt.WidgetAttribute.WA_WState_ExplicitShowHide)
    return was_asked and button.isHidden()


class SaveMenu(QObject):
    """Lines of the File menu that save the page in the middle as the *Save* button on it does.

    Each is grey where the page has no such button, or has nothing to save.
    """

    def __init__(self, menus: ActionRegistry, pages: PageStack) -> None:
        super().__init__(pages)
        self._pages = pages
        self.actions = {
            suffix: menus.add(
                "File → Save the page",
                suffix.upper(),
                partial(self._save, suffix),
                tip="Save the page in the middle of the window, as the button Save on it does",
            )
            for suffix in FORMATS
        }
        menu = self.actions[FORMATS[0]].parent()
        assert isinstance(menu, QMenu)
        menu.aboutToShow.connect(self._follow)
        self._watch(pages)
        pages.page_added.connect(self._watch)
        self._follow()

    def _watch(self, pages: QWidget) -> None:
        for button in pages.findChildren(ExportButton):
            button.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Follow a button that comes, goes, or goes off."""
        if event.type() in (QEvent.Type.EnabledChange, QEvent.Type.Show, QEvent.Type.Hide):
            self._follow()
        return False

    def _button(self) -> ExportButton | None:
        """Return the button on the screen, None without one that is on."""
        buttons = self._pages.findChildren(ExportButton)
        return next((b for b in buttons if b.isVisible() and b.isEnabled()), None)

    def _follow(self) -> None:
        button = self._button()
        for suffix, action in self.actions.items():
            action.setEnabled(button is not None and suffix in button.suffixes)

    def _save(self, suffix: str) -> None:
        if (button := self._button()) is not None:
            button.export_requested.emit(suffix)


def add_buttons(
    menus: ActionRegistry, menu: str, buttons: Iterable[QAbstractButton], prefix: str = ""
) -> None:
    """Add a line for each button to a menu, named as in :data:`~gui.shell.actions.MENUS`.

    A submenu has the name of its menu, an arrow and its own: ``Rig → Protocol``.
    """
    for button in buttons:
        ButtonAction(menus.add_action(menu, QAction(button.text())), button, prefix)


def add_panel_menus(
    menus: ActionRegistry,
    operate: OperatePanel,
    protocol: ProtocolPanel,
    finger: FingerTab,
) -> None:
    """Add the buttons of all panels that act on rigs."""
    add_buttons(menus, "Rig", [*operate.buttons.values(), operate.set_button])
    steps = operate.bring_up
    guided = [steps.next, steps.calibrate, steps.steps, operate.record_box.button]
    add_buttons(menus, "Rig", [*guided, operate.bench.inject, operate.bench.wire])
    add_buttons(menus, "Rig → Jog", operate.jog.buttons.values())
    runs = (*protocol.buttons.values(), *protocol.continue_buttons, protocol.page_button)
    add_buttons(
        menus, "Rig → Protocol", [*runs, *protocol.queue.buttons, *protocol.editing_buttons()]
    )
    page = protocol.page
    add_buttons(menus, "Rig → Trials and notes", [page.open_button, *page.buttons.values()])
    add_buttons(menus, "Rig → Trials and notes", [page.learning.button], "Learning curve: ")
    scans = finger.run_box
    moving = (*scans.buttons.values(), *scans.continue_buttons, scans.models_button, scans.inject)
    add_buttons(menus, "Rig → Finger", [finger.bar.connect_button, *moving])


def drum_controls(
    operate: OperatePanel,
    protocol: ProtocolPanel,
    prompt: PromptPanel,
    calibrate: CalibratePage,
    setup: SetupPage,
) -> list[QWidget]:
    """Return what acts on the drum rig, but STOP."""
    bench = operate.bench
    by_hand = (operate.set_button, operate.bring_up.next, operate.record_box.button)
    return [
        *operate.buttons.values(),
        *operate.jog.buttons.values(),
        *by_hand,
        *(bench.plate, bench.inject, bench.wire),
        *protocol.buttons.values(),
        *(*protocol.continue_buttons, *protocol.queue.buttons),
        *(prompt.confirm, prompt.abort),
        *calibrate.controls,
        *setup.controls,
    ]


def finger_controls(finger: FingerTab) -> list[QWidget]:
    """Return what acts on the rig of the moving finger, but STOP."""
    box, prompt = finger.run_box, finger.prompt_panel
    runs = (*box.buttons.values(), *box.continue_buttons, box.models_button, box.inject)
    return [*runs, prompt.confirm, prompt.abort]


SOUND_KEY, NOTICE_KEY = "alarm_sound", "desktop_notices"


def add_rig_menu(
    menus: ActionRegistry,
    drum: DrumController,
    *,
    stop: Callable[[], object],
    list_engines: Callable[[], object],
) -> None:
    """Add the actions of the drum rig."""
    click = drum.toolbar.connect_button.click
    menus.add("Rig", "&Connect or disconnect", click, shortcut="Ctrl+R", tip="The chosen rig")
    menus.add("Rig", "&STOP", stop, tip="Stop and lift the drum, and end every run (Esc)")
    tip = "List the engines that run already, and join one of them"
    menus.add("Rig", "&Running engines", list_engines, tip=tip)


LSL_CHOICES = {
    "O&ff": LslScope.OFF,
    "To programs of this &computer": LslScope.COMPUTER,
    "To programs of the &network": LslScope.NETWORK,
}
LSL_TIP = "Samples, spikes, stimulation pulses and events, as rigctl lsl streams them"


def add_lsl_choices(menus: ActionRegistry, menu: str, link: EngineLink[Any, Any]) -> None:
    """Add who may see what a rig streams over the Lab Streaming Layer; grey without an engine."""

    def choose(scope: LslScope) -> None:
        link.request("lsl", scope=scope)

    def enable(is_on: bool) -> None:
        for action in actions.values():
            action.setEnabled(is_on)

    actions = menus.add_choices(menu, "Stream over &LSL", LSL_CHOICES, LslScope.OFF, choose)
    for action in actions.values():
        action.setToolTip(LSL_TIP)
    enable(False)
    link.opened.connect(lambda: enable(True))
    link.closed.connect(lambda _: enable(False))
    link.status_changed.connect(lambda status: actions[status.lsl].setChecked(True))


def add_alarm_switches(menus: ActionRegistry, drum: DrumController, settings: UserSettings) -> None:
    """Add the switches of sound and desktop notices, which the settings keep."""

    def switch(name: str, key: str, is_on: bool) -> None:
        setattr(drum.alarms.announcer, name, is_on)
        settings.set_value(key, is_on)

    for title, name, key, tip in (
        ("Alarm &sound", "sounds", SOUND_KEY, "Beep until an alarm is over or silenced"),
        ("Desktop &notices", "notices", NOTICE_KEY, "Show alarms and news of a run on the desktop"),
    ):
        action = menus.add("Rig", title, partial(switch, name, key), tip=tip, checkable=True)
        action.setChecked(settings.value(key, True))
        setattr(drum.alarms.announcer, name, action.isChecked())


def add_live_actions(menus: ActionRegistry, page: LivePage, settings: UserSettings) -> None:
    """Add time span, pause, the alignment of trials, and the picture of the live plots."""
    spans = {f"{span_s} s": span_s for span_s in SPANS_S}
    span_s = settings.value(SPAN_KEY, float(SPANS_S[3]), is_span)
    menus.add_choices("View", "Time &span", spans, span_s, page.plots.set_span)
    tip = "Look back while samples go on to arrive, or follow them again"
    toggle = page.plots.navigation.toggle
    menus.add("View", "&Pause or follow", toggle, shortcut="Ctrl+Space", tip=tip)
    tip = "Begin each trial at the left edge of the live plots, or let them scroll"
    menus.add("View", "Begin at each t&rial", page.toggle_alignment, tip=tip)
    tip = "Show all of the axes of force and speed again (0, or a double click on them)"
    menus.add("View", "&Whole axes", page.plots.show_whole_courses, tip=tip)
    add_buttons(menus, "View → Controls of the live plots", page.bar.buttons.values())
    tip = "Save the live plots as they are now"
    menus.add("File", "Save &picture", page.save_picture, shortcut="Ctrl+Shift+P", tip=tip)
    tip = "Save the samples in view as a CSV"
    menus.add("File", "Save &table", page.save_strip.table.click, tip=tip)


def add_analysis_menu(menus: ActionRegistry, analysis: AnalysisTab, docks: DockArea) -> None:
    """Add the buttons of the analysis, and the ways into the trial table's filter and columns."""
    panel = analysis.panel
    box = panel.run_box
    tasks = (panel.verify_button, box.run_button, box.cancel_button, box.results_button)
    report = (analysis.results_panel.report_button, analysis.results_panel.folder_button)
    others = (box.form.add_button, box.form.remove_button)
    compare = analysis.trial_view.compare
    trials = (panel.trials.replay_button, compare.button, compare.overlay_button)
    add_buttons(menus, "Tools → Analysis", [*others, *tasks, *report, *trials])
    _add_trial_actions(menus, docks, panel.trials)


def _add_trial_actions(menus: ActionRegistry, docks: DockArea, trials: TrialList) -> None:
    """Add the ways into the filter and the columns of the trial table."""

    def in_panel(give_focus: Callable[[], object]) -> Callable[[], None]:
        def act() -> None:
            docks.show_panel("analysis")
            give_focus()

        return act

    menu = "Tools → Analysis"
    tip = "Move the keyboard's focus to the filter of the trial table"
    slot = in_panel(trials.filter_by_keys)
    menus.add(menu, "&Filter the trials", slot, shortcut="Ctrl+F", tip=tip)
    tip = "Move the keyboard's focus to the columns' names; Return sorts"
    slot = in_panel(trials.sort_by_keys)
    menus.add(menu, "&Sort the trials", slot, shortcut="Ctrl+Shift+S", tip=tip)
