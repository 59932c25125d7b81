"""A window with a real engine of its own, and what a person does at it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest
from PySide6.QtWidgets import QApplication

from gui.operate.operate_panel import READY
from gui.shell.main_window import MainWindow
from rigctl.boards.drum_states import State
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from rigctl.engine.rpc.messages import EngineStatus
from tests.gui.steps import click, own_window, wait_until

TIMEOUT_MS = 120_000
SMALL = (1024, 700)


class RigWindow(NamedTuple):
    """A window on a rig; every action is a click, as a person's."""

    window: MainWindow

    @property
    def status(self) -> EngineStatus:
        """What the engine said last."""
        return self.window.engine_link.status

    @property
    def log(self) -> str:
        """All lines of the log."""
        return self.window.event_log.toPlainText()

    def connect(self, rig: str) -> None:
        """Choose the rig, press Connect, and wait for both boards."""
        self.window.toolbar.rig.choose(rig)
        click(self.window.toolbar.connect_button)
        self.until(lambda: self.status.drum_connected and self.status.taxels_connected)

    def until(self, done: Callable[[], bool]) -> None:
        """Wait until a condition is true; a failure shows the log."""
        try:
            wait_until(done, TIMEOUT_MS)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.log}\n{self.status}") from None

    def until_state(self, *states: State) -> None:
        """Wait until the drum is in one of the states."""
        self.until(lambda: self.status.state in states)

    def press(self, name: str) -> None:
        """Press a button of the panel Operate as soon as it is enabled."""
        self.window.show_panel("operate")
        button = self.window.operate_panel.buttons[name]
        self.until(button.isEnabled)
        click(button)

    def inject(self, fault: str) -> None:
        """Let something happen to the simulated bench."""
        bench = self.window.operate_panel.bench
        bench.fault.setCurrentText(fault)
        click(bench.inject)

    def bring_up(self) -> None:
        """Press Next until the drum can approach; clear the faults on the way."""
        self.window.show_panel("operate")
        box = self.window.operate_panel.bring_up
        clear = self.window.operate_panel.buttons["clear_fault"]
        while box.missing.text() != READY or self.status.fault:
            self.until(lambda: box.next.isEnabled() or clear.isEnabled())
            if self.status.fault:
                self.press("clear_fault")
                self.until(lambda: not self.status.fault)
            else:
                before = box.next.text()
                click(box.next)
                self.until(partial(self._has_gone_on, before))

    def start(self, protocol: Path, out: Path) -> None:
        """Choose a protocol file and a folder, press Start, and confirm the first plate."""
        panel = self.window.protocol_panel
        self.window.show_panel("protocol")
        panel.add_protocol(str(protocol))
        panel.out.setText(str(out))
        self.until(panel.buttons["Start"].isEnabled)
        click(panel.buttons["Start"])
        self.confirm()

    def confirm(self) -> None:
        """Confirm the question of a run."""
        self.until(self.window.prompt_panel.isVisible)
        click(self.window.prompt_panel.confirm)

    def _has_gone_on(self, before: str) -> bool:
        box = self.window.operate_panel.bring_up
        is_ready = box.missing.text() == READY or bool(self.status.fault)
        return box.next.text() != before or is_ready


@contextmanager
def opened_window(size: tuple[int, int] = SMALL) -> Iterator[RigWindow]:
    """Yield a window with the real engines behind; at its end it leaves them and closes."""
    with own_window() as window:
        window.resize(*size)
        window.show()
        try:
            yield RigWindow(window)
        finally:
            link = window.engine_link
            if link.is_connected and link.status.run.is_active:
                link.request("abort")
                wait_until(
                    lambda: not link.is_connected or not link.status.run.is_active, TIMEOUT_MS
                )
            window.attach.leave()


@contextmanager
def rig_window(qapp: QApplication, rig: str, runtime: Path) -> Iterator[RigWindow]:
    """Yield a window that is connected to a new engine, alone in a runtime folder."""
    assert qapp is QApplication.instance()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(runtime))
        with opened_window() as opened:
            opened.connect(rig)
            yield opened
