"""Long names end in … with the whole name as tooltip; a table's last column has its title."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from gui.protocol.run_tasks import TRIAL_COLUMNS
from gui.protocol.session_page import AttemptModel, table_view
from tests.gui.steps import SharedWindow, wait_until

NAME = "dense-coding-of-surface-textures-all-plates-and-speeds.toml"


def test_a_long_name_of_a_protocol_is_shortened_with_a_sign(
    disconnected: SharedWindow, tmp_path: Path
) -> None:
    window = disconnected.window
    form, before = window.protocol_panel.form, window.size()
    (tmp_path / NAME).write_text("nonsense")
    window.show_panel("protocol")
    window.resize(1024, 700)
    form.add_protocol(str(tmp_path / NAME))
    QApplication.processEvents()
    try:
        shown = form.protocol.shown_text()
        assert "…" in shown and form.protocol.currentText() == NAME
        assert form.protocol.toolTip() == NAME
        wait_until(lambda: not window.protocol_panel.worker.is_busy)
    finally:
        form.protocol.removeItem(form.protocol.currentIndex())
        form.protocol.setCurrentIndex(0)
        wait_until(lambda: not window.protocol_panel.worker.is_busy)
        window.resize(before)


@pytest.mark.parametrize("width_px", [200, 900])
def test_the_last_column_is_as_wide_as_its_title(qapp: QApplication, width_px: int) -> None:
    last = len(TRIAL_COLUMNS) - 1
    view = table_view(AttemptModel(), last)
    view.resize(width_px, 200)
    view.show()
    QApplication.processEvents()
    header = view.horizontalHeader()
    assert header.sectionSize(last) >= header.sectionSizeHint(last)
