"""What the window remembers, and what becomes of a damaged file; menus, help and crash reports."""

from __future__ import annotations

import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from PySide6.QtCore import QMargins, QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLineEdit

from gui.shell.help_page import CrashReporter
from gui.shell.main_window import LEFT_PX, MainWindow
from gui.shell.user_settings import MAX_RECENT, UserSettings, WindowMemory
from gui.widgets.labels import WrappedLabel
from gui.widgets.theme import ThemeChoice
from rigctl.config import resources
from tests.gui.fake_engine import FakeEngine
from tests.gui.steps import Harness, SharedWindow, own_window, wait_until

WindowMaker = Callable[[], MainWindow]


LAYOUT_PASSES = 5
PANEL_PX = 345


@pytest.fixture
def ini(tmp_path: Path) -> Path:
    """Return the file of the settings."""
    return tmp_path / "window.ini"


@pytest.fixture
def open_window(qapp: QApplication, engine: FakeEngine, ini: Path) -> Iterator[WindowMaker]:
    """Yield a function that opens a window with the settings in the file."""
    with ExitStack() as opened:

        def make() -> MainWindow:
            window = opened.enter_context(own_window(engine, UserSettings(ini)))
            window.show()
            return window

        yield make


def test_layout_and_folder_return_after_a_crash(open_window: WindowMaker) -> None:
    window = open_window()
    window.docks.docks["finger"].close()
    window.docks.addDockWidget(
        Qt.DockWidgetArea.RightDockWidgetArea, window.docks.docks["protocol"]
    )
    window.protocol_panel.out.setText("/data/sessions")
    window.operate_panel.record_box.folder.setText("/data/by-hand")
    window.live_page.save_strip.folder.setText("/data/pictures")
    window.finger_tab.setup.out.setText("/data/scans")
    window.operate_panel.force.setValue(750)
    window.memory.save()  # the timer does it; the window is never closed
    again = open_window()
    assert again.docks.docks["finger"].isHidden()
    area = again.docks.dockWidgetArea(again.docks.docks["protocol"])
    assert area is Qt.DockWidgetArea.RightDockWidgetArea
    assert again.operate_panel.force.value() == 750
    assert again.protocol_panel.out.text() == "/data/sessions"
    assert again.operate_panel.record_box.folder.text() == "/data/by-hand"
    assert again.live_page.save_strip.folder.text() == "/data/pictures"
    assert again.finger_tab.setup.out.text() == "/data/scans"


def test_own_protocols_stay_in_the_list_as_long_as_they_exist(
    open_window: WindowMaker, tmp_path: Path
) -> None:
    window = open_window()
    mine, gone = tmp_path / "mine.toml", tmp_path / "gone.toml"
    for file in (mine, gone):
        shutil.copyfile(resources.protocols() / "quick.toml", file)
        window.protocol_panel.add_protocol(str(file))
    scans = tmp_path / "scans.toml"
    shutil.copyfile(resources.finger_protocols() / "quick.toml", scans)
    window.finger_tab.setup.add_protocol(str(scans))
    window.memory.save()
    gone.unlink()
    again = open_window()
    assert again.protocol_panel.protocol.findData(str(mine)) >= 0
    assert again.protocol_panel.protocol.findData(str(gone)) < 0
    assert again.protocol_panel.protocol.currentText() == "quick", "nothing else is chosen"
    assert again.finger_tab.setup.protocol.findData(str(scans)) >= 0
    again.memory.save()
    assert open_window().protocol_panel.protocol.findData(str(mine)) >= 0


def test_closed_panel_comes_back(open_window: WindowMaker) -> None:
    window = open_window()
    window.docks.docks["finger"].close()
    window.activateWindow()
    wait_until(window.isActiveWindow)
    QTest.keyClick(window, Qt.Key.Key_4, Qt.KeyboardModifier.ControlModifier)
    assert window.docks.docks["finger"].isVisible()
    window.docks.docks["operate"].setFloating(True)
    window.docks.reset()
    assert not window.docks.docks["operate"].isFloating()


@pytest.mark.parametrize("garbage", [b"\x00\xff\x13[garbage", b"[General]\ndocks=12\nwindow=x\n"])
def test_garbage_in_the_settings_is_reported_once(
    open_window: WindowMaker, ini: Path, garbage: bytes
) -> None:
    ini.write_bytes(garbage)
    window = open_window()
    assert "damaged" in window.event_log.toPlainText()
    window.memory.save()
    assert "damaged" not in open_window().event_log.toPlainText()


