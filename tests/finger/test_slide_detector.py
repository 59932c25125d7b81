"""Where a scan begins and ends in the track, and what breaks it off."""

from __future__ import annotations

import pytest

from rigctl.finger.slide_detector import SlideDetector, SlideState

STEP_S = 0.01


class Track:
    """Positions of a finger every 10 ms, which arrive at once."""

    def __init__(self) -> None:
        self.detector = SlideDetector()
        self.now_s = 0.0
        self.along_mm = 30.0

    def move(self, mm_s: float, to_mm: float, height_mm: float = 5.0) -> SlideState:
        """Move at a speed up to a place; return the state there."""
        state = self.detector.state
        while (to_mm - self.along_mm) * mm_s > 0:
            self.along_mm += mm_s * STEP_S
            state = self.add(height_mm)
        return state

    def add(self, height_mm: float = 5.0, across_mm: float = 0.0) -> SlideState:
        self.now_s += STEP_S
        return self.detector.add(self.now_s, self.now_s, self.along_mm, across_mm, height_mm)


def test_a_scan_is_between_the_marks() -> None:
    track = Track()
    assert track.move(100.0, 49.0) is SlideState.READY
    assert track.move(100.0, 52.0) is SlideState.INSIDE
    assert track.move(100.0, 248.0) is SlideState.INSIDE
    assert track.move(100.0, 252.0) is SlideState.AWAY
    assert track.detector.broken == ""


def test_late_positions_are_extrapolated_to_the_present() -> None:
    detector = SlideDetector()
    states = [
        detector.add(0.01 * i + 0.03, 0.01 * i, 40.0 + i, 0.0, 5.0) for i in range(12)
    ]  # 100 mm/s, 30 ms late: 3 mm
    assert states.index(SlideState.INSIDE) == 7


def test_a_finger_that_was_not_before_the_first_mark_begins_no_scan() -> None:
    track = Track()
    track.along_mm = 100.0
    assert track.move(100.0, 260.0) is SlideState.AWAY


@pytest.mark.parametrize(("height_mm", "across_mm"), [(40.0, 0.0), (5.0, 40.0)])
def test_a_finger_that_is_not_on_the_plate_begins_no_scan(
    height_mm: float, across_mm: float
) -> None:
    track = Track()
    track.add()
    track.along_mm = 51.0
    assert track.add(height_mm, across_mm) is SlideState.AWAY


def test_a_finger_that_runs_back_breaks_the_scan_off() -> None:
    track = Track()
    track.move(100.0, 120.0)
    assert track.move(-100.0, 116.0) is SlideState.INSIDE, "a hand trembles"
    assert track.move(-100.0, 113.0) is SlideState.AWAY
    assert track.detector.broken == "the finger moved backwards"


def test_a_finger_that_stands_still_breaks_the_scan_off() -> None:
    track = Track()
    track.move(100.0, 120.0)
    states = [track.add() for _ in range(105)]
    assert states[95] is SlideState.INSIDE
    assert states[-1] is SlideState.AWAY
    assert track.detector.broken == "the finger stood still for 1 s"


def test_a_lifted_finger_breaks_the_scan_off() -> None:
    track = Track()
    track.move(100.0, 150.0)
    assert track.add(height_mm=30.0) is SlideState.AWAY
    assert track.detector.broken == "the finger left the plate after 100 mm"


def test_silence_breaks_a_scan_off_and_nothing_else() -> None:
    track = Track()
    track.move(100.0, 40.0)
    assert track.detector.check_silence(track.now_s + 60.0) is SlideState.READY
    track.move(100.0, 120.0)
    assert track.detector.check_silence(track.now_s + 0.9) is SlideState.INSIDE
    assert track.detector.check_silence(track.now_s + 1.1) is SlideState.AWAY
    assert track.detector.broken == "no position of the finger for 1 s"
