"""Plots of a lab's own: curves that a Python file makes of the samples as they come."""

from __future__ import annotations

import re
import sys
from html import escape
from pathlib import Path

import msgspec
import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QElapsedTimer, QFileSystemWatcher, QProcess, Qt, QTimer, Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from gui.live.plot_process import CALL_S, FORM, LOAD_S, SHOWN, Answer
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import container, hbox, push_button, vbox
from gui.widgets.plot_axes import (
    BOTTOM_PX,
    Plot,
    PlotGrid,
    label_axis,
    time_plot,
    time_ticks,
    title_plot,
)
from gui.widgets.theme import Theme
from gui.widgets.typed_paths import typed_path
from rigctl.values import SAMPLE_RATE_HZ

SETTLED_MS = 200  # an editor writes a file in several steps
SLOW_MS = 1000
NO_FILE = f"Choose a Python file: {FORM}."
NO_RIG = "No rig is connected."
_LINES = (
    (Qt.PenStyle.SolidLine, "━━"),
    (Qt.PenStyle.DashLine, "╍╍"),
    (Qt.PenStyle.DotLine, "┈┈"),
    (Qt.PenStyle.DashDotLine, "━┈"),
)
_LEAST_PLOT_PX = 90


class CurvePlots(PlotGrid):
    """One plot for each unit over the last seconds; colour and line tell its curves apart."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.theme = theme
        self.units: dict[str, str] = {}
        self.values: dict[str, np.ndarray] = {}
        self.plots: dict[str, Plot] = {}
        self._time_s = np.zeros(0)
        self.lines: dict[str, pg.PlotDataItem] = {}
        self.set_theme(theme)

    def show_units(self, units: dict[str, str]) -> None:
        """Begin anew with these curves, by name, and their units."""
        self.cells.clear()
        self.units, self._time_s = units, np.zeros(0)
        self.values = {name: np.zeros(0) for name in units}
        kinds = list(dict.fromkeys(units.values()))
        self.plots = {
            unit: time_plot(self.cells, row, escape(unit[:24]), last=unit == kinds[-1])
            for row, unit in enumerate(kinds)
        }
        self.lines = {name: pg.PlotDataItem(connect="finite") for name in units}
        for name, line in self.lines.items():
            self.plots[units[name]].addItem(line)
        for plot in self.plots.values():
            plot.setXRange(-SHOWN / SAMPLE_RATE_HZ, 0, padding=0)
            plot.getAxis("bottom").setTicks([time_ticks(-SHOWN / SAMPLE_RATE_HZ, 0)])
        self.reserve_plots(0, *[_LEAST_PLOT_PX] * (len(kinds) - 1), _LEAST_PLOT_PX + BOTTOM_PX)
        self.cells.setGeometry(self.graphics.range)  # an empty one has shrunk
        self.set_theme(self.theme)

    def add(self, answer: Answer) -> None:
        """Draw new samples."""
        self._time_s = np.append(self._time_s, answer.time_s)[-SHOWN:]
        for name, curve in answer.curves.items():
            values = np.append(self.values[name], np.array(curve.values, float))[-SHOWN:]
            self.values[name] = values
            self.lines[name].setData(self._time_s - self._time_s[-1], values)
        for unit, plot in self.plots.items():
            shown = [self.values[name] for name in self.units if self.units[name] == unit]
            finite = np.concatenate(shown)[np.isfinite(np.concatenate(shown))]
            if finite.size:
                is_flat = finite.min() == finite.max()
                plot.setYRange(finite.min(), finite.max() + is_flat)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme and the size of the texts."""
        self.theme = theme
        self.colour(theme, *self.plots.values())
        for unit, plot in self.plots.items():
            label_axis(plot, "left", escape(unit[:24]), theme)
            names = [name for name in self.units if self.units[name] == unit]
            texts = []
            for n, name in enumerate(names):
                colour = theme.groups[n % len(theme.groups)]
                style, sign = _LINES[(n + n // len(theme.groups)) % len(_LINES)]
                self.lines[name].setPen(pg.mkPen(colour, width=1, style=style))
                self.lines[name].setDownsampling(auto=True, method="peak")
                texts.append(f'<span style="color: {colour}">{sign} {escape(name[:24])}</span>')
            title_plot(plot, " &nbsp; ".join(texts), theme.text)


class OwnPlots(QWidget):
    """The page: its file, what is wrong with it, and the plots.

    The file runs in a process of its own, which is asked for curves once a frame while the page is
    shown and the last answer is there. Nothing here waits for it.
    """

    path_requested = Signal(object, object)
    changed = Signal()
    """The user wants to see this page, or the live views again."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.is_wanted = False
        self.file = QLineEdit(placeholderText="Python file")
        self.file.setAccessibleName("Python file of own plots")
        self.text = label(NO_FILE, "muted", wraps=True)
        self.plots = CurvePlots(theme)
        self._live, self._path = "", Path()
        self._process: QProcess | None = None
        self._since_request, self._said = QElapsedTimer(), ""
        self._stamp = (0, 0)
        self._watcher = QFileSystemWatcher()
        self._settled = QTimer(self, interval=SETTLED_MS, singleShot=True)
        self._settled.timeout.connect(self._look)
        for changes in (self._watcher.fileChanged, self._watcher.directoryChanged):
            changes.connect(lambda _: self._settled.start())
        self.file.editingFinished.connect(self._take_file)
        browse = browse_button(self.path_requested, PathKind.PLOTS, self.choose)
        self.reload = push_button("Load again", self.restart, "As saving the file does")
        self.back = push_button("Live views", lambda: self.show_page(False))
        row = container(hbox(self.file, browse, self.reload, self.back, wide=0, spacing=4))
        self.setLayout(vbox(row, self.text, self.plots, spacing=4, margins=(6, 0, 6, 0), tall=2))

    def choose(self, path: str) -> None:
        """Show the curves of a file."""
        self.file.setText(path)
        self.show_page(True)

    def show_page(self, is_wanted: bool) -> None:
        """Show this page, or the live views."""
        self.is_wanted = is_wanted
        self.restart()
        self.changed.emit()

    def follow(self, live: str) -> None:
        """Take the live data of an engine, by their path; empty for none."""
        if live != self._live:
            self._live = live
            self.restart()

    def poll(self) -> None:
        """Ask for the next curves if the last ones are there; once a frame."""
        if self._process is None or not self.isVisible():
            return
        if not self._since_request.isValid():
            self._since_request.start()
            self._process.write(b"\n")
        elif self._since_request.hasExpired(SLOW_MS):
            waited_s = self._since_request.elapsed() // 1000
            self._say(f"{self._path.name}: no curves for {waited_s} s …", "muted")

    def restart(self) -> None:
        """Load the file in a new process, if it is wanted and a rig is connected."""
        self.close_process()
        self._path = typed_path(self.file.text())
        if not self.is_wanted or not self.file.text().strip():
            self._say(NO_FILE, "muted")
            return
        self._stamp = self._read_stamp()
        if watched := [*self._watcher.files(), *self._watcher.directories()]:
            self._watcher.removePaths(watched)
        self._watcher.addPaths([str(self._path), str(self._path.parent)])
        if not self._live:
            self._say(NO_RIG, "muted")
            return
        self.plots.show_units({})
        self._said = ""
        self._since_request.invalidate()
        process = self._process = QProcess(self)
        process.setProcessChannelMode(QProcess.ProcessChannelMode.ForwardedErrorChannel)
        process.readyReadStandardOutput.connect(self._read)
        process.finished.connect(self._finish)
        words = ["-m", "gui.live.plot_process", str(self._path), self._live]
        process.start(sys.executable, words)

    def close_process(self, wait_ms: int = 0) -> None:
        """End the process; only a window that closes waits for that, for milliseconds."""
        process, self._process = self._process, None
        if process is not None:
            process.readyReadStandardOutput.disconnect(self._read)
            process.finished.disconnect(self._finish)
            process.finished.connect(process.deleteLater)
            process.kill()
            if wait_ms:
                process.waitForFinished(wait_ms)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.plots.set_theme(theme)

    def _take_file(self) -> None:
        if self.is_wanted and typed_path(self.file.text()) != self._path:
            self.restart()

    def _look(self) -> None:
        """Load a file that was saved anew, also one that an editor has replaced."""
        if self._read_stamp() != self._stamp:
            self.restart()

    def _read_stamp(self) -> tuple[int, int]:
        try:
            found = self._path.stat()
        except (OSError, ValueError):
            return (0, 0)
        return (found.st_mtime_ns, found.st_ino)

    def _read(self) -> None:
        process = self._process
        while process is not None and process is self._process and process.canReadLine():
            line = bytes(process.readLine().data())
            if line.startswith(b"{"):
                self._take(msgspec.json.decode(line, type=Answer))
            else:
                self._said += line.decode(errors="replace")

    def _take(self, answer: Answer) -> None:
        self._since_request.invalidate()
        if answer.failure:
            self._fail(answer.failure)
            return
        self._say(f"{self._path.name}: curves of the samples that come", "muted")
        units = {name: curve.unit for name, curve in answer.curves.items()}
        if answer.time_s:
            if units != self.plots.units:
                self.plots.show_units(units)
            self.plots.add(answer)

    def _finish(self, code: int) -> None:
        """Say why the process has ended by itself: it took too long, or something killed it."""
        self._read()
        if self._process is None:  # it has told what is wrong
            return
        own = rf'File "{re.escape(str(self._path))}", line (\d+)'
        place = re.search(own, self._said)
        name = f"{self._path.name}, line {place[1]}" if place else self._path.name
        late = f"no answer within {CALL_S:g} s, or {LOAD_S:g} s for loading"
        why = late if "Timeout" in self._said else f"its process ended (code {code})"
        self._fail(f"{name}: {why}. Correct the file and save it")

    def _fail(self, sentence: str) -> None:
        self.close_process()
        self._say(sentence, "bad")

    def _say(self, text: str, role: str) -> None:
        show_text(self.text, text)
        set_property(self.text, "role", role)