def test_two_windows_keep_each_what_was_changed_in_it(shared: SharedWindow, ini: Path) -> None:
    window = shared.window
    fields = [{key: QLineEdit(key) for key in ("save_in", "record_in")} for _ in range(2)]
    settings = [UserSettings(ini) for _ in range(2)]
    memories = [WindowMemory(each, window, window.docks) for each in settings]
    for memory, texts in zip(memories, fields, strict=True):
        memory.keep_texts(texts)
    fields[0]["save_in"].setText("/data/one")
    fields[1]["record_in"].setText("/data/two")
    for memory in (*memories, *memories):
        memory.save()
    settings[0].add_recent("sessions", "/s/one")
    settings[0].write()
    settings[1].add_recent("sessions", "/s/two")
    settings[1].write()
    again = UserSettings(ini)
    assert again.value("save_in", "") == "/data/one"
    assert again.value("record_in", "") == "/data/two"
    assert again.recent("sessions") == ["/s/two", "/s/one"]


def test_settings_keep_types_and_recent_texts(ini: Path) -> None:
    settings = UserSettings(ini)
    settings.set_value("span_s", 5)
    for number in range(MAX_RECENT + 2):
        settings.add_recent("rigs", f"rig-{number}")
    settings.add_recent("rigs", "rig-5")
    settings.write()
    again = UserSettings(ini)
    assert again.value("span_s", 10) == 5
    assert again.value("span_s", "x") == "x"
    assert "'span_s' is damaged" in again.complaint()
    assert not again.complaint()
    assert again.recent("rigs")[:2] == ["rig-5", "rig-9"]
    assert len(again.recent("rigs")) == MAX_RECENT


def test_sheet_lists_every_action_with_its_keys(harness: Harness) -> None:
    window = harness.window
    window.activateWindow()
    wait_until(window.isActiveWindow)
    QTest.keyClick(window, Qt.Key.Key_F1)
    wait_until(window.help.isVisible)
    text = window.help.text.toPlainText()
    for words in ("Ctrl+Q", "Esc", "Approach", "Text size", "Ctrl+O"):
        assert words in text
    window.help.back.click()
    assert window.stack.currentWidget() is not window.help


def test_menu_works_a_button_of_the_rig(harness: Harness) -> None:
    rows = {row.text: row.menu for row in harness.window.menus.rows()}
    assert {"File", "Rig", "View", "Help"} <= {menu.partition(" ")[0] for menu in rows.values()}
    assert rows["Tare"] == "Rig"


def test_texts_scale(harness: Harness) -> None:
    """The widest box of the panel is that of a simulated bench."""
    window, usual = harness.window, QApplication.font().pointSizeF()
    harness.update()
    height, before = window.toolbar.state.sizeHint().height(), window.size()
    window.resize(1024, 700)
    # A width of the user's own: one that a test before asked for, and got less, would come back.
    window.docks.resizeDocks([window.docks.docks["operate"]], [PANEL_PX], Qt.Orientation.Horizontal)
    for _ in range(LAYOUT_PASSES):
        QApplication.processEvents()
    widths_px = window.docks.side_widths_px()
    assert widths_px == {"operate": PANEL_PX}
    try:
        window.set_text_size(150)
        for _ in range(LAYOUT_PASSES):
            QApplication.processEvents()  # the panels grow with what is in them
        assert QApplication.font().pointSizeF() == pytest.approx(1.5 * usual)
        assert window.toolbar.state.sizeHint().height() > height
        stop = window.toolbar.stop_button
        assert window.rect().contains(stop.mapTo(window, stop.rect().bottomRight()))
    finally:
        window.set_text_size(100)
    for _ in range(LAYOUT_PASSES):
        QApplication.processEvents()
    assert QApplication.font().pointSizeF() == pytest.approx(usual)
    after_px = window.docks.side_widths_px()
    window.resize(before)
    assert after_px == pytest.approx(widths_px, abs=2)


