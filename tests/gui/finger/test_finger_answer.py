"""The answer grows with the scan, and says right or wrong by colour, mark and words."""

from __future__ import annotations

from typing import Any

import pytest
from PySide6.QtGui import QColor
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QWidget

from gui.widgets.theme import LIGHT
from tests.gui.fake_finger import RUNNING
from tests.gui.steps import FingerWindow, wait_until


def _begin(finger: FingerWindow, texture: str = "B", profile: str = "slow") -> None:
    finger.engine.send_instruction(texture, profile)
    finger.engine.send_batch(1, 60.0, 6.0)
    finger.update(run=RUNNING)


def _background(finger: FingerWindow) -> str:
    image = finger.tab.view.answer.grab().toImage()
    return str(QColor(image.pixelColor(image.width() - 12, image.height() // 2)).name())


def _shown(finger: FingerWindow) -> list[dict[str, Any]]:
    return [args for command, args in finger.engine.requests if command == "shown"]


def test_growing_answer_is_neither_right_nor_wrong(finger: FingerWindow) -> None:
    _begin(finger)
    finger.engine.send_prediction("D", 0.6)
    finger.window.poll()
    answer = finger.tab.view.answer
    assert (answer.letter.text(), answer.mark.text(), answer.state) == ("D", "…", "growing")
    assert answer.verdict.text().startswith("so far (60")
    assert answer.decision.text() == "Not sure yet"
    assert _background(finger) == LIGHT.panel


@pytest.mark.parametrize(
    ("texture", "mark", "words", "colour"),
    [
        ("B", "✓", "right (90\u202f%)", LIGHT.right_back),
        ("N", "✗", "wrong: the plate is B (90\u202f%)", LIGHT.wrong_back),
    ],
)
def test_final_answer_has_three_cues(
    finger: FingerWindow, texture: str, mark: str, words: str, colour: str
) -> None:
    _begin(finger)
    finger.engine.send_prediction(texture, 0.9, is_final=True)
    finger.window.poll()
    answer = finger.tab.view.answer
    assert answer.letter.text() == texture
    assert answer.mark.text() == mark
    assert answer.verdict.text() == words
    assert _background(finger) == colour


def test_unknown_plate_gets_no_name(finger: FingerWindow) -> None:
    _begin(finger)
    finger.engine.send_prediction("B", 0.7, is_final=True, known=False)
    finger.window.poll()
    answer = finger.tab.view.answer
    assert (answer.letter.text(), answer.mark.text(), answer.state) == ("?", "⚠", "unknown")
    assert "not one of these; nearest is B" in answer.verdict.text()
    assert _background(finger) == LIGHT.unsure_back


def test_answer_is_judged_by_the_plate_of_its_own_scan(finger: FingerWindow) -> None:
    _begin(finger)
    finger.engine.send_prediction("B", 0.9, is_final=True)
    finger.engine.send_instruction("L", "fast")  # the next trial, before its scan begins
    finger.window.poll()
    assert finger.tab.view.answer.state == "right"
    finger.engine.scan = 2
    finger.engine.send_batch(1, 150.0, 15.0)
    finger.window.poll()
    assert finger.tab.view.answer.state == "none"
    finger.engine.send_prediction("B", 0.9, is_final=True)
    finger.window.poll()
    assert finger.tab.view.answer.verdict.text().startswith("wrong: the plate is L")


def test_probabilities_and_set_follow_every_batch(finger: FingerWindow) -> None:
    _begin(finger)
    view = finger.tab.view
    for share, members in ((0.4, ["B", "D", "N"]), (0.8, ["B"])):
        finger.engine.send_prediction("B", share, texture_set=members)
        finger.window.poll()
        assert view.bars.probabilities["B"] == share
        assert sum(view.bars.probabilities.values()) == pytest.approx(1)
        named = f"95\u202f% set: {', '.join(members)} ({len(members)} of 5)"
        assert view.answer.texture_set.text() == named


def test_set_has_the_coverage_of_the_run(finger: FingerWindow) -> None:
    _begin(finger)
    finger.update(run={"coverage": 0.8})
    finger.engine.send_prediction("B", 0.7, texture_set=["B", "D"])
    finger.window.poll()
    assert finger.tab.view.answer.texture_set.text() == "80\u202f% set: B, D (2 of 5)"


def test_time_to_decision_is_that_of_the_first_sure_answer(finger: FingerWindow) -> None:
    _begin(finger)
    for windows, decided in ((4, False), (5, True), (9, True)):
        finger.engine.send_prediction(
            "B", 0.9, decided=decided, seconds=windows / 6, distance_mm=10.0 * windows
        )
    finger.window.poll()
    assert finger.tab.view.answer.decision.text() == "Sure of B after 0.83 s, 50 mm"


def test_painted_answer_is_reported_once(finger: FingerWindow) -> None:
    _begin(finger)
    finger.engine.send_prediction("B", 0.5, sent_s=41.25)
    finger.window.poll()
    wait_until(lambda: len(_shown(finger)) > 0)
    finger.tab.view.answer.repaint()
    QTest.qWait(50)
    assert _shown(finger) == [{"scan": 1, "sent_s": 41.25}]


def test_answer_that_nobody_sees_is_not_reported(finger: FingerWindow) -> None:
    _begin(finger)
    finger.window.show_panel("operate")
    finger.engine.send_prediction("B", 0.5)
    finger.window.poll()
    QTest.qWait(50)
    assert _shown(finger) == []


def _colours(widget: QWidget) -> set[str]:
    image = widget.grab().toImage()
    return {
        image.pixelColor(x, y).name() for x in range(image.width()) for y in range(image.height())
    }


def test_accuracy_and_confusion_are_those_of_the_run(finger: FingerWindow) -> None:
    confusion = {true: dict.fromkeys("ABDLN", 0) for true in "ABDLN"}
    confusion["B"]["B"], confusion["B"]["N"], confusion["A"]["A"] = 2, 1, 1
    finger.update(run={**RUNNING, "classified": 4, "correct": 3, "confusion": confusion})
    words = finger.tab.view.confusion.accuracy.text()
    assert words == "Right: 3 of 4 (75\u202f%, guessing 20\u202f%)"
    assert len(_colours(finger.tab.view.confusion.matrix)) > 4


def test_a_repeated_scan_keeps_its_number_everywhere(finger: FingerWindow) -> None:
    """The answer had the board's number, which counts attempts, and the task the next free one."""
    finger.engine.scan = 15
    finger.engine.send_instruction("B", "slow", trial_id=12, attempt=2)
    finger.engine.send_batch(1, 60.0, 6.0)
    finger.engine.send_prediction("D", 0.6)
    scan = {**RUNNING["scan"], "attempt": 2}
    finger.update(run={**RUNNING, "trials_committed": 10, "scan": scan})
    view = finger.tab.view
    assert view.answer.caption.text().startswith("Scan 12: 70 mm")
    assert view.velocity_title.text().startswith("Velocity in scan 12, attempt 2 (plate B)")
    assert view.progress.text().startswith("run, scan 12 of 25 · attempt 2")
    assert finger.tab.run_box.rows["Scan"].text() == "12, attempt 2: B, slow"


def test_scan_that_does_not_count_says_why(finger: FingerWindow) -> None:
    finger.update(run=RUNNING)
    _begin(finger)
    reasons = ["the tracker was lost for 312 ms", "4 samples are lost"]
    finger.engine.send_event("trial", "scan 1 rejected", verdict="rejected", reasons=reasons)
    finger.window.poll()
    notice = finger.tab.view.notice
    assert notice.isVisibleTo(finger.window)
    assert notice.text().endswith(
        "does not count: the tracker was lost for 312 ms; 4 samples are lost"
    )
    finger.update(run={"state": "aborted", "text": "aborted"})
    assert not notice.isVisibleTo(finger.window), "no scan is made again"
    finger.update(run=RUNNING)
    assert notice.isVisibleTo(finger.window)
    finger.engine.scan = 2
    _begin(finger)
    assert not notice.isVisibleTo(finger.window)
