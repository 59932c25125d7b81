"""Sessions and settings that are damaged or newer, and disks that take nothing more."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import pytest
from PySide6.QtWidgets import QApplication, QLabel

from gui.shell.user_settings import UserSettings
from tests.analysis.recordings import record
from tests.gui.fake_engine import FakeEngine
from tests.gui.full_disk import full_disk
from tests.gui.steps import Harness, click, own_window, wait_until
from tests.session.damage import record_four_parts, zero

pytestmark = pytest.mark.usefixtures("leave_nothing")


def _newer(folder: Path) -> None:
    for path in folder.glob("part-*.h5"):
        with h5py.File(path, "r+") as file:
            file.attrs["layout_version"] = 99


def _all_zero(folder: Path) -> None:
    for path in folder.glob("part-*.h5"):
        zero(path)


def _no_parts(folder: Path) -> None:
    for path in folder.glob("part-*.h5"):
        path.unlink()


DAMAGES: list[tuple[Callable[[Path], None], str]] = [
    (_newer, "layout version 99, this program reads"),
    (_all_zero, "is damaged"),
    (_no_parts, "session"),
]


def _open_in_analysis(harness: Harness, folder: Path) -> QLabel:
    tab = harness.window.analysis_tab
    harness.window.show_panel("analysis")
    tab.panel.folder.setText(str(folder))
    click(tab.panel.open_button)
    wait_until(lambda: not tab.reader.is_busy)
    return tab.panel.about


def _open_in_replay(harness: Harness, folder: Path) -> QLabel:
    page = harness.window.replay.page
    harness.window.replay.show()
    page.session.setText(str(folder))
    page.session.returnPressed.emit()
    wait_until(lambda: not page.worker.is_busy)
    harness.window.replay.hide()
    return page.sentence


@pytest.mark.parametrize("open_page", [_open_in_analysis, _open_in_replay])
@pytest.mark.parametrize(("damage", "sentence"), DAMAGES)
def test_a_session_that_cannot_be_read_is_named(
    harness: Harness,
    tmp_path: Path,
    open_page: Callable[[Harness, Path], QLabel],
    damage: Callable[[Path], None],
    sentence: str,
) -> None:
    folder = tmp_path / "lab-session"
    record_four_parts(folder)
    damage(folder)
    shown = open_page(harness, folder)
    assert sentence in shown.text() and "lab-session" in shown.text()
    assert "Traceback" not in shown.text() + harness.window.event_log.toPlainText()


def test_a_newer_session_says_which_program_reads_it(harness: Harness, tmp_path: Path) -> None:
    folder = tmp_path / "s"
    record_four_parts(folder)
    _newer(folder)
    assert "use the rigctl that recorded it" in _open_in_analysis(harness, folder).text()


@pytest.mark.parametrize("method", [0, 1])
@pytest.mark.parametrize("textures", ["A", "AB"])
def test_an_analysis_of_too_few_trials_says_what_it_needs(
    harness: Harness, tmp_path: Path, textures: str, method: int
) -> None:
    folder, tab = tmp_path / "few", harness.window.analysis_tab
    record(folder, textures, speeds=(80,), forces=(500,))
    _open_in_analysis(harness, folder)
    box = tab.panel.run_box
    box.method.setCurrentIndex(method)
    click(box.run_button)
    wait_until(lambda: not tab.worker.is_busy and box.run_button.isEnabled())
    assert any(words in box.result.text() for words in ("needs", "too few", "record at least"))
    assert box.result.property("role") == "bad"
    assert "Traceback" not in box.result.text() + harness.window.event_log.toPlainText()
    box.method.setCurrentIndex(0)


@pytest.mark.parametrize("kind", ["picture", "table"])
def test_a_picture_or_table_without_room_says_so_and_leaves_no_half(
    harness: Harness, tmp_path: Path, kind: str
) -> None:
    window, strip = harness.window, harness.window.live_page.save_strip
    folder, before = tmp_path / "pictures", harness.window.live_page.save_strip.folder.text()
    harness.engine.write_samples(3000)
    harness.window.live_page.refresh(harness.engine.live)
    strip.folder.setText(str(folder))
    with full_disk(512):
        click(strip.picture if kind == "picture" else strip.table)
        wait_until(lambda: "nothing was saved" in window.event_log.toPlainText())
    strip.folder.setText(before)
    assert "free some space" in window.status_line.text()
    assert str(folder) in window.event_log.toPlainText()
    assert list(folder.iterdir()) == []


def test_a_table_of_no_samples_is_not_saved(harness: Harness, tmp_path: Path) -> None:
    window, folder = harness.window, harness.window.live_page.save_strip.folder
    before = folder.text()
    folder.setText(str(tmp_path / "tables"))
    window.live_page.save_strip.table_requested.emit()
    folder.setText(before)
    assert "there are no samples in view yet" in window.event_log.toPlainText()
    assert not (tmp_path / "tables").exists()


@pytest.mark.parametrize(
    "garbage", [b"\xff\xfe\x00", b"[General]\nlayout=@ByteArray(\x01\x02)\n" * 500, b"=\n[[[\n%%%"]
)
def test_garbage_in_the_settings_opens_the_window_with_its_defaults(
    qapp: QApplication, engine: FakeEngine, tmp_path: Path, garbage: bytes
) -> None:
    path = tmp_path / "window.ini"
    path.write_bytes(garbage)
    with own_window(engine, UserSettings(path)) as window:
        window.show()
        qapp.processEvents()
        assert window.isVisible() and "Traceback" not in window.event_log.toPlainText()
        window.memory.save()
