"""What is typed means the same in every language of the computer, and becomes no other number."""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from PySide6.QtCore import QLocale, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractSpinBox, QApplication, QLineEdit
from shiboken6 import delete

from gui.widgets.number_box import NumberBox
from tests.gui.fake_engine import FakeEngine
from tests.gui.operate.test_calibrate import MASSES
from tests.gui.steps import Harness, SharedWindow, click, wait_until

LANGUAGES = ("C", "de_DE", "fr_FR", "sv_SE", "ar_EG", "de_CH", "hi_IN")
GROUP_MARKS = (".", ",", "'", "\u2019", " ", "\u00a0", "\u202f", "٬", "_")
whole_parts = st.integers(0, 9999).map(str)
decimals = st.text("0123456789", min_size=1, max_size=4)
plain = st.builds(
    lambda whole, mark, part: whole + mark + part, whole_parts, st.sampled_from(".,"), decimals
)
grouped = st.builds(
    lambda thousands, mark, rest, part: f"{thousands}{mark}{rest:03d}{part}",
    st.integers(1, 999),
    st.sampled_from(GROUP_MARKS),
    st.integers(0, 999),
    st.sampled_from(("", ".0", ",5", ".25")),
)
arabic = plain.map(lambda text: text.translate(str.maketrans("0123456789.", "٠١٢٣٤٥٦٧٨٩٫")))
texts = st.one_of(whole_parts, plain, grouped, arabic, st.text("0123456789.,-+e '", max_size=7))


@pytest.fixture(scope="module", params=LANGUAGES)
def abroad(
    request: pytest.FixtureRequest, qapp: QApplication, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Harness]:
    """Yield a window that is made on a computer of another language, connected to an engine."""
    before = QLocale()
    QLocale.setDefault(QLocale(request.param) if request.param != "C" else QLocale.c())
    shared = SharedWindow()
    shared.engine = engine = FakeEngine(tmp_path_factory.mktemp("engine"))
    shared.window.show()
    shared.window.show_panel("operate")
    shared.window.connect_rig("virtual")
    wait_until(lambda: shared.window.engine_link.live is not None)
    harness = Harness(shared.window, engine)
    harness.update()
    yield harness
    shared.window.engine_link.close()
    shared.window.engine_link.wait_closed()
    shared.window.close()
    delete(shared.window)
    QLocale.setDefault(before)


def type_number(box: NumberBox, text: str) -> None:
    """Replace a box's text by key clicks, by the clipboard where no key has the letters."""
    box.setFocus()
    box.selectAll()
    QTest.keyClick(box, Qt.Key.Key_Backspace)
    if text.isascii():
        QTest.keyClicks(box, text)
    else:
        QApplication.clipboard().setText(text)
        line = box.findChild(QLineEdit)
        assert line is not None
        line.paste()


def shown(box: NumberBox) -> str:
    """Return what stands in a box, without its unit."""
    return box.text().removeprefix(box.prefix()).removesuffix(box.suffix())


def test_a_number_has_one_value_or_is_refused_as_it_is_typed(abroad: Harness) -> None:
    boxes = [abroad.window.operate_panel.force, abroad.window.operate_panel.speed]
    boxes += [box for box in abroad.window.findChildren(NumberBox) if box.isEnabled()]
    assert len(boxes) > 10

    @settings(max_examples=150, deadline=None, derandomize=True, database=None)
    @given(st.sampled_from(boxes), texts)
    @example(boxes[0], "100.0")
    @example(boxes[0], "12,5")
    @example(boxes[1], "1.000")
    def check(box: NumberBox, text: str) -> None:
        box.setValue(box.minimum())
        type_number(box, text)
        QTest.keyClick(box, Qt.Key.Key_Return)
        if box.refusal:
            assert shown(box) == text
            assert box.accessibleDescription() == box.refusal or not box.isVisible()
            assert not box.hasAcceptableInput()
        else:
            meant = Decimal(text.strip().replace(",", ".").replace("٫", ".").replace("−", "-"))
            assert Decimal(str(box.value())) == meant == Decimal(shown(box))
        box.setValue(box.minimum())
        assert not box.refusal

    check()


def test_no_box_of_the_window_reads_by_another_rule(abroad: Harness) -> None:
    boxes = abroad.window.findChildren(QAbstractSpinBox)
    assert len(boxes) > 10
    assert [box for box in boxes if not isinstance(box, NumberBox)] == []


@pytest.mark.parametrize(
    ("typed", "force_g"),
    [("100.0", 100.0), ("100,0", 100.0), ("250", 250.0), ("1200,", 1200.0), ("٢٥٠٫٠", 250.0)],
)
def test_the_force_that_is_sent_is_the_one_that_is_typed(
    abroad: Harness, typed: str, force_g: float
) -> None:
    operate = abroad.window.operate_panel
    type_number(operate.force, typed)
    click(operate.set_button)
    assert abroad.engine.requests[-1][1]["force_g"] == force_g


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("12,5", "12,5 has too many decimals: type a whole number"),
        ("1,000", "1,000 may mean 1000 or 1: type one of the two"),
        ("1.000", "1.000 may mean 1000 or 1: type one of the two"),
        ("1.000,0", "1.000,0 has a mark between groups of digits: leave it out"),
        ("1\u202f000", "has a mark between groups of digits: leave it out"),
        ("1٬000", "has a mark between groups of digits: leave it out"),
        ("1'000", "1'000 has a mark between groups of digits: leave it out"),
        ("2005", "2005 is outside 50 to 1200 g"),
        ("7", "7 is outside 50 to 1200 g"),
        ("", "no number: type digits, such as 12.5 or 12,5"),
    ],
)
def test_nothing_is_sent_while_a_text_is_refused(abroad: Harness, typed: str, words: str) -> None:
    operate, engine = abroad.window.operate_panel, abroad.engine
    operate.force.setValue(300)
    engine.requests.clear()
    type_number(operate.force, typed)
    click(operate.set_button)
    assert engine.requests == [] and shown(operate.force) == typed
    assert words in operate.force.accessibleDescription()
    type_number(operate.force, "400")
    click(operate.set_button)
    assert operate.force.accessibleDescription() == ""
    assert engine.requests[-1][1]["force_g"] == 400


def test_a_mass_is_the_one_that_is_typed(abroad: Harness) -> None:
    abroad.update(calibration={"masses": MASSES[:1]})
    abroad.window.tools.show_calibration("loadcell")
    part = abroad.window.tools.calibrate_page.load_cell
    for typed in ("200.5", "200,5"):
        type_number(part.mass, typed)
        click(part.measure_button)
        assert abroad.engine.requests[-1] == ("calibrate_loadcell", {"mass_g": 200.5})
    abroad.engine.requests.clear()
    type_number(part.mass, "2,005")
    click(part.measure_button)
    assert abroad.engine.requests == []
    part.mass.setValue(200)
    abroad.update(calibration={})
