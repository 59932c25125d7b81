"""The Analysis tab opens what is there of a session, says what is not, and forgets failed ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.gui.steps import Harness, click, wait_until
from tests.session.damage import record_four_parts, truncate, zero

pytestmark = pytest.mark.usefixtures("leave_nothing")


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """Return a session of four parts with two trials each."""
    record_four_parts(tmp_path / "s")
    return tmp_path / "s"


def open_session(harness: Harness, path: str | Path) -> None:
    """Type a folder and press Open."""
    harness.window.show_panel("analysis")
    panel = harness.window.analysis_tab.panel
    panel.folder.setText(str(path))
    click(panel.open_button)
    wait_until(lambda: not harness.window.analysis_tab.reader.is_busy)


@pytest.mark.parametrize("number", [1, 2, 4])
@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (Path.unlink, "is missing"),
        (lambda path: truncate(path, 0.5), "is damaged"),
        (zero, "is damaged"),
    ],
)
def test_what_is_not_there_is_said_beside_what_is(
    harness: Harness,
    session: Path,
    number: int,
    damage: Callable[[Path], None],
    sentence: str,
) -> None:
    name = f"part-000{number}.h5"
    damage(session / name)
    open_session(harness, session)
    panel = harness.window.analysis_tab.panel
    assert panel.model.rowCount() == 6
    assert "6 of 8 trials committed" in panel.about.text()
    assert panel.missing.isVisible() and panel.missing.property("role") == "warn"
    assert panel.missing.text().startswith("⚠ Incomplete: ")
    assert f"{name} {sentence}" in panel.missing.text()
    if number == 4:
        assert panel.digest.text() == ""


def test_a_whole_session_has_no_warning(harness: Harness, session: Path) -> None:
    open_session(harness, session)
    panel = harness.window.analysis_tab.panel
    assert panel.model.rowCount() == 8
    assert not panel.missing.isVisible() and len(panel.digest.text()) == 64


def test_a_failed_open_leaves_nothing_of_the_session_before(
    harness: Harness, session: Path, tmp_path: Path
) -> None:
    open_session(harness, session)
    (session / "part-0001.h5").rename(tmp_path / "aside")
    for path in session.glob("part-*.h5"):
        zero(path)
    open_session(harness, session)
    panel, view = harness.window.analysis_tab.panel, harness.window.analysis_tab.trial_view
    assert "part-0002.h5 is damaged" in panel.about.text()
    assert panel.about.property("role") == "bad"
    assert panel.model.rowCount() == 0 and panel.digest.text() == ""
    assert not panel.missing.isVisible() and not panel.run_box.run_button.isEnabled()
    assert panel.run_box.form.sessions == ()
    assert view.data is None


def test_empty_fields_are_refused_in_a_sentence(harness: Harness, session: Path) -> None:
    open_session(harness, session)
    panel, box = harness.window.analysis_tab.panel, harness.window.analysis_tab.panel.run_box
    box.method.setCurrentIndex(box.method.findText("A trained model"))
    box.model.setText("  ")
    click(box.run_button)
    assert "choose a model file" in box.result.text()
    assert box.result.property("role") == "bad"
    assert not harness.window.analysis_tab.worker.is_busy and panel.model.rowCount() == 8
    open_session(harness, "")
    assert "choose a session's folder" in panel.about.text()
    open_session(harness, "~no-such-user/session")
    assert "~no-such-user/session" in panel.about.text()
    assert "unexpected" not in harness.window.event_log.toPlainText()
