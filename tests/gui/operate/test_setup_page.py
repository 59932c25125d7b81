"""The page Set up on a virtual rig: parts checked, answered, mended, described, left; by clicks."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QPushButton

from gui.operate.part_picture import CellTrace, PartDrawing
from gui.operate.setup_page import DRUM_LOST, SetupPage
from gui.widgets.layouts import container, vbox
from rigctl.engine.rpc.messages import EngineStatus
from tests.gui.rig_window import RigWindow, rig_window
from tests.gui.steps import Harness, click


@pytest.fixture(scope="module")
def rig(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RigWindow]:
    with rig_window(qapp, "virtual", tmp_path_factory.mktemp("runtime")) as opened:
        yield opened


def page_of(rig: RigWindow) -> SetupPage:
    action = next(a for _, a in rig.window.menus.actions() if a.text() == "Set &up …")
    action.trigger()
    page = rig.window.tools.setup_page
    rig.until(lambda: bool(rig.status.setup.parts))
    assert rig.window.stack.currentWidget() is page
    return page


def choose(page: SetupPage, name: str) -> None:
    names = [part.name for part in page._setup.parts]
    page.list.setCurrentRow(names.index(name))


def press(rig: RigWindow, button: QPushButton) -> None:
    rig.until(button.isEnabled)
    click(button)


def check(rig: RigWindow, page: SetupPage, name: str) -> str:
    """Check a part, answer as the simulated bench does, and return its state."""
    answered: dict[str, EngineStatus] = {}
    rig.window.engine_link.answered.connect(
        lambda command, _: answered.setdefault(command, rig.status)
    )
    choose(page, name)
    press(rig, page.check_button)
    done = page._asked_id

    def is_over() -> bool:
        """Return whether the check has ended, and a status has come since its answer."""
        before = answered.get("setup_check")
        return before not in (None, rig.status) and not rig.status.setup.checking

    while not is_over():
        rig.until(lambda done=done: is_over() or page._asked_id > done)
        if not is_over():
            done = page._asked_id
            texts = [button.text() for button in page.answer_buttons]
            told = next((n for n, text in enumerate(texts) if "(simulated)" in text), 0)
            click(page.answer_buttons[told])
    return _state(rig, name)


def _state(rig: RigWindow, name: str) -> str:
    return next(part.state for part in rig.status.setup.parts if part.name == name)


def test_the_parts_before_anything_moves_pass_one_after_another(rig: RigWindow) -> None:
    page = page_of(rig)
    for name in ("ports", "firmware", "drum", "wires", "stop", "supply", "ends"):
        assert check(rig, page, name) == "right", page.problem.text()
        assert page.part.name == name and page.expected.text().startswith("Expected: ")
        assert page.drawing.isVisible()


def test_a_part_that_moves_waits_for_those_before(rig: RigWindow) -> None:
    page = page_of(rig)
    choose(page, "turn")
    press(rig, page.check_button)
    rig.until(lambda: "moves the drum: first check Load cell at rest" in page.state.text())


def test_a_wrong_wiring_is_named_and_rig_toml_may_describe_it(rig: RigWindow) -> None:
    page, link = page_of(rig), rig.window.engine_link
    link.request("inject", fault="wire", name="end switches normally open")
    assert check(rig, page, "ends") == "wrong"
    assert "normally open" in page.problem.text() and "Found: upper and lower" in page.found.text()
    assert "[inverted] end_switches = true" in page.keep_button.toolTip()
    press(rig, page.keep_button)
    rig.until(lambda: _state(rig, "ends") == "right")
    link.request("inject", fault="wire", name="end switches normally open", on=False)
    assert check(rig, page, "ends") == "wrong"
    press(rig, page.keep_button)
    rig.until(lambda: _state(rig, "ends") == "right")


def test_the_log_says_what_nobody_has_checked(rig: RigWindow) -> None:
    page = page_of(rig)
    press(rig, page.without_button)
    rig.until(lambda: "commissioned; nobody has checked Load cell at rest" in rig.log)
    assert "set up: rig.toml says [inverted] end_switches" in rig.log


def test_an_answer_that_is_no_number_is_refused_and_the_check_can_be_stopped(
    rig: RigWindow,
) -> None:
    page = page_of(rig)
    choose(page, "drum")
    press(rig, page.check_button)
    rig.until(page.answer.isVisible)
    assert page.unit.text() == "mm"
    page.answer.clear()
    QTest.keyClicks(page.answer, "1.000,5")
    QTest.keyClick(page.answer, Qt.Key.Key_Return)
    rig.until(lambda: "a number from 50 to 5000 mm" in page.state.text())
    press(rig, page.cancel_button)
    rig.until(lambda: not rig.status.setup.checking)
    assert not page.answer.isVisible() and _state(rig, "drum") == "right"


def test_each_wire_that_is_asked_for_is_shown_in_the_drawing(rig: RigWindow) -> None:
    page = page_of(rig)
    choose(page, "wires")
    press(rig, page.check_button)
    for name, picture in (("emergency stop", "Emergency stop"), ("index", "Index sensor")):
        rig.until(lambda name=name: f"Is this fitted: {name}" in page.question.text())
        assert picture in page.drawing.accessibleName()
        click(page.answer_buttons[0])
    press(rig, page.cancel_button)
    rig.until(lambda: not rig.status.setup.checking)


def test_without_a_rig_the_page_says_what_to_do(harness: Harness) -> None:
    window = harness.window
    window.engine_link.close()
    window.tools.show_setup()
    page = window.tools.setup_page
    page.show_status(type(window.engine_link.status)())
    assert page.boards.isVisible()
    assert page.boards.find_button.isEnabled() and not page.check_button.isVisible()


def test_a_drum_board_that_is_lost_is_named(harness: Harness) -> None:
    harness.window.tools.show_setup()
    harness.update(drum_connected=False)
    page = harness.window.tools.setup_page
    assert page.state.text() == DRUM_LOST and not page.check_button.isEnabled()


@pytest.mark.parametrize("size", [(650, 400), (1290, 700)])
def test_the_drawing_has_the_room_that_the_load_cells_course_leaves(
    qapp: QApplication, size: tuple[int, int]
) -> None:
    drawing, trace = PartDrawing(), CellTrace()
    page = container(vbox(drawing, trace))
    page.resize(*size)
    page.layout().activate()
    assert drawing.height() >= drawing.sizeHint().height()
    assert drawing.height() > trace.height()
