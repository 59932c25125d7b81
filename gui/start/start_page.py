"""What the window is for, panel by panel, and two ways to begin."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFormLayout, QWidget

from gui.widgets.labels import label
from gui.widgets.layouts import container, form_layout, hbox, push_button, scroll_area, vbox

PANELS = {
    "Operate": "Move the drum by hand: arm, tare, approach, speed (mm/s) and force (g). "
    "Connect a rig first.",
    "Protocol": "Choose a protocol, see how long it takes, run it, and record a session.",
    "Analysis": "Open a session: look at its trials, encode them as spikes, name textures.",
    "Finger": "Slide the sensor over a plate, and see the texture named while it moves.",
    "Tools": "In the menu: accept a rig by its acceptance session, list the serial ports.",
}


class StartPage(QWidget):
    """Stands in the middle of a window that was never used before."""

    virtual_requested = Signal()
    session_requested = Signal()
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.virtual = push_button(
            "Start the virtual rig", self.virtual_requested.emit, "Needs no hardware"
        )
        self.session = push_button(
            "Open a session …", self.session_requested.emit, "Choose the folder of a recording"
        )
        self.back = push_button("Close", self.closed.emit, "Help → Start page shows it again")
        buttons = hbox(self.virtual, self.session, self.back, label(), wide=3, spacing=8)
        hint = label("The virtual rig simulates drum, sensor and plates.", "muted", wraps=True)
        title = label("Welcome to rigctl", "state")
        column = vbox(title, _panel_lines(), hint, buttons, spacing=14, margins=(18, 14, 18, 14))
        column.addStretch(1)
        self.setLayout(vbox(scroll_area(container(column))))


def _panel_lines() -> QFormLayout:
    form = form_layout(10)
    for name, purpose in PANELS.items():
        form.addRow(label(name, "heading"), label(purpose, wraps=True))
    return form
