"""The states of the window in which its texts are measured: crowded, faulty, running, waiting."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PySide6.QtWidgets import QApplication

from gui.live.live_page import COUNTS, ENCODER, LISTEN, TRIALS, VOLTS
from gui.protocol.learning_page import NO_SESSION
from gui.protocol.protocol_panel import ProtocolPanel
from gui.shell.main_window import MainWindow
from gui.widgets.file_browser import PathKind
from rigctl.analysis.learning_curve import CurvePoint, SessionCurve, describe_shortfall
from rigctl.boards.drum_states import State
from rigctl.boards.port_discovery import PortReport
from rigctl.engine.setup.boards import CIRCUMFERENCE
from rigctl.engine.setup.setup import STEPS
from rigctl.engine.setup.switches import HOLD_LOWER
from rigctl.synth.sample_session import MAKING
from rigctl.values import BoardIdentity
from tests.gui.fake_engine import STATUS, FakeEngine
from tests.gui.fake_finger import RUNNING, FakeFinger
from tests.gui.steps import click, wait_until
from tests.gui.texts.attach_scenes import attach_scenes
from tests.gui.texts.editor_scenes import editor_scenes
from tests.gui.texts.results_scenes import results_scenes
from tests.gui.texts.run_page_scenes import run_page_scenes
from tests.gui.texts.trial_scenes import trial_scenes

SESSION_NAME = "dense-coding-of-surface-textures-20261123-205501"
FAULT_WORDS = "force above the limit: check the sensor and the plate, then clear the fault"
REFUSAL = (
    "approach: the drum is 1.4 mm from its place and the load cell reads 12 g without contact: "
    "retract, tare the load cell, then approach again"
)
NO_SAMPLE = (
    "/home/annamaria.rothenberger/.local/share/rigctl/sample/sample-session cannot be written (No "
    "space left on device): make room there, or allow writing"
)
SILENT = "Operate, the engine is silent"
CROWDED: dict[str, Any] = {
    "force_g": -1234.5,
    "speed_mm_s": 199.9,
    "actuator_position_um": 123_450,
    "angle_deg": -359.9,
    "frame_rate_hz": 1013.7,
    "lost_samples": 123_456,
    "gaps": 1234,
    "lost_age_s": 5900.0,
    "loadcell_lost_age_s": 5900.0,
    "last_block_age_s": 12.345,
    "poll_age_s": 12.345,
    "poll_retries": 123,
    "loadcell_lost": 12_345,
    "clock_ppm": {"drum": -5187.0, "taxels": 5904.0},
}
RECORDING: dict[str, Any] = {
    "active": True,
    "samples_on_disk": 123_456_789,
    "samples_last_s": 1000,
    "folder": f"/data/{SESSION_NAME}",
    "disk_free_bytes": 999_900_000_000,
    "hours_left": 1234.5,
}
RUN: dict[str, Any] = {
    "state": "running",
    "trial_id": 23_456,
    "trials_planned": 24_000,
    "trials_committed": 23_455,
    "trials_rejected": 1234,
    "eta_s": 359_000.0,
    "trial_age_s": 5999.0,
    "current": {"texture": "L", "speed_mm_s": 120.0, "force_g": 1000.0, "repeat": 10, "mount": 3},
    "prompt": None,
    "session": f"/data/{SESSION_NAME}",
}
CALIBRATED: dict[str, Any] = {
    "loadcell_counts": -8_123_456.0,
    "loadcell_sd_counts": 12_345.0,
    "scale_ug_per_count": -2400,
    "calibration": {
        "masses": [[mass_g, 80_000.0 - 417 * mass_g, 1234.5] for mass_g in range(0, 1200, 150)],
        "scale_ug_per_count": -2397,
        "nonlinearity_share": 0.0007,
        "gains": [7.52, 5.31, 1652.25, 138.25, 12.55, 10.25, 11.35, 12.55],
        "imbalance_g": [place - 8.125 for place in range(16)],
        "wiring_step": 4,
        "wiring_question": "Press row 1, column 2 with a blunt tip of about 3 mm and hold it.",
        "wiring_place": 1,
        "wiring_pressed": [[0, 3]],
        "saved": dict.fromkeys(
            ("loadcell", "force", "imbalance"), f"the board's EEPROM and /data/{SESSION_NAME}.toml"
        ),
    },
}
PROMPT: dict[str, Any] = {
    "id": 7,
    "text": "mount plate L (mounting 3), check that it is flush, then continue",
    "texture": "L",
}


class Stage(NamedTuple):
    """The window, its two engines, and a session to open."""

    window: MainWindow
    engine: FakeEngine
    finger: FakeFinger
    session: Path

    def update(self, **changes: Any) -> None:
        """Send a status of the drum's engine with some changes."""
        self.engine.send_status(**changes)
        self.window.poll()