def test_larger_texts_and_back_leave_no_gap(disconnected: SharedWindow) -> None:
    window = disconnected.window

    def places() -> dict[str, tuple[int, ...]]:
        for panel in ("finger", "analysis", "protocol", "operate"):
            window.show_panel(panel)
            for _ in range(LAYOUT_PASSES):
                QApplication.processEvents()
        parts = (window.toolbar, window.health, window.docks, window.live_page)
        labels = window.operate_panel.findChildren(WrappedLabel)
        return {
            f"{number} {type(part).__name__}": (part.mapTo(window, QPoint()).y(), part.height())
            for number, part in enumerate((*parts, *labels))
        }

    before = places()
    window.set_text_size(150)
    assert places() != before
    window.set_text_size(100)
    assert places() == before


def test_a_layout_with_floating_panels_is_reset_after_a_restart(
    open_window: WindowMaker,
) -> None:
    first = open_window()
    first.show_panel("protocol")
    first.docks.docks["operate"].setFloating(True)
    first.close()
    again = open_window()
    dock = again.docks.docks["operate"]
    assert dock.isFloating()
    assert dock.windowHandle().transientParent() is again.windowHandle(), "before the window"
    again.docks.reset()
    QApplication.processEvents()
    assert not any(each.isFloating() for each in again.docks.docks.values())
    assert again.docks.side_widths_px() == pytest.approx({"operate": LEFT_PX}, abs=20)
    again.resize(1280, 800)
    again.set_text_size(150)
    again.docks.reset()
    QApplication.processEvents()
    assert again.docks.side_widths_px() == pytest.approx({"operate": 1.5 * LEFT_PX}, abs=30)
    again.set_text_size(100)


def test_a_window_whose_frame_hangs_off_the_screen_comes_onto_it(
    qapp: QApplication, monkeypatch: pytest.MonkeyPatch
) -> None:
    window = MainWindow(choice=ThemeChoice.LIGHT)
    room = window.screen().availableGeometry()
    window.resize(room.size())
    window.move(room.topLeft())
    window.show()
    title = QMargins(1, 30, 1, 1)
    monkeypatch.setattr(window, "frameGeometry", lambda: window.geometry() + title)
    assert not room.contains(window.frameGeometry())
    window.fit_screen()
    assert window.frameGeometry().size().height() <= room.height()
    window.close()
    window.deleteLater()


def test_a_crash_of_native_code_is_reported_by_the_next_window(
    qapp: QApplication, tmp_path: Path
) -> None:
    program = (
        "import faulthandler, sys\n"
        "from pathlib import Path\n"
        "from gui.shell.help_page import CrashReporter\n"
        "reporter = CrashReporter(Path(sys.argv[1]), str)\n"
        "reporter.follow_native_code()\n"
        "faulthandler._sigsegv()\n"
    )
    died = subprocess.run([sys.executable, "-c", program, str(tmp_path)], stderr=subprocess.PIPE)
    assert died.returncode and not died.stderr
    program = program.replace("faulthandler._sigsegv()\n", "")
    program = program.replace(
        "reporter.follow", "reporter.reported.connect(print)\nreporter.follow"
    )
    words = [sys.executable, "-c", program, str(tmp_path)]
    first, second = (subprocess.check_output(words, text=True) for _ in range(2))
    (report,) = tmp_path.glob("rigctl-crash-*.txt")
    assert (
        f"a window before this one failed; please send its report to who looks after it: {report}"
        in first
    )
    assert "Segmentation fault" in report.read_text() and not second


def test_unexpected_error_becomes_a_sentence_and_a_file(harness: Harness, tmp_path: Path) -> None:
    window = harness.window
    reporter = CrashReporter(tmp_path / "reports", window.event_log.toPlainText)
    reporter.reported.connect(window.report)
    for number in (1, 1, 2):
        error = ZeroDivisionError(f"number {number}")
        reporter.take(ZeroDivisionError, error, None)
    files = sorted((tmp_path / "reports").iterdir())
    assert len(files) == 2
    text = files[0].read_text(encoding="utf-8")
    assert "number 1" in text
    assert "rigctl" in text
    assert "connected" in text
    assert str(files[0]) in window.event_log.toPlainText()
    assert "Traceback" not in window.event_log.toPlainText()


def test_error_of_a_thread_reaches_the_window(harness: Harness, tmp_path: Path) -> None:
    window = harness.window
    reporter = CrashReporter(tmp_path, window.event_log.toPlainText)
    reporter.reported.connect(window.report)
    reporter.install()
    try:
        thread = threading.Thread(target=lambda: {}["missing"])
        thread.start()
        thread.join()
        wait_until(lambda: "something in the window failed" in window.event_log.toPlainText())
    finally:
        reporter.remove()
