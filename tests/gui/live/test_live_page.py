"""Looking back in the live plots by mouse and keys while samples go on to arrive."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QImage, QMouseEvent, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.analysis.export import FOOT_PX
from gui.live.live_page import CONDUCTANCE, COUNTS, ENCODER, SAVE, TAXELS, VOLTS, LivePage
from gui.live.saver import shown_samples, write_table
from gui.live.time_plots import ENLARGED, LEAST_HEIGHT
from gui.widgets.theme import LIGHT
from gui.widgets.typed_paths import NO_FOLDER, NO_WHOLE_PATH
from rigctl.encoder.encoder import Encoder
from rigctl.encoder.force_gain import divided
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import preset
from rigctl.encoder.reading import Reading, conductance, input_of_each
from rigctl.engine.rpc.messages import EngineStatus, parse_status
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import DRAWN_WIRING
from tests.analysis.recordings import sensor_passport
from tests.gui.fake_engine import STATUS, FakeEngine
from tests.gui.steps import click, wait_until

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def page(qapp: QApplication, engine: FakeEngine) -> Iterator[LivePage]:
    """Yield a page with half a minute of samples."""
    page = LivePage(LIGHT)
    page.resize(900, 600)
    page.show()
    stream(page, engine, 30_000)
    yield page
    page.hide()
    engine.close()


def stream(page: LivePage, engine: FakeEngine, n: int) -> None:
    """Let samples arrive, ten seconds at a time."""
    for _ in range(0, n, 10_000):
        engine.write_samples(min(n, 10_000))
        page.refresh(engine.live)
    page.bar.show_place()  # texts change ten times a second, whatever the number of frames
    page.show_texts()


def point(page: LivePage, plot: int, share: float, height: float = 0.5) -> QPoint:
    """Return a point in a plot, in pixels of the plots' viewport."""
    area = page.plots._area(plot)
    at = QPointF(area.left() + share * area.width(), area.top() + height * area.height())
    return at.toPoint()


def move(page: LivePage, plot: int, share: float, height: float = 0.5) -> None:
    """Move the pointer without a button."""
    view, at = page.plots.graphics.viewport(), point(page, plot, share, height)
    no_button, none = Qt.MouseButton.NoButton, Qt.KeyboardModifier.NoModifier
    kind, where = QEvent.Type.MouseMove, QPointF(view.mapToGlobal(at))
    QApplication.sendEvent(view, QMouseEvent(kind, QPointF(at), where, no_button, no_button, none))


def turn(
    page: LivePage,
    share: float,
    steps: int,
    height: float = 0.5,
    keys: Qt.KeyboardModifier = Qt.KeyboardModifier.NoModifier,
) -> None:
    """Turn the wheel over the force plot."""
    at, view = QPointF(point(page, 0, share, height)), page.plots.graphics.viewport()
    arguments = (at, QPointF(view.mapToGlobal(at)), QPoint(), QPoint(0, 120 * steps))
    no_button, phase = Qt.MouseButton.NoButton, Qt.ScrollPhase.NoScrollPhase
    QApplication.sendEvent(view, QWheelEvent(*arguments, no_button, keys, phase, False))


def test_pause_keeps_the_view_while_samples_arrive(page: LivePage, engine: FakeEngine) -> None:
    click(page.bar.pause)
    window = page.plots.navigation.window
    stream(page, engine, 20_000)
    assert page.plots.navigation.window == window
    assert page.bar.pause.text() == "Live" and page.bar.place.text() == "20 s ago"
    click(page.bar.pause)
    assert page.plots.navigation.window.right == 49_999
    assert page.bar.place.text() == "live"


def test_dragging_and_the_scroll_bar_look_back(page: LivePage, engine: FakeEngine) -> None:
    view = page.plots.graphics.viewport()
    QTest.mousePress(view, LEFT, pos=point(page, 2, 0.2))
    QTest.mouseMove(view, point(page, 2, 0.7))
    QTest.mouseRelease(view, LEFT, pos=point(page, 2, 0.7))
    right = page.plots.navigation.window.right
    assert right == pytest.approx(29_999 - 5000, abs=60)
    page.bar.scroll_bar.setValue(0)
    assert page.plots.navigation.window.left <= 10
    assert "ago" in page.bar.place.text()


