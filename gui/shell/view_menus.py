"""The actions of the File and View menus that concern the live plots."""

from __future__ import annotations

from gui.live.page.live_page import LivePage
from gui.live.review.navigation import SPANS_S
from gui.shell.actions import ActionRegistry
from gui.shell.memory.user_settings import UserSettings
from gui.shell.memory.window_memory import SPAN_KEY, is_span


def add_live_actions(menus: ActionRegistry, page: LivePage, settings: UserSettings) -> None:
    """Add time span, pause, the alignment of trials, and the picture of the live plots."""
    spans = {f"{span_s} s": span_s for span_s in SPANS_S}
    span_s = settings.value(SPAN_KEY, float(SPANS_S[3]), is_span)
    menus.add_choices("View", "Time &span", spans, span_s, page.plots.set_span)
    tip = "Look back while samples go on to arrive, or follow them again"
    menus.add("View", "&Pause or follow", page.toggle_pause, shortcut="Ctrl+Space", tip=tip)
    tip = "Begin each trial at the left edge of the live plots, or let them scroll"
    menus.add("View", "Begin at each t&rial", page.toggle_sweeps, tip=tip)
    tip = "Save the live plots as they are now"
    menus.add("File", "Save &picture", page.save_picture, shortcut="Ctrl+Shift+P", tip=tip)
