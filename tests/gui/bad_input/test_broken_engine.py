"""A full disk in the engine, and firmware that speaks another register map."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.gui.bad_input.test_unplugged import LONG
from tests.gui.rig_window import RigWindow, opened_window
from tests.gui.steps import click, wait_until

BROKEN = Path(__file__).parent / "broken_engine"


@pytest.fixture
def fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file that names the fault of the engines that start now."""
    path = tmp_path / "fault"
    path.write_text("")
    monkeypatch.setenv("RIGCTL_TEST_FAULT", str(path))
    monkeypatch.setenv("PYTHONPATH", f"{BROKEN}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    return path


@pytest.fixture
def broken(qapp: QApplication, fault: Path) -> Iterator[RigWindow]:
    """Yield a small window without a rig; its engine will have the fault."""
    assert qapp is QApplication.instance() and fault.exists()
    with opened_window() as opened:
        yield opened


def test_a_full_disk_ends_a_run_and_keeps_its_trials(
    broken: RigWindow, fault: Path, tmp_path: Path
) -> None:
    protocol, strip = tmp_path / "long.toml", broken.window.drum.alarms.strip
    protocol.write_text(LONG)
    broken.connect("virtual")
    broken.start(protocol, tmp_path / "out")
    broken.until(lambda: broken.status.run.trials_committed == 2)
    fault.write_text("full disk")
    broken.until(lambda: strip.isVisible() and strip.title.text() == "RUN FAILED")
    assert "disk is full: make room" in strip.text.text()
    assert "is kept" in strip.text.text() and "Continue a session" in strip.text.text()
    assert "Traceback" not in broken.log
    fault.write_text("")
    folder = Path(broken.status.run.session)
    with Session.open(folder) as session:
        assert len(session.committed()) >= 2
    problems = verify(folder).problems
    assert all("not closed" in problem or "ended" in problem for problem in problems), problems


def test_a_full_disk_ends_a_recording_by_hand(
    broken: RigWindow, fault: Path, tmp_path: Path
) -> None:
    box = broken.window.operate_panel.record_box
    broken.connect("virtual")
    box.folder.setText(str(tmp_path / "out"))
    click(box.button)
    broken.until(lambda: broken.status.recording.samples_on_disk > 500)
    fault.write_text("full disk")
    broken.until(lambda: box.button.text() == "Record")
    assert "disk is full" in broken.log and "Traceback" not in broken.log
    fault.write_text("")
    (folder,) = (tmp_path / "out").iterdir()
    with Session.open(folder) as session:
        assert session.parts


def test_other_firmware_is_named_with_its_cure(broken: RigWindow, fault: Path) -> None:
    fault.write_text("other firmware")
    window = broken.window
    window.toolbar.rig.choose("virtual")
    click(window.toolbar.connect_button)
    wait_until(lambda: "register map" in broken.log, 60_000)
    assert "`rigctl flash drum`" in window.status_line.text()
    assert window.status_line.text() in window.status_line.toolTip()
    assert "drum board's firmware" in window.toolbar.state_words.toolTip()
    assert window.toolbar.connect_button.text() == "Connect"
    assert "Traceback" not in broken.log