def test_ten_minutes_are_there_to_scroll_through(page: LivePage, engine: FakeEngine) -> None:
    stream(page, engine, 630_000)
    QTest.keyClick(page.plots.graphics, Qt.Key.Key_Home)
    window = page.plots.navigation.window
    assert page.plots.navigation.newest - window.left >= 600_000
    low, high = page.plots.data.history.extremes(
        page.plots.data.history.columns(window.left // 100, window.left // 100 + 50, 10, 1000)
    )
    assert (high > low).all()


def test_the_wheel_zooms_about_the_pointer_in_a_pause(page: LivePage) -> None:
    QTest.keyClick(page.plots.graphics, Qt.Key.Key_Space)
    before = page.plots.navigation.window.position_of(0.25)
    turn(page, 0.25, 3)
    window = page.plots.navigation.window
    assert window.span < 10_000
    assert window.position_of(0.25) == pytest.approx(before, abs=60)
    for _ in range(40):
        turn(page, 0.5, -1)
    assert page.plots.navigation.window.span == 660_000


def test_the_span_is_chosen_from_one_second_to_a_minute(page: LivePage) -> None:
    box = page.bar.span
    assert [box.itemText(i) for i in (0, box.count() - 1)] == ["1 s", "60 s"]
    box.setFocus()
    QTest.keyClick(box, Qt.Key.Key_End)
    assert page.plots.navigation.window.span == 60_000
    assert page.plots.time_plots.plots[0].viewRange()[0] == [-60.0, 0.0]
    turn(page, 0.5, 1)
    assert box.currentText() == "30 s"


CONTROL = Qt.KeyboardModifier.ControlModifier


def axis_of(page: LivePage, plot: int) -> tuple[list[float], list[str]]:
    """Return the ends of a plot's axis, and the numbers beside it."""
    item = page.plots.time_plots.plots[plot]
    return item.viewRange()[1], [text for _, text in item.getAxis("left")._tickLevels[0]]


def test_the_wheel_with_ctrl_enlarges_force_about_the_pointer_until_a_double_click(
    page: LivePage, engine: FakeEngine
) -> None:
    force, speed = page.plots.time_plots.courses
    whole, of_speed = axis_of(page, 0), axis_of(page, 1)
    low, high = whole[0]
    kept, gain = high - 0.25 * (high - low), page.plots.time_plots.traces.gain
    for _ in range(4):
        turn(page, 0.5, 1, 0.25, CONTROL)
    (low, high), numbers = axis_of(page, 0)
    assert high - low < 0.5 * (whole[0][1] - whole[0][0])
    assert high - 0.25 * (high - low) == pytest.approx(kept, abs=6)
    assert force.part is not None and numbers == [
        f"{value:.0f}" for value in (force.part[0], sum(force.part) / 2, force.part[1])
    ]
    assert ENLARGED in force._words.text and ENLARGED not in speed._words.text
    assert axis_of(page, 1) == of_speed and page.plots.time_plots.traces.gain == gain
    stream(page, engine, 1000)
    assert axis_of(page, 0)[0] == [low, high], "it stays while samples come"
    QTest.mouseDClick(page.plots.graphics.viewport(), LEFT, pos=point(page, 0, 0.5))
    assert axis_of(page, 0) == whole and force._words.text == ""


def test_dragging_an_enlarged_axis_moves_it_and_not_the_time(page: LivePage) -> None:
    force = page.plots.time_plots.force
    for _ in range(40):
        turn(page, 0.5, 1, 0.5, CONTROL)
    assert force.part is not None and force.part[1] - force.part[0] == LEAST_HEIGHT
    turn(page, 0.5, -8, 0.5, CONTROL)
    low, high = force.part
    view = page.plots.graphics.viewport()
    QTest.mousePress(view, LEFT, pos=point(page, 0, -0.02, 0.2))
    for height in (0.3, 0.5, 0.7):
        QTest.mouseMove(view, point(page, 0, -0.02, height))
    QTest.mouseRelease(view, LEFT, pos=point(page, 0, -0.02, 0.7))
    assert force.part == (low + round((high - low) / 2), high + round((high - low) / 2))
    assert not page.plots.navigation.is_paused and page.plots.cursors.reference is None
    for _ in range(60):
        turn(page, 0.5, -1, 0.5, CONTROL)
    assert force.part is None


def test_keys_enlarge_force_and_speed_about_the_newest_value(
    page: LivePage, engine: FakeEngine
) -> None:
    press, shift = partial(QTest.keyClick, page.plots.graphics), Qt.KeyboardModifier.ShiftModifier
    for _ in range(12):
        press(Qt.Key.Key_Up, CONTROL)
        press(Qt.Key.Key_Up, CONTROL | shift)
    newest = engine.live.drum(1)
    for course, value in zip(
        page.plots.time_plots.courses, (newest.force_g[-1], newest.speed_mm_s[-1]), strict=True
    ):
        assert course.part is not None and course.part[0] - 1 <= value <= course.part[1] + 1
    press(Qt.Key.Key_Down, CONTROL)
    press(Qt.Key.Key_0)
    assert [course.part for course in page.plots.time_plots.courses] == [None, None]


def test_the_cursor_shows_values_and_differences(page: LivePage) -> None:
    click(page.bar.pause)
    move(page, 2, 0.4, 4.5 / 18)
    QTest.mouseClick(page.plots.graphics.viewport(), LEFT, pos=point(page, 2, 0.4, 4.5 / 18))
    move(page, 2, 0.6)
    text, difference = page.cursor_label.text(), page.difference_label.text()
    reading = page.plots.data.reading_at(
        page.plots.cursors.position(page.plots.navigation.window) or 0, 4
    )
    assert text.startswith(("Cursor −4.0", "Cursor −3.99")) and f"T5 {reading} counts" in text
    assert " g · " in text and "speed 80.0 mm/s" in text
    assert (
        difference.startswith(("From the reference +2.0", "From the reference +1.99"))
        and "spikes" in difference
    )
    page.bar.unit.setCurrentText(VOLTS)
    assert f"T5 {(reading or 0) * 5 / 1023:.3f} V" in page.cursor_label.text()


def test_volts_use_the_supply_that_the_board_measures(page: LivePage) -> None:
    page.show_status(parse_status(STATUS))
    page.bar.unit.setCurrentText(VOLTS)
    click(page.bar.pause)
    move(page, 2, 0.5, 0.5 / 18)
    reading = page.plots.data.reading_at(
        page.plots.cursors.position(page.plots.navigation.window) or 0, 0
    )
    assert f"T1 {(reading or 0) * 5.01 / 1023:.3f} V" in page.cursor_label.text()


def test_keys_alone_move_cursor_time_and_taxel(page: LivePage) -> None:
    press, control = (
        partial(QTest.keyClick, page.plots.graphics),
        Qt.KeyboardModifier.ControlModifier,
    )
    press(Qt.Key.Key_Space)
    press(Qt.Key.Key_Left)
    assert page.plots.navigation.window.right == 28_999
    press(Qt.Key.Key_Right, control)
    press(Qt.Key.Key_C)
    for _ in range(5):
        press(Qt.Key.Key_Right, control)
    assert page.difference_label.text().startswith("From the reference +0.0")
    press(Qt.Key.Key_Down)
    assert "T2 " in page.cursor_label.text()
    press(Qt.Key.Key_Return)
    assert page.plots.time_plots.taxels == (1,)
    press(Qt.Key.Key_End)
    assert not page.plots.navigation.is_paused


def test_each_layer_is_chosen_in_its_own_row(page: LivePage) -> None:
    """Layer II stood in the row of Layer I, and Layer I in that of Layer II."""
    click(page.bar.buttons[TAXELS])
    strip = page.taxel_strip
    QApplication.processEvents()
    _, *layers = strip.groups
    for button, taxels in zip(layers, (range(9), range(9, 18)), strict=True):
        assert {strip.buttons[taxel].y() for taxel in taxels} == {button.y()}
        click(button)
        assert page.plots.time_plots.taxels == tuple(taxels)
    strip.set_sensor_layout(SensorLayout(2, 5, ("upper", "lower")))
    QApplication.processEvents()
    for button, first in zip(strip.groups[1:], (0, 10), strict=True):
        assert strip.buttons[first].y() == button.y() < strip.buttons[first + 9].y()
    strip.set_sensor_layout(page.plots.sensor_layout)


def test_taxels_are_chosen_and_one_is_enlarged(page: LivePage) -> None:
    click(page.bar.buttons[TAXELS])
    click(page.taxel_strip.groups[1])
    assert page.plots.time_plots.taxels == tuple(range(9))
    assert page.plots.time_plots.raster.n_rows == 18
    click(page.taxel_strip.buttons[3])
    assert 3 not in page.plots.time_plots.taxels
    at = point(page, 2, 0.5, 3.5 / 8)
    QTest.mouseDClick(page.plots.graphics.viewport(), LEFT, pos=at)
    assert page.plots.time_plots.taxels == (4,)
    axis = page.plots.time_plots.trace_plot.getAxis("left")
    assert "T5" in axis.labelText and "counts" in axis.labelText
    page.bar.unit.setCurrentText(VOLTS)
    assert "(V)" in axis.labelText
    QTest.mouseDClick(page.plots.graphics.viewport(), LEFT, pos=at)
    assert len(page.plots.time_plots.taxels) == 18


def test_events_are_marked_where_they_happened(page: LivePage) -> None:
    page.add_event(25.0, "trial", "trial 7: A at 80 mm/s", {"trial_id": 7})
    page.add_event(26.0, "log", "nothing to mark", {})
    page.add_event(27.0, "fault", "the drum does not answer", {})
    page.plots.draw()
    marks = page.plots.time_plots.overlays[0].marks
    assert [(mark.name, mark.is_problem) for mark in marks] == [("trial 7", False), ("fault", True)]
    assert marks[0].at_s == pytest.approx(-5.0, abs=0.01)
    click(page.bar.pause)
    move(page, 0, 0.5)
    assert "trial 7: A at 80 mm/s" in page.cursor_label.text()


def test_a_hidden_page_goes_on_to_collect(page: LivePage, engine: FakeEngine) -> None:
    page.hide()
    stream(page, engine, 40_000)
    assert len(page.plots.data.history) == 70_000
    assert len(page.plots.data.drum.within(page.plots.navigation.window)[0]) > 800


def test_picture_and_table_take_two_clicks(
    page: LivePage, engine: FakeEngine, tmp_path: Path
) -> None:
    reports: list[tuple[str, str]] = []
    page.reported.connect(lambda *report: reports.append(report))
    page.save_strip.folder.setText(str(tmp_path / "new"))
    page.show_status(EngineStatus(rig="virtual", simulated=True))
    page.show_status(EngineStatus())
    click(page.bar.buttons[SAVE])
    click(page.save_strip.picture)
    click(page.save_strip.table)
    wait_until(lambda: len(reports) == 2)
    assert [kind for kind, _ in reports] == ["saved", "saved"]
    (picture,) = (tmp_path / "new").glob("*.png")
    image = QImage(str(picture))
    assert image.width() == page.plots.width()
    assert image.height() == page.plots.height() + FOOT_PX
    (table,) = (tmp_path / "new").glob("*.csv")
    lines = table.read_text().splitlines()
    assert lines[0].startswith("# rigctl, live views, SIMULATED, ") and "counts" in lines[0]
    assert lines[1].split(",")[:6] == [
        "sample", "time_s", "force_g", "force_set_g", "speed_mm_s", "speed_set_mm_s",
    ]  # fmt: skip
    assert lines[1].endswith("T_RA-18") and len(lines) == 2 + 10_001
    values = dict(zip(lines[1].split(","), lines[-1].split(","), strict=True))
    newest = page.plots.data.samples_before(29_999, 1)[0]
    assert int(values["sample"]) == 29_999 and int(values["T5"]) == newest[4]
    page.close_files()


def test_a_folder_that_is_a_file_is_refused_in_a_sentence(page: LivePage, tmp_path: Path) -> None:
    reports: list[tuple[str, str]] = []
    page.reported.connect(lambda *report: reports.append(report))
    (tmp_path / "file").write_text("")
    page.save_strip.folder.setText(str(tmp_path / "file"))
    click(page.bar.buttons[SAVE])
    click(page.save_strip.picture)
    wait_until(lambda: bool(reports))
    assert reports[0][0] == "refused" and "choose another place" in reports[0][1]
    for text, cure in (
        ("", NO_FOLDER),
        ("pictures", NO_WHOLE_PATH),
        ("~no-such-user", NO_WHOLE_PATH),
    ):
        page.save_strip.folder.setText(text)
        reports.clear()
        click(page.save_strip.picture)
        wait_until(lambda: bool(reports))
        assert reports == [("refused", f"nothing was saved: {cure}")]
    page.close_files()


def test_another_encoder_is_used_from_now_on(page: LivePage, engine: FakeEngine) -> None:
    strip = page.encoder_strip
    click(page.bar.buttons[ENCODER])
    strip.preset.setCurrentIndex(strip.preset.findText("quarter-rate"))
    strip.preset.activated.emit(strip.preset.currentIndex())
    before = page.plots.data.history.spikes.end
    stream(page, engine, 20_000)
    shown = page.plots.data.history.spikes.between(before, before + 20_000)
    samples = page.plots.data.history.samples.between(before, before + 20_000)
    ranges = Normalisation(np.full(18, 200, np.uint16), np.full(18, 800, np.uint16))
    expected = Encoder(ranges, preset("quarter-rate")).encode(np.ascontiguousarray(samples))
    assert np.array_equal(shown, expected)
    assert "the record stays as it is" in strip.sentence.text()
    assert page.plots.data.marks.nearest(30_000, 100) is not None
    strip.preset.setCurrentIndex(0)
    strip.preset.activated.emit(0)
    assert page.plots.data.history.recode is None


def table_of(page: LivePage, folder: Path) -> list[str]:
    """Return the lines of the table of what is in view."""
    plots = page.plots
    window, taxels = plots.navigation.window, plots.time_plots.taxels
    write_table(shown_samples(plots.data, window, taxels, plots.value_scale), folder / "live.csv")
    return (folder / "live.csv").read_text().splitlines()


def test_the_table_has_the_unit_that_is_chosen(
    page: LivePage, engine: FakeEngine, tmp_path: Path
) -> None:
    stream(page, engine, 500)
    counts = table_of(page, tmp_path)
    page.bar.unit.setCurrentText(VOLTS)
    volts = table_of(page, tmp_path)
    assert "readings in counts" in counts[0] and "readings in V" in volts[0]
    place = counts[1].split(",").index("T3")
    shown = float(volts[9].split(",")[place]), int(counts[9].split(",")[place])
    assert shown[0] == pytest.approx(shown[1] * page.plots.value_scale.factor, abs=1e-4)
    page.bar.unit.setCurrentText(COUNTS)


def test_conductances_are_shown_and_encoded_without_the_load_of_neighbours(
    page: LivePage, engine: FakeEngine, tmp_path: Path
) -> None:
    page.show_status(parse_status({**STATUS, "rig": "virtual", "wiring": list(DRAWN_WIRING)}))
    page.bar.unit.setCurrentText(CONDUCTANCE)
    data = page.plots.data
    assert not len(data.history) and "of the conductance" in page.encoder_strip.sentence.text()
    stream(page, engine, 2000)
    counts = engine.live.taxels(2000).samples
    expected = conductance(counts, input_of_each(DRAWN_WIRING, 6, ""))
    shown = data.samples_before(data.history.newest, 2000)
    assert np.array_equal(shown[-2000:], expected)
    assert np.all(data.low <= expected.min(axis=0)) and np.all(data.high >= expected.max(axis=0))
    assert page.plots.value_scale.unit == "× G divider"
    assert page.plots.value_scale.text(4096) == "1.000"
    assert "readings in × G divider" in table_of(page, tmp_path)[0]
    page.bar.unit.setCurrentText("counts")
    assert data.history.recode is None and data.reading is Reading.COUNTS


def test_a_rig_with_unknown_inputs_refuses_conductances(page: LivePage) -> None:
    reports: list[tuple[str, str]] = []
    page.reported.connect(lambda kind, text: reports.append((kind, text)))
    page.bar.unit.setCurrentText(CONDUCTANCE)
    assert not reports, "what the window remembers waits for a rig"
    page.show_status(parse_status({**STATUS, "rig": "virtual", "wiring": []}))
    assert page.bar.unit.currentText() == "counts"
    ((kind, text),) = reports
    assert kind == "refused" and "which taxels share an input" in text


def test_views_follow_an_engine_that_encodes_conductances(page: LivePage) -> None:
    status = {**STATUS, "rig": "virtual", "wiring": list(DRAWN_WIRING), "reading": "conductance"}
    page.show_status(parse_status(status))
    assert page.bar.unit.currentText() == CONDUCTANCE
    assert page.plots.data.history.recode is None and not page.plots.data.has_own_range


def test_c_scales_the_current_of_the_present_force(page: LivePage, tmp_path: Path) -> None:
    strip = page.encoder_strip
    strip.scaling.setCurrentIndex(1)
    strip.scaling.activated.emit(1)
    assert "name a model file that has C" in strip.sentence.text()
    strip._take(
        ForceMatrix(
            ("A",), (80.0,), (500.0,), 500.0, np.full((1, 18, 1, 1), 2.0),
            np.zeros((1, 1, 1, 1), np.int8).repeat(18, axis=1),
            np.zeros((1, 18, 1, 1)), np.zeros((1, 18, 1, 1)),
        )
    )  # fmt: skip
    page.show_status(parse_status(STATUS))
    assert "C blind to the plate" in strip.sentence.text()
    page.show_status(parse_status({**STATUS, "force_set_g": 300.0}))
    assert "300 g" in strip.sentence.text()
    (tmp_path / "not.h5").write_bytes(b"no model")
    strip.model.setText(str(tmp_path / "not.h5"))
    strip.model.editingFinished.emit()
    wait_until(lambda: "not.h5" in strip.sentence.text())
    page.close_files()


def test_a_typed_c_scales_all_taxels(page: LivePage, engine: FakeEngine) -> None:
    strip = page.encoder_strip
    click(page.bar.buttons[ENCODER])
    strip.scaling.setCurrentIndex(strip.scaling.findText("C, typed"))
    strip.scaling.activated.emit(strip.scaling.currentIndex())
    assert strip.c.isVisible() and not strip.model.isVisible()
    strip.c.selectAll()
    QTest.keyClicks(strip.c, "2.5")
    QTest.keyClick(strip.c, Qt.Key.Key_Return)
    assert "C = 2.5 for all taxels; the record stays as it is" in strip.sentence.text()
    before = page.plots.data.history.spikes.end
    stream(page, engine, 5000)
    shown = page.plots.data.history.spikes.between(before, before + 5000)
    samples = page.plots.data.history.samples.between(before, before + 5000)
    ranges = Normalisation(np.full(18, 200, np.uint16), np.full(18, 800, np.uint16))
    encoder = Encoder(ranges, preset("default"), np.full(18, 2.5))
    assert np.array_equal(shown, encoder.encode(np.ascontiguousarray(samples)))
    strip.scaling.setCurrentIndex(0)
    strip.scaling.activated.emit(0)
    assert page.plots.data.history.recode is None and strip.model.isVisible()


def test_a_gain_scales_by_all_taxels(page: LivePage, engine: FakeEngine, tmp_path: Path) -> None:
    strip = page.encoder_strip
    click(page.bar.buttons[ENCODER])
    strip.scaling.setCurrentIndex(strip.scaling.findText("Divided"))
    strip.scaling.activated.emit(strip.scaling.currentIndex())
    assert not strip.c.isVisible() and not strip.model.isVisible()
    assert "divided by all taxels, which knows nothing" in strip.sentence.text()
    before = page.plots.data.history.spikes.end
    stream(page, engine, 5000)
    shown = page.plots.data.history.spikes.between(before, before + 5000)
    samples = page.plots.data.history.samples.between(before, before + 5000)
    ranges = Normalisation(np.full(18, 200, np.uint16), np.full(18, 800, np.uint16))
    encoder = Encoder(ranges, gain_of=divided)
    assert np.array_equal(shown, encoder.encode(np.ascontiguousarray(samples)))
    strip.scaling.setCurrentIndex(strip.scaling.findText("Calibrated"))
    strip.scaling.activated.emit(strip.scaling.currentIndex())
    assert "name the sensor.json" in strip.sentence.text() and strip.model.isVisible()
    strip.model.setText(str(tmp_path / "sensor.json"))
    strip.model.editingFinished.emit()
    wait_until(lambda: "sensor.json cannot be read" in strip.sentence.text())
    (tmp_path / "sensor.json").write_text(json.dumps(sensor_passport().to_values()))
    strip.model.editingFinished.emit()
    wait_until(lambda: "passport is of conductance" in strip.sentence.text())
    page.close_files()


def test_rates_are_per_mm_of_the_texture_that_passed(page: LivePage, engine: FakeEngine) -> None:
    click(page.bar.buttons[ENCODER])
    QTest.keyClick(page.encoder_strip.per_mm, Qt.Key.Key_Space)
    bars = page.plots.rate_bars
    assert bars.rates_a_mm is not None
    assert bars.rates_a_mm == pytest.approx(bars.rates_hz / 80.0, rel=0.01)
    axis = page.plots._rate_plot.getAxis("bottom")
    assert axis.labelText == "Rate in the last second (1/mm)"
    QTest.keyClick(page.encoder_strip.per_mm, Qt.Key.Key_Space)
    assert bars.rates_a_mm is None and axis.labelText == "Rate in the last second (Hz)"


def test_a_drum_at_rest_has_no_rate_per_mm(page: LivePage) -> None:
    bars = page.plots.rate_bars
    bars.refresh(np.ones((1000, 36), np.uint8), travelled_mm=0.4)
    assert bars.rates_a_mm is not None and not bars.rates_a_mm.any()
