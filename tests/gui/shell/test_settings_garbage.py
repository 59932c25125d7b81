"""Whatever a settings file holds, the window opens whole, and what was damaged is named."""

from __future__ import annotations

import json
from base64 import b64encode
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from PySide6.QtWidgets import QApplication

from gui.live.navigation import SPANS_S
from gui.shell.main_window import MainWindow
from gui.shell.user_settings import UserSettings
from gui.widgets.theme import ThemeChoice, scale_texts
from tests.gui.fake_engine import FakeEngine
from tests.gui.steps import own_window, wait_until

KEYS = (
    "theme", "text_percent", "window", "docks", "speed_mm_s", "force_g", "save_in", "record_in",
    "pictures_in", "scans_in", "span_s", "unit", "rates_per_mm", "sessions", "rigs", "alarm_sound",
    "protocol/operator", "protocol/sensor", "protocol/plate_lot", "protocol/project",
    "protocol/remarks", "finger/operator", "finger/sensor", "finger/remarks",
)  # fmt: skip
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=30),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=2),
    max_leaves=5,
)
NASTY = st.sampled_from(
    ["1" + "0" * 400, "NaN", "-Infinity", "1e999", '"\\ud800"', '"a\\u0000b"', "[" * 3000, "true",
     '["\\ud800"]', '["a\\nb"]', "@Variant(\\0\\0\\0\\x7f)", "@Invalid()", "a, b", "-1", "1e9"]
)  # fmt: skip
VALUE = JSON.map(json.dumps) | NASTY | st.binary(max_size=60).map(lambda b: b64encode(b).decode())
FILES = st.binary(max_size=200) | st.dictionaries(st.sampled_from(KEYS), VALUE).map(
    lambda values: _ini(values)
)
pytestmark = pytest.mark.qt_log_ignore("^QVariant::load: unknown user type", extend=True)
"""QSettings says so of a damaged value before it leaves it out."""
MEETS_FIXTURE = [HealthCheck.function_scoped_fixture]


def _ini(values: dict[str, str]) -> bytes:
    """Return a file with these texts as they stand, sections included."""
    general = "".join(f"{key}={text}\n" for key, text in values.items() if "/" not in key)
    nested = "".join(f"{key.split('/')[1]}={text}\n" for key, text in values.items() if "/" in key)
    return f"[General]\n{general}[protocol]\n{nested}".encode(errors="replace")


@given(FILES)
@settings(max_examples=300, deadline=None)
def test_any_file_yields_values_of_the_asked_type_in_their_range(content: bytes) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder, "window.ini")
        path.write_bytes(content)
        memory = UserSettings(path)
        for key in KEYS:
            assert 0.0 <= memory.value(key, 1.5, lambda n: 0.0 <= n <= 2.0) <= 2.0
            assert memory.value(key, 1, lambda n: n in (1, 2)) in (1, 2)
            memory.value(key, "x").encode()
            "".join(memory.recent(key)).encode()
        memory.add_recent("sessions", "/data/one")
        assert memory.recent("sessions")[0] == "/data/one"
        memory.write()


@example(b"\x00\xff[")
@example(_ini(dict.fromkeys(KEYS, "1" + "0" * 400)))
@example(_ini(dict.fromkeys(KEYS, "NaN")))
@example(_ini(dict.fromkeys(KEYS, "1e9")))
@example(_ini(dict.fromkeys(KEYS, '"\\ud800\\u0000"')))
@example(_ini(dict.fromkeys(KEYS, '["\\ud800"]')))
@given(st.dictionaries(st.sampled_from(KEYS), VALUE).map(_ini))
@settings(max_examples=6, deadline=None, suppress_health_check=MEETS_FIXTURE)
def test_window_opens_whole_with_any_file(
    qapp: QApplication, engine: FakeEngine, content: bytes
) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder, "window.ini")
        path.write_bytes(content)
        with own_window(engine, UserSettings(path)) as window:
            window.show()
            QApplication.processEvents()
            _check_whole(window)
            window.rigs.menu.aboutToShow.emit()
            window.sessions.menu.aboutToShow.emit()
        scale_texts(1.0)


def _check_whole(window: MainWindow) -> None:
    operate = window.operate_panel
    for box in (operate.speed, operate.force):
        assert box.minimum() <= box.value() <= box.maximum()
    assert window.live_plots.navigation.span_s in SPANS_S
    assert not window.docks.docks["log"].isHidden()
    stop = window.toolbar.stop_button
    assert window.rect().contains(stop.mapTo(window, stop.rect().bottomRight()))


@pytest.mark.parametrize(
    ("key", "text"), [("force_g", "1e9"), ("span_s", "3"), ("docks", '"QUJD"')]
)
def test_value_out_of_range_is_named_and_falls_back(
    qapp: QApplication, engine: FakeEngine, tmp_path: Path, key: str, text: str
) -> None:
    path = tmp_path / "window.ini"
    path.write_text(f"[General]\n{key}={text}\n")
    with own_window(engine, UserSettings(path)) as window:
        assert f"the setting {key!r} is damaged" in window.event_log.toPlainText()
        assert window.operate_panel.force.value() < 1000
        assert window.live_plots.navigation.span_s == 10


def test_views_and_rigs_return(qapp: QApplication, engine: FakeEngine, tmp_path: Path) -> None:
    path = tmp_path / "window.ini"
    with own_window(engine, UserSettings(path)) as window:
        window.live_page.bar.span.setCurrentText("5 s")
        window.live_page.bar.span.activated.emit(2)
        window.live_page.bar.unit.setCurrentText("volts")
        window.live_page.encoder_strip.per_mm.click()
        themes = {
            action.text(): action for menu, action in window.menus.actions() if "Theme" in menu
        }
        themes[ThemeChoice.DARK.value].trigger()
        window.toolbar.rig.choose("/data/bench/rig.toml")
        window.toolbar.connect_requested.emit("/data/bench/rig.toml", "")
        wait_until(lambda: window.engine_link.live is not None)  # what did not open is not recent
    assert UserSettings(path).value("theme", "") == ThemeChoice.DARK.name
    with own_window(engine, UserSettings(path)) as again:
        assert again.live_plots.navigation.span_s == 5
        assert again.live_page.bar.unit.currentText() == "volts"
        assert again.live_page.encoder_strip.per_mm.isChecked()
        again.rigs.menu.aboutToShow.emit()
        again.rigs.menu.actions()[0].trigger()
        assert again.toolbar.rig.currentData() == "/data/bench/rig.toml"
