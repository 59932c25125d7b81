"""Conditions that end before their repeats: in a run, after it, and without the process."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import threading
from collections.abc import Iterator
from math import inf, sqrt
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rigctl.cli import main
from rigctl.config.rig_config import RigConfig
from rigctl.engine.early_end import PRIOR_TRIALS, half_width, judge_folder
from rigctl.engine.run_request import RunRequest
from rigctl.errors import SessionError, WrongUse
from rigctl.protocol.plan import EarlyEnd
from rigctl.session.notes import Mark, SessionNote
from rigctl.session.session import EARLY_END_KIND, Session, add_note, ended_early
from rigctl.session.summary import summarise_session
from rigctl.session.verify import verify
from tests.engine.engine_harness import (
    EngineHarness,
    open_harness,
    open_session,
    until_ended,
)

RULE = """
name = "early"
textures = ["A", "L"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 9
[trial]
travel_mm = 60
[early_end]
half_width_hz = {width}
least_trials = 5
"""
WIDE, NARROW = RULE.format(width=900), RULE.format(width=0.01)
LONG_S = 1e6
"""Loop time that may pass while the process starts: simulated time is fast."""
PROCESS_FIRST_S = 0.05
"""For which simulated time stops between two polls, or it would take the process's processor."""


def calibrated() -> RigConfig:
    nominal = RigConfig()
    taxels = dataclasses.replace(nominal.taxels, low=(80,) * 18, high=(160,) * 18)
    return dataclasses.replace(nominal, taxels=taxels)


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[EngineHarness]:
    with open_harness(tmp_path, config=calibrated()) as harness:
        yield harness


async def until_judged(harness: EngineHarness, committed: int) -> None:
    """Pause after so many trials, until the process has judged them; then go on."""
    run, early_end = harness.engine.run, harness.engine.early_end
    assert run is not None and early_end is not None
    await harness.until(lambda: run.status().trials_committed >= committed)
    run.control.pause()

    def has_ended() -> bool:
        return run.status().trials_ended_early > 0

    def is_judged() -> bool:
        if early_end.has_decided or has_ended():
            return True
        wait([early_end._pipe], PROCESS_FIRST_S)
        return False

    await harness.until(is_judged, LONG_S)
    run.control.resume()
    await harness.until(has_ended)


def messages(harness: EngineHarness, kind: str) -> list[str]:
    return [event.text for event in harness.events if event.kind == kind]


def test_a_condition_ends_early_and_the_session_is_whole(rig: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_judged(harness, 6)
        await until_ended(harness)

    rig.run(scenario, rig.request(WIDE))
    run = rig.engine.run
    assert run is not None and run.complete and run.outcome == "done"
    status = run.status()
    assert status.trials_ended_early >= 2 and status.is_complete
    (text, *_) = messages(rig, EARLY_END_KIND)
    assert text.startswith("A, 120 mm/s, 500 g ends early after ") and "mean SA rate" in text
    with open_session(rig.session) as session:
        reasons = ended_early(session)
        assert len(reasons) == status.trials_ended_early and text in reasons.values()
        ids = set(session.trials["trial_id"][session.committed()].tolist())
        assert ids | set(reasons) == set(range(1, 19)) and not ids & set(reasons)
    report = verify(rig.session)
    assert report.whole and report.outcome == "finished", report.problems
    assert any("not recorded" in note for note in report.notes)
    assert not any("are not committed" in note for note in report.notes)
    summary = summarise_session(rig.session)
    assert summary["trials_ended_early"] == len(reasons) and summary["trials_remaining"] == 0
    with pytest.raises(SessionError, match=r"is complete.*ended early"):
        rig.engine.start(RunRequest(resume=str(rig.session), yes=True))


def test_a_resumed_session_leaves_out_what_ended_early(tmp_path: Path) -> None:
    async def stop_at_plate_l(harness: EngineHarness) -> None:
        await until_judged(harness, 6)
        run = harness.engine.run
        assert run is not None
        run.control.abort("for the test")
        await until_ended(harness)

    with open_harness(tmp_path, config=calibrated()) as first:
        first.run(stop_at_plate_l, first.request(WIDE))
        session_folder = first.session
    with open_session(session_folder) as session:
        left_out = set(ended_early(session))
    assert left_out and max(left_out) <= 9
    with open_harness(tmp_path, config=calibrated()) as second:

        async def scenario(harness: EngineHarness) -> None:
            run = harness.engine.run
            assert run is not None and run.status().trials_ended_early == len(left_out)
            await until_ended(harness)

        second.run(scenario, RunRequest(resume=str(session_folder), yes=True))
        assert second.engine.run is not None and second.engine.run.complete
    with open_session(session_folder) as session:
        assert not left_out & set(session.trials["trial_id"][session.committed()].tolist())
    assert verify(session_folder).whole


def test_a_trial_marked_bad_takes_the_end_back(rig: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_judged(harness, 6)
        await until_ended(harness)

    rig.run(scenario, rig.request(WIDE))
    with open_session(rig.session) as session:
        ends = session.events_of(EARLY_END_KIND)
        of_a = next(e for e in ends if e.data["texture"] == "A")
        counted = session.trials["trial_id"][session.committed()].tolist()
    bad = [trial_id for trial_id in counted if trial_id <= 9][of_a.data["trials"] - 1 :]
    for trial_id in bad:
        add_note(rig.session, SessionNote("2026-01-02T05:00:00Z", "slipped", trial_id, 0, Mark.BAD))
    with open_session(rig.session) as session:
        assert not {9} & set(ended_early(session))
    assert any("are not committed" in note for note in verify(rig.session).notes)


def test_a_rule_that_never_fires_records_every_trial(
    rig: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = rig.record(NARROW)
    assert run.complete and run.status().trials_ended_early == 0
    assert verify(rig.session).trials_committed == 18
    assert not messages(rig, EARLY_END_KIND)
    _judge_a_folder_that_fails_once(rig.session, monkeypatch)


def _judge_a_folder_that_fails_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A share that is away for a moment ends no judging: the process looks again."""
    refresh, failures = Session.refresh, [SessionError("the share is away"), OSError("stale")]

    def fail_first(session: Session) -> None:
        if failures:
            raise failures.pop()
        refresh(session)

    monkeypatch.setattr(Session, "refresh", fail_first)
    near, far = multiprocessing.Pipe()
    rule = EarlyEnd(half_width_hz=0.01)
    judging = threading.Thread(target=judge_folder, args=(far, folder, rule))
    judging.start()
    assert near.poll(60) and near.recv() == 18
    near.close()
    judging.join(60)
    far.close()
    assert not failures and not judging.is_alive()


def test_a_process_that_dies_ends_nothing_and_the_log_says_so(rig: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        early_end = harness.engine.early_end
        assert early_end is not None
        early_end.process.kill()
        await until_ended(harness)

    rig.run(scenario, rig.request(WIDE))
    assert rig.engine.run is not None and rig.engine.run.status().trials_committed == 18
    assert sum("judges the conditions has ended" in text for text in messages(rig, "log")) == 1


def test_a_client_may_end_a_condition_within_the_rule(rig: EngineHarness) -> None:
    end: dict[str, Any] = {
        "texture": "A",
        "speed_mm_s": 120.0,
        "force_g": 500.0,
        "trials": 5,
        "mean_hz": 10.0,
        "half_width_hz": 0.005,
    }

    async def scenario(harness: EngineHarness) -> None:
        run, handle = harness.engine.run, harness.handle
        assert run is not None
        await harness.until(lambda: run.status().trials_committed == 5)
        for wrong in ({"trials": 4}, {"half_width_hz": 1.0}, {"trials": 8}, {"texture": "L"}):
            with pytest.raises(WrongUse):
                await handle("end_condition", {**end, **wrong})
        await handle("end_condition", end)
        assert run.status().trials_ended_early == 3
        with pytest.raises(WrongUse, match="trial 8 is left out: its condition ended early"):
            await handle("repeat", {"trial_id": 8})
        await handle("repeat", {"trial_id": 2})
        await until_ended(harness)
        assert run.complete and "every condition is recorded; 3 trials" in run.text
        with pytest.raises(WrongUse, match="no run is active"):
            await handle("end_condition", end)

    rig.run(scenario, rig.request(NARROW))
    with open_session(rig.session) as session:
        assert set(ended_early(session)) == {7, 8, 9}


def test_without_a_range_the_rule_is_refused_before_anything_moves(harness: EngineHarness) -> None:
    path = harness.request(WIDE).protocol
    with pytest.raises(WrongUse, match=r"under \[taxels\]"):
        harness.engine.start(RunRequest(protocol=path, out=str(harness.session), yes=True))


def test_check_says_the_most_and_the_fewest_and_synth_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "early.toml"
    path.write_text(WIDE)
    assert main(["check", str(path)]) == 0
    assert "10 trials at least" in capsys.readouterr().out
    assert main(["check", str(path), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["trials"], summary["fewest_trials"]) == (18, 10)
    assert main(["synth", "--plan", str(path), "--seed", "1", "--out", str(tmp_path / "s")]) == 2
    assert "remove the table" in capsys.readouterr().err


def test_the_ends_are_where_the_mixture_ratio_is_one_over_alpha() -> None:
    values = np.random.default_rng(0).normal(30, 2, 9)
    n, prior = len(values), PRIOR_TRIALS
    shifted = values - (values.mean() + half_width(values.tolist(), 95))
    squares, total = float(shifted @ shifted), float(shifted.sum())
    ratio = sqrt(prior / (n + prior)) * (squares / (squares - total**2 / (n + prior))) ** (n / 2)
    assert abs(ratio - 20) < 1e-9
    assert half_width([1.0], 95) == half_width([0.0] * 20, 95) == inf


def test_stopping_when_it_is_narrow_keeps_the_promise_that_students_breaks() -> None:
    random = np.random.default_rng(4)
    right = {"sequence": 0, "student": 0}
    runs = 400
    for _ in range(runs):
        values = random.normal(0, 1, 200)
        for name, width in (("sequence", half_width), ("student", student)):
            stop = next(n for n in range(5, 201) if width(values[:n].tolist(), 95) < 0.6)
            right[name] += abs(float(values[:stop].mean())) < width(values[:stop].tolist(), 95)
    assert right["sequence"] / runs > 0.95
    assert right["student"] / runs < 0.93


def student(values: list[float], confidence_percent: float) -> float:
    n = len(values)
    t = float(stats.t.ppf(0.5 + confidence_percent / 200, n - 1))
    return t * float(np.std(values, ddof=1)) / sqrt(n)
