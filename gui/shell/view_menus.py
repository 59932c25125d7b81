"""The actions of the menus that concern the live plots and the table of trials."""

from __future__ import annotations

from collections.abc import Callable

from gui.analysis.trials.trial_list import TrialList
from gui.live.live_page import LivePage
from gui.live.navigation import SPANS_S
from gui.shell.actions import ActionRegistry
from gui.shell.button_menus import add_buttons
from gui.shell.docks import DockArea
from gui.shell.user_settings import UserSettings
from gui.shell.window_memory import SPAN_KEY, is_span


def add_live_actions(menus: ActionRegistry, page: LivePage, settings: UserSettings) -> None:
    """Add time span, pause, the alignment of trials, and the picture of the live plots."""
    spans = {f"{span_s} s": span_s for span_s in SPANS_S}
    span_s = settings.value(SPAN_KEY, float(SPANS_S[3]), is_span)
    menus.add_choices("View", "Time &span", spans, span_s, page.plots.set_span)
    tip = "Look back while samples go on to arrive, or follow them again"
    menus.add("View", "&Pause or follow", page.toggle_pause, shortcut="Ctrl+Space", tip=tip)
    tip = "Begin each trial at the left edge of the live plots, or let them scroll"
    menus.add("View", "Begin at each t&rial", page.toggle_sweeps, tip=tip)
    add_buttons(menus, "View → Controls of the live plots", page.bar.buttons.values())
    tip = "Save the live plots as they are now"
    menus.add("File", "Save &picture", page.save_picture, shortcut="Ctrl+Shift+P", tip=tip)
    tip = "Save the samples in view as a CSV"
    menus.add("File", "Save &table", page.save_strip.table.click, tip=tip)


def add_trial_actions(menus: ActionRegistry, docks: DockArea, trials: TrialList) -> None:
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
