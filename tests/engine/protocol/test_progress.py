"""The remaining time of a run follows its pace, whatever it waits for."""

from __future__ import annotations

from rigctl.engine.progress import RunProgress
from rigctl.finger.plan import parse_finger_protocol
from rigctl.finger.progress import FingerProgress
from rigctl.finger.values import Stage
from rigctl.values import PlannedTrial
from tests.engine.engine_harness import EngineHarness, until_ended
from tests.finger.harness import SMALL

WINDOW_S, OVERHEAD_S = 2.0, 4.0
TRIALS = [PlannedTrial(number, "A", 120.0, 500.0, number, 240.0) for number in range(1, 41)]
ONE_PLATE = """
name = "one-plate"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 4
"""


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def make_progress(clock: Clock) -> RunProgress:
    planned_s = len(TRIALS) * (WINDOW_S + OVERHEAD_S)
    return RunProgress(TRIALS, frozenset(), planned_s, clock)


def test_the_remaining_time_stands_still_during_a_pause() -> None:
    clock = Clock()
    progress = make_progress(clock)
    for trial in TRIALS[:10]:
        clock.now_s += WINDOW_S + OVERHEAD_S
        progress.commit(trial)
    before_s = progress.eta_s()
    assert before_s == 30 * (WINDOW_S + OVERHEAD_S)
    with progress.idle():
        clock.now_s += 720
        assert progress.eta_s() == before_s
    assert progress.eta_s() == before_s


def test_homing_before_the_first_trial_is_not_expected_before_each() -> None:
    clock = Clock()
    progress = make_progress(clock)
    clock.now_s += 25
    for trial in TRIALS[:5]:
        clock.now_s += WINDOW_S + OVERHEAD_S
        progress.commit(trial)
        assert progress.eta_s() == (40 - trial.trial_id) * (WINDOW_S + OVERHEAD_S)


def test_a_skipped_trial_says_nothing_of_the_pace() -> None:
    """Ten skipped trials counted as done in no time, and promised an end that was too early."""
    clock = Clock()
    progress = make_progress(clock)
    for trial in TRIALS[:4]:
        clock.now_s += WINDOW_S + OVERHEAD_S
        progress.commit(trial)
    for trial in TRIALS[20:30]:
        progress.skip(trial, was_in_hand=False)
    assert progress.eta_s() == 26 * (WINDOW_S + OVERHEAD_S)
    clock.now_s += WINDOW_S / 2
    progress.skip(TRIALS[4], was_in_hand=True)
    clock.now_s += WINDOW_S + OVERHEAD_S
    progress.commit(TRIALS[5])
    assert progress.eta_s() == 24 * (WINDOW_S + OVERHEAD_S)


def test_the_pace_is_that_of_the_trials_done_with_their_repeats() -> None:
    clock = Clock()
    progress = make_progress(clock)
    for trial in TRIALS[:11]:
        clock.now_s += WINDOW_S + OVERHEAD_S + (trial.trial_id % 2 == 0) * 4.0
        progress.commit(trial)
    assert progress.eta_s() == 29 * (WINDOW_S + OVERHEAD_S + 2.0)


def test_the_scans_done_set_the_pace_of_the_finger() -> None:
    """The time left grew while a person took long over a scan, and fell at its end."""
    clock = Clock()
    plan = parse_finger_protocol(SMALL, "small").plan(list(Stage))
    progress = FingerProgress(plan, frozenset(), clock)
    for _ in range(2):
        clock.now_s += 9
        progress.commit()
    clock.now_s += 100
    assert progress.eta_s() == 9 * (len(plan.trials) - 2)


def test_only_a_trial_of_this_sitting_has_an_age() -> None:
    clock = Clock()
    progress = RunProgress(TRIALS, frozenset({1, 2, 3}), 240.0, clock)
    assert progress.committed == 3 and progress.trial_age_s() is None
    progress.commit(TRIALS[3])
    clock.now_s += 7
    assert progress.trial_age_s() == 7


def test_neither_a_question_nor_a_pause_adds_to_the_time_left(harness: EngineHarness) -> None:
    left_s: list[float] = []

    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None

        def note() -> None:
            eta_s = run.status().eta_s
            assert eta_s is not None
            left_s.append(eta_s)

        await harness.until(lambda: run.status().prompt is not None)
        await harness.wait(90)
        run.control.answer(1, "ok")
        await harness.until(lambda: run.status().trials_committed == 2)
        note()
        run.control.pause()
        await harness.until(lambda: run.status().state == "paused")
        note()
        await harness.wait(90)
        note()
        run.control.resume()
        await until_ended(harness)

    harness.run(scenario, harness.request(ONE_PLATE, yes=False))
    before_s, at_pause_s, after_s = left_s
    assert before_s < 40
    assert abs(at_pause_s - after_s) < 1 and after_s < 60