def scenes(stage: Stage) -> Iterator[str]:
    """Bring the window into one state after the other, and yield the name of each."""
    shown = (
        _not_connected,
        _start,
        _operate,
        _replay,
        _protocol,
        _attach,
        _analysis,
        _finger,
        _tools,
        _files,
    )
    for scene in shown:
        yield from scene(stage)


def _replay(stage: Stage) -> Iterator[str]:
    stage.window.replay.show()
    QApplication.processEvents()
    yield "Replay"
    stage.window.replay.hide()


def _show(stage: Stage, panel: str) -> None:
    stage.window.show_panel(panel)
    QApplication.processEvents()


def _not_connected(stage: Stage) -> Iterator[str]:
    stage.window.status_line.setText("")  # whatever another test has left there
    for name in ("Operate", "Protocol", "Analysis", "Finger"):
        _show(stage, name.lower())
        yield f"{name}, not connected"


def _start(stage: Stage) -> Iterator[str]:
    stage.window.start.show_page()
    QApplication.processEvents()
    yield "Start page"
    box = stage.window.start.sample_box
    box.show_progress(MAKING, "12/32 trials · 123 × real time · 0:01:23 left")
    yield "Start page, the sample session is made"
    box.show_failure(NO_SAMPLE)
    yield "Start page, the sample session failed"
    box.clear()
    click(stage.window.start.back)


def _operate(stage: Stage) -> Iterator[str]:
    window = stage.window
    _show(stage, "operate")
    window.connect_rig("virtual")
    wait_until(lambda: window.engine_link.live is not None)
    stage.engine.write_samples(6000)
    stage.update(**STATUS)
    yield "Operate, connected"
    record_in = window.operate_panel.record_box.folder
    click(window.operate_panel.bring_up.steps)
    record_in.setText("sessions")  # no whole path: a sentence says so
    yield "Operate, all steps of the bring-up"
    record_in.setText("/data")
    click(window.operate_panel.bring_up.steps)
    stage.update(**CROWDED, state=int(State.RUN), recording=RECORDING, run=RUN)
    yield "Operate, crowded figures"
    yield from _trials(stage)
    yield from _taxel_alone(stage)
    failure = {"active": False, "failure": "the disk is full: free some space, then continue"}
    state = {"state": int(State.FAULT_OFF), "fault": 2}
    stage.update(**state, fault_words=FAULT_WORDS, recording=failure)
    stage.window.report("refused", REFUSAL)
    yield "Operate, fault and full disk"
    stage.window.engine_link.silent.emit(12.0)
    yield SILENT


def _taxel_alone(stage: Stage) -> Iterator[str]:
    """Show a taxel by itself in each unit, and a force of four digits."""
    page, unit = stage.window.live_page, stage.window.live_page.bar.unit
    page.plots.show_taxels((3,))
    stage.engine.write_samples(1000, force_g=1400.0)
    for name in (VOLTS, COUNTS):
        unit.setCurrentText(name)
        yield f"A taxel alone in {name}"
    for course in page.plots.time_plots.courses:
        course.zoom(0.1)
    yield "Parts of the axes of force and speed"
    page.plots.show_whole_courses()
    page.plots.show_taxels(tuple(range(18)))


