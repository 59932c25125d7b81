"""What the window is for, panel by panel, and three ways to begin."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFormLayout, QWidget

from gui.start.sample_box import SampleBox
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import label
from gui.widgets.layouts import container, form_layout, push_button, scroll_area, vbox

PANELS = {
    "Operate": "Connect a rig, then move the drum by hand at a speed (mm/s) and a force (g).",
    "Protocol": "Choose or write a protocol, see how long it takes, run it into a session.",
    "Analysis": "Open sessions: look at their trials, compare conditions, classify textures.",
    "Finger": "Slide the sensor over a plate, and see the texture named while it moves.",
    "Replay": "In the menu File: play recorded trials in the live views, at any speed.",
    "Calibrate": "In the menu Tools: load cell, force loop, imbalance and order of the taxels.",
    "Tools": "In the menu: accept a rig by its acceptance session, list the serial ports.",
}
SAMPLE = "Open the sample session"
SAMPLE_TIP = "Needs no hardware: a simulated recording to look at, made the first time"
HINT = (
    "The virtual rig simulates drum, sensor and plates. The sample session is a recording of "
    "32 trials at such a bench, made once and kept. Neither needs hardware."
)


class StartPage(QWidget):
    """Stands in the middle of a window that was never used before."""

    virtual_requested = Signal()
    sample_requested = Signal()
    session_requested = Signal()
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.virtual = push_button(
            "Start the virtual rig", self.virtual_requested.emit, "Needs no hardware"
        )
        self.sample = push_button(SAMPLE, self.sample_requested.emit, SAMPLE_TIP)
        self.session = push_button(
            "Open a session …", self.session_requested.emit, "Choose the folder of a recording"
        )
        self.back = push_button("Close", self.closed.emit, "Help → Start page shows it again")
        self.sample_box = SampleBox()
        title, hint = label("Welcome to rigctl", "state"), label(HINT, "muted", wraps=True)
        buttons = FlowLayout(self.virtual, self.sample, self.session, self.back)
        rows = (title, _panel_lines(), hint, buttons, self.sample_box)
        column = vbox(*rows, spacing=14, margins=(18, 14, 18, 14))
        column.addStretch(1)
        self.setLayout(vbox(scroll_area(container(column))))


def _panel_lines() -> QFormLayout:
    form = form_layout(10)
    for name, purpose in PANELS.items():
        form.addRow(label(name, "heading"), label(purpose, wraps=True))
    return form
