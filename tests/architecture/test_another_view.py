"""Worked example: a live view is a module of its own and its line among the live plots."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.architecture.lab_copy import changed_files, copy_program, run_in

LINE = "        self.add_view(self.heat_map, row=0, rowspan=3)\n"
EDITS = {
    "gui/live/layer_means.py": {
        "": '''"""The mean reading of each layer, as a line of text."""

from PySide6.QtGui import QColor
from PySide6.QtWidgets import QGraphicsWidget


class LayerMeans(QGraphicsWidget):
    """Mean of the newest 100 samples of each layer in counts."""

    def __init__(self, theme, layout):
        super().__init__()
        self.setMinimumHeight(20)
        self.text = ""
        self.set_sensor_layout(layout)
        self.set_theme(theme)

    def set_theme(self, theme):
        self._colour = QColor(theme.text)

    def set_sensor_layout(self, layout):
        self._layout = layout

    def refresh_at(self, data, position):
        samples, layout = data.samples_before(position, 100), self._layout
        if len(samples):
            layers = (samples[:, list(layout.taxels_of(n))] for n in range(len(layout.layers)))
            self.text = " / ".join(f"{layer.mean():.0f}" for layer in layers)
        self.update()

    def paint(self, painter, *_):
        painter.setPen(self._colour)
        painter.drawText(self.rect(), self.text)
'''
    },
    "gui/live/live_plots.py": {
        LINE: f"{LINE}        self.add_view(LayerMeans(theme, self.sensor_layout), row=4)\n",
        "from gui.live.live_data import": (
            "from gui.live.layer_means import LayerMeans\nfrom gui.live.live_data import"
        ),
    },
}
SHOW = """
import json, sys
from pathlib import Path
from PySide6.QtWidgets import QApplication
from gui.live.live_page import LivePage
from gui.widgets.theme import DARK, LIGHT
from tests.gui.fake_engine import STATUS, FakeEngine
from rigctl.engine.rpc.messages import parse_status

app = QApplication([])
engine = FakeEngine(Path(sys.argv[1]))
page = LivePage(LIGHT)
page.resize(900, 700)
page.show()
page.show_status(parse_status(STATUS))
engine.write_samples(2000)
page.refresh(engine.live)
(view,) = (v for v in page.plots.views if type(v).__name__ == "LayerMeans")
page.plots.set_theme(DARK)
page.plots.set_rates_per_mm(True)  # draws at once, not with the next tenth of a second
app.processEvents()
data = page.plots.data
upper = float(data.samples_before(data.history.newest, 100)[:, :9].mean())
print(json.dumps({"text": view.text, "height": view.rect().height(), "mean": upper}))
page.hide()
engine.close()
"""


def test_a_view_shows_the_newest_samples(tmp_path: Path) -> None:
    copy = copy_program(tmp_path, EDITS)
    assert changed_files(copy) == set(EDITS)
    shown = json.loads(run_in(copy, "-c", SHOW, str(tmp_path)))
    assert shown["height"] >= 20
    upper, lower = map(float, shown["text"].split(" / "))
    assert upper == pytest.approx(shown["mean"], abs=1) and lower > 0