def _trials(stage: Stage) -> Iterator[str]:
    page = stage.window.live_page
    click(page.bar.buttons[TRIALS])
    page.toggle_alignment()
    for _ in range(2):
        stage.engine.write_samples(1000)
        page.refresh(stage.engine.live)
        stage.engine.write_samples(2000, sync=True)
        page.refresh(stage.engine.live)
    yield "Trials from the left edge"
    page.toggle_alignment()
    click(page.bar.buttons[ENCODER])
    click(page.encoder_strip.per_mm)
    yield "Encoder of the live views, rates per mm"
    click(page.encoder_strip.per_mm)
    click(page.bar.buttons[LISTEN])
    yield "Listen to a neuron"
    click(page.bar.buttons[LISTEN])


def _protocol(stage: Stage) -> Iterator[str]:
    panel = stage.window.protocol_panel
    _show(stage, "protocol")
    wait_until(lambda: not panel.worker.is_busy)
    calm = {"state": int(State.RUN), "fault": 0, "fault_words": ""}
    stage.update(**calm, recording=RECORDING | {"failure": None}, run=RUN)
    yield "Protocol, running"
    waiting = {"state": "prompt", "reasons": ["prompt", "link", "disk"], "prompt": PROMPT}
    stage.update(run=RUN | waiting)
    yield "Protocol, waiting for a plate"
    stage.update(run=RUN | {"state": "failed", "text": f"the recorder failed: {FAULT_WORDS}"})
    yield "Protocol, failed"
    yield from run_page_scenes(panel, str(stage.session))
    yield from editor_scenes(panel)
    yield from _learning_curve(panel)


def _learning_curve(panel: ProtocolPanel) -> Iterator[str]:
    click(panel.page_button)
    page = panel.page.learning
    panel.page.tabs.setCurrentWidget(page)
    page.show_text(describe_shortfall({"A": {(60.0, 250.0, 0.0): [0]}, "B": {}}))
    page.show_progress("encoding trials", 0.5)
    QApplication.processEvents()
    yield "Protocol, learning curve without trials"
    plates = tuple("ABCDEFGHIJKLMNOP")
    points = [
        CurvePoint(n, plates, 15, 180 * n, 240 * n, 230 * n, 0.92, 0.97) for n in (1, 50, 100)
    ]
    remark = "Without L: too few trials for the last point"
    page.show_curve(SessionCurve("/data/s", tuple(points), 24_000, 24_000, True, "", (remark,) * 3))
    QApplication.processEvents()
    yield "Protocol, learning curve"
    page.show_text(NO_SESSION)
    page.show_idle()
    panel.page.tabs.setCurrentIndex(0)
    click(panel.page_button)


def _attach(stage: Stage) -> Iterator[str]:
    _show(stage, "operate")
    yield from attach_scenes(stage.window, stage.engine, RUN)


def _analysis(stage: Stage) -> Iterator[str]:
    tab = stage.window.analysis_tab
    _show(stage, "analysis")
    stage.update(recording=STATUS["recording"], run=STATUS["run"])
    tab.panel.folder.setText(str(stage.session))
    click(tab.panel.open_button)
    wait_until(lambda: not tab.worker.is_busy and tab.trial_view.data is not None)
    box = tab.panel.run_box
    for index in range(box.method.count()):
        box.method.setCurrentIndex(index)
        QApplication.processEvents()
        yield f"Analysis, {box.method.itemText(index)}"
    yield from trial_scenes(tab)
    yield from results_scenes(stage.window)


def _finger(stage: Stage) -> Iterator[str]:
    window, tab, engine = stage.window, stage.window.finger_tab, stage.finger
    _show(stage, "finger")
    for stage_name in ("train", "calibrate", "run"):
        tab.setup.choose_stage(stage_name)
        QApplication.processEvents()
        yield f"Finger, {stage_name}"
    tab.connect_rig("virtual")
    wait_until(lambda: tab.link.live is not None)
    engine.send_instruction("D", "fast-to-slow")
    engine.write_samples(np.zeros((300, 9), np.uint8), in_scan=True, first=True)
    engine.send_batch(1, 123.4, 12.3)
    engine.send_prediction("B", 0.62, texture_set=["A", "B", "L"])
    engine.send_status(run=RUNNING | {"classified": 10, "right": 9}, lost_samples=123_456)
    window.poll()
    yield "Finger, running"
    engine.send_prediction("L", 0.999, is_final=True, known=False)
    window.poll()
    yield "Finger, an unknown plate"
    engine.send_prediction("L", 0.9, probabilities=dict.fromkeys("ABCDEFGHIJKL", 1 / 12))
    engine.send_status(run=RUNNING | {"textures": list("ABCDEFGHIJKL")})
    window.poll()
    yield "Finger, twelve plates"


