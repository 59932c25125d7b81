"""The queue of a virtual rig goes on while no window is open, and a window that joins shows it."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from rigctl.engine.rpc.client import find_engines
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from rigctl.session.session import Session
from tests.gui.rig_window import TIMEOUT_MS, RigWindow, opened_window
from tests.gui.steps import click, wait_until

SHORT = """
name = "short"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [500]
[trial]
travel_mm = 12
"""


def _queue(rig: RigWindow, folder: Path, *names: str) -> None:
    panel = rig.window.protocol_panel
    rig.window.show_panel("protocol")
    panel.out.setText(str(folder))
    for name in names:
        path = folder / f"{name}.toml"
        path.write_text(SHORT)
        panel.add_protocol(str(path))
        rig.until(panel.queue.add_button.isEnabled)
        before = panel.queue.list.count()
        click(panel.queue.add_button)
        rig.until(lambda before=before: panel.queue.list.count() == before + 1)


def _texts(rig: RigWindow) -> list[str]:
    shown = rig.window.protocol_panel.queue.list
    return [shown.item(row).text().partition(":")[0] for row in range(shown.count())]


def test_a_queue_outlives_its_window(
    qapp: QApplication, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    with opened_window() as rig:
        rig.connect("virtual")
        rig.bring_up()
        _queue(rig, tmp_path, "first", "last", "second")
        queue = rig.window.protocol_panel.queue
        queue.list.setCurrentRow(2)
        click(queue.up_button)
        rig.until(lambda: _texts(rig)[1] == "2. second, seed 0")
        assert "Start next" in queue.waits_for.text()
        click(queue.next_button)
        rig.confirm()
        rig.window.engine_link.close()
        assert "the engine goes on with its queue: second, last" in rig.log
    (found,) = find_engines()
    assert "2 in the queue" in found.describe()
    with opened_window() as rig:
        rig.window.join_engine(found.engine)
        rig.until(
            lambda: rig.window.prompt_panel.isVisible() and _texts(rig) == ["1. last, seed 0"]
        )
        assert "waits for an answer" in rig.window.protocol_panel.queue.waits_for.text()
        rig.confirm()
        rig.until(lambda: rig.window.prompt_panel.isVisible() and _texts(rig) == [])
        rig.confirm()
        rig.until(lambda: rig.status.run.state == "done" and "last-" in str(rig.status.run.session))
    for name in ("first", "second", "last"):
        (folder,) = (path for path in tmp_path.glob(f"{name}-*") if path.is_dir())
        with Session.open(folder) as session:
            assert len(session.committed()) == 1
    wait_until(lambda: find_engines() == [], TIMEOUT_MS)
