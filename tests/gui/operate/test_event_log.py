"""The log shows one kind, problems, or lines with some words, and keeps all of them."""

from __future__ import annotations

from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.operate.event_log import ALL_KINDS, MAX_LINES, PROBLEMS, EventLog, LogPanel


def shown(log: EventLog) -> list[str]:
    """Return the texts that take room in the log."""
    found, block = [], log.document().firstBlock()
    while block.isValid():
        if log.blockBoundingGeometry(block).height() > 0:
            found.append(block.text().split("  ", 1)[-1])
        block = block.next()
    return found


def test_the_log_is_filtered_by_kind_and_by_words(qapp: QApplication) -> None:
    log = EventLog()
    panel = LogPanel(log)
    panel.resize(700, 120)
    panel.show()
    log.add("rig", "connected to the virtual rig")
    log.add("refused", "approach: the drum has no zero")
    log.add("stop", "stopped by this window")
    assert [panel.kinds.itemText(i) for i in range(panel.kinds.count())][2:] == [
        "rig", "refused", "stop",
    ]  # fmt: skip
    panel.kinds.setCurrentText(PROBLEMS)
    log.add("done", "arm: armed, lifted")
    QApplication.processEvents()
    assert len(shown(log)) == 2 and "approach" in shown(log)[0] and "stopped" in shown(log)[1]
    panel.kinds.setCurrentText("done")
    assert len(shown(log)) == 1 and "armed" in shown(log)[0]
    log.reset_colours()
    assert len(shown(log)) == 1
    panel.kinds.setCurrentText(ALL_KINDS)
    QTest.keyClicks(panel.search, "DRUM zero")
    assert len(shown(log)) == 1 and "no zero" in shown(log)[0]
    panel.search.clear()
    assert len(shown(log)) == 4 == len(log.toPlainText().splitlines())
    panel.close()


def test_the_oldest_lines_of_a_full_log_go_while_it_is_filtered(qapp: QApplication) -> None:
    log = EventLog()
    for number in range(MAX_LINES + 10):
        log.add("rig" if number % 2 else "stop", f"event {number}")
    log.show_only("stop", "")
    log.add("stop", "the newest")
    assert len(shown(log)) == MAX_LINES // 2 and "the newest" in shown(log)[-1]
    assert all("rig" not in line for line in shown(log))