def _tools(stage: Stage) -> Iterator[str]:
    tools = stage.window.tools
    stage.update(fault=0, **CALIBRATED)
    for part in tools.calibrate_page.parts:
        tools.show_calibration(part)
        QApplication.processEvents()
        yield f"Calibrate, {part}"
        tools.calibrate_page.parts[part].show_refusal(REFUSAL)
        yield f"Calibrate, {part}, refused"
    yield from _setup(stage)
    tools.accept_page.fields["Session"].clear()
    for name, page in (("accept", tools.accept_page), ("ports", tools.ports_page)):
        stage.window.stack.show_page(name)
        page.verdict.setText(REFUSAL)
        QApplication.processEvents()
        yield f"Tools, {name}"


def _setup(stage: Stage) -> Iterator[str]:
    page = stage.window.tools.setup_page
    state = {"problem": REFUSAL, "remedy": "[inverted] end_switches = true", "state": "wrong"}
    part = {"expected": "none; upper; lower", "found": "upper and lower; lower; upper", **state}
    parts = [
        {"name": step.name, "title": step.title, "picture": step.picture, **part} for step in STEPS
    ]
    stage.window.tools.show_setup()
    for number, step in enumerate(STEPS):
        stage.update(setup={"parts": parts})
        page.list.setCurrentRow(number)
        QApplication.processEvents()
        yield f"Set up, {step.name}"
    asked = {"question_id": 3, "question": HOLD_LOWER.text, "checking": "ends"}
    stage.update(setup={"parts": parts, **asked, "choices": ["done"], "known": "done"})
    QApplication.processEvents()
    yield "Set up, a question"
    asked |= {"question_id": 4, "question": CIRCUMFERENCE.text, "unit": "mm", "known": "400"}
    stage.update(setup={"parts": parts, **asked})
    QApplication.processEvents()
    yield "Set up, a number"
    stage.update(setup={})
    yield from _boards(stage)


def _boards(stage: Stage) -> Iterator[str]:
    """Show the first step of the set-up, and the offer to flash."""
    boards, strip = stage.window.tools.setup_page.boards, stage.window.tools.flash_strip
    stage.update(rig="")
    mega = BoardIdentity("drum", "0.1", "463fcdc5", 4, 3, 0)
    reports = [
        PortReport("/dev/ttyACM0", "Arduino Mega 2560", mega),
        PortReport("/dev/ttyUSB0", "USB Serial", error=REFUSAL),
    ]
    boards.worker.found.emit(reports, {"drum": "0badc0de", "taxels": "6c54995a"})
    strip.offer("drum", "/dev/ttyACM0", REFUSAL)
    QApplication.processEvents()
    yield "Set up, the boards"
    boards.worker.failed.emit(REFUSAL)
    boards.progress.show()
    QApplication.processEvents()
    yield "Set up, a flash"
    strip.hide()
    boards.progress.hide()
    stage.update(rig="virtual")


def _files(stage: Stage) -> Iterator[str]:
    window = stage.window
    window.own_plots.plots.show_units({"top layer": "counts", "SA": "spikes/s", "RA": "spikes/s"})
    window.own_plots.text.setText(REFUSAL)
    window.stack.show_page("plots")
    QApplication.processEvents()
    yield "Own plots"
    for kind in (PathKind.PROTOCOL, PathKind.SESSION):
        window.file_browser.open(kind, lambda path: None)
        window.stack.setCurrentWidget(window.file_browser)
        QApplication.processEvents()
        yield f"File browser, {kind.value[0]}"
    window.file_browser.dismiss()
