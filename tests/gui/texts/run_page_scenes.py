"""The page of a run: attempts, conditions that ended early, notes, and the planned order."""

from __future__ import annotations

from collections.abc import Iterator

from PySide6.QtWidgets import QApplication

from gui.protocol.protocol_panel import ProtocolPanel
from gui.protocol.run_tasks import SessionNews
from tests.gui.steps import wait_until

END = (
    "L, 120 mm/s, 1000 g ends early after 1,000 trials: mean SA rate 123.45 ± 0.25 Hz; "
    "1,234 trials not recorded"
)
NOTE = "2026-11-21T12:00:00Z  annamaria.rothenberger  marked bad: someone leans on the table"


def run_page_scenes(panel: ProtocolPanel, session: str) -> Iterator[str]:
    """Show each tab with the attempts of a session."""
    panel.show_page(True)
    page = panel.page
    page.open_session(session)
    wait_until(lambda: len(page.attempts.rows) > 0)
    known = len(page.attempts.rows)
    page.show_news(SessionNews(session, known, (), (), known, early_ends=(END,) * 4))
    page.notes.addItems([NOTE] * 3)
    for tab in (page.attempt_view, page.notes, page.order_view):
        page.tabs.setCurrentWidget(tab)
        QApplication.processEvents()
        yield f"Page of a run, {page.tabs.tabText(page.tabs.currentIndex())}"
    page.show_session("")
    panel.show_page(False)
