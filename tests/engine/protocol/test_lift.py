"""Repeats of a condition in one contact: when the drum lifts, and that each trial is as true."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from rigctl.analysis.session_quality import judge_session
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.world_file import SimulatedWorld
from rigctl.boards.drum_states import State
from rigctl.config.rig_config import RigConfig
from rigctl.engine.contact import PRESSING_STATES
from rigctl.engine.run_request import RunRequest
from rigctl.protocol.loader import parse_protocol
from rigctl.rig import open_rig
from rigctl.session.verify import verify
from rigctl.values import DrumState
from tests.engine.engine_harness import (
    EngineHarness,
    engine_on,
    open_harness,
    open_session,
    until_ended,
)
from tests.engine.protocol.test_interruptions import drum_state, until_turning, verdicts

STAYING = """
name = "staying"
textures = ["B"]
speeds_mm_s = [100, 120]
forces_g = [500]
repeats = 3
[trial]
lift = "condition"
"""
ALTERNATING = STAYING + 'direction = "alternate"\n'
COMMITTED = [(trial, "committed") for trial in range(1, 7)]


def polled(harness: EngineHarness, protocol: str) -> list[DrumState]:
    """Record a protocol; return the polls from its first approach on."""
    polls: list[DrumState] = []
    harness.engine.boards.drum_poller.subscribe(polls.append)
    harness.record(protocol)
    first = next(n for n, poll in enumerate(polls) if poll.state == State.APPROACH)
    return polls[first:]


def approaches(polls: list[DrumState]) -> int:
    """Return how often the drum approached the sensor."""
    states = [State.ARMED, *(State(poll.state) for poll in polls)]
    return sum(b == State.APPROACH != a for a, b in pairwise(states))


def test_the_drum_lifts_when_the_condition_changes(harness: EngineHarness) -> None:
    polls = polled(harness, STAYING)
    assert approaches(polls) == 2
    assert verdicts(harness) == COMMITTED
    assert verify(harness.session).whole
    with open_session(harness.session) as session:
        for index in range(6):
            row, drum = session.trial_row(index), session.drum(index)
            assert row.mean_force_g == pytest.approx(500, rel=0.01)
            assert row.mean_speed_mm_s == pytest.approx(row.trial.speed_mm_s, rel=1e-3)
            before = drum.loadcell["force_g"][(drum.loadcell_s > -0.3) & (drum.loadcell_s < 0)]
            assert before.mean() == pytest.approx(500, rel=0.05), "settled before the window"


@pytest.mark.parametrize("protocol", [STAYING, ALTERNATING], ids=["forward", "alternate"])
def test_windows_open_where_they_do_when_the_drum_lifts(tmp_path: Path, protocol: str) -> None:
    config = SimulatedWorld().rig_config()
    places_mm: list[list[float]] = []
    for lift in ("condition", "trial"):
        (folder := tmp_path / lift).mkdir()
        with open_harness(folder, config=config) as harness:
            harness.record(protocol.replace('"condition"', f'"{lift}"'))
            places_mm.append([])
            with open_session(harness.session) as session:
                for index in range(6):
                    polls = session.drum(index, 0.0, 0.5).polls
                    rise_s = (polls["board_time_us"] - polls["sync_rise_us"])[2] * 1e-6
                    way_mm = rise_s * session.trial_row(index).trial.speed_mm_s
                    back = session.trial_row(index).trial.direction == "backward"
                    at_mm = polls["angle_deg"][2] * config.drum.circumference_mm / 360
                    places_mm[-1].append(at_mm + (way_mm if back else -way_mm))
    assert places_mm[0] == pytest.approx(places_mm[1], abs=0.15)


def test_alternating_repeats_stay_on_the_plate(tmp_path: Path) -> None:
    with open_harness(tmp_path, config=RigConfig()) as harness:
        polls = polled(harness, ALTERNATING)
        assert approaches(polls) == 2
        drum = RigConfig().drum
        places_mm = [p.angle_deg * drum.circumference_mm / 360 for p in polls
                     if p.state in PRESSING_STATES]  # fmt: skip
        end_mm = drum.plate_start_mm + drum.plate_length_mm
        assert drum.plate_start_mm - 0.1 <= min(places_mm) <= max(places_mm) <= end_mm + 0.1


def pause(harness: EngineHarness) -> None:
    run = harness.engine.run
    assert run is not None
    run.control.pause()


def stall(harness: EngineHarness) -> None:
    harness.rig.faults.stall_computer(0.4)


def reset_taxels(harness: EngineHarness) -> None:
    harness.rig.faults.reset("taxels")


@pytest.mark.parametrize("interrupt", [pause, stall, reset_taxels], ids=lambda act: act.__name__)
def test_an_interruption_in_contact_lifts_and_the_trial_repeats(
    harness: EngineHarness, interrupt: Callable[[EngineHarness], None]
) -> None:
    polls: list[DrumState] = []

    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: len(harness.texts("trial")) == 1)
        await until_turning(harness)
        harness.engine.boards.drum_poller.subscribe(polls.append)
        await harness.wait(0.5)
        interrupt(harness)
        await harness.until(lambda: drum_state(harness) in (State.IDLE, State.FAULT_OFF))
        assert harness.engine.run is not None
        harness.engine.run.control.resume()
        await until_ended(harness)

    harness.run(scenario, harness.request(STAYING))
    found = verdicts(harness)
    assert found[1] in ((2, "aborted"), (2, "rejected"))
    assert [one for one in found if one[1] == "committed"] == COMMITTED
    assert approaches(polls) == 2, "the repeat, and the other condition"
    assert verify(harness.session).whole


def test_a_bad_verdict_lifts(harness: EngineHarness) -> None:
    polls: list[DrumState] = []

    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: len(harness.texts("trial")) == 1)
        harness.engine.boards.drum_poller.subscribe(polls.append)
        await until_turning(harness)
        await harness.wait(2.5)
        harness.rig.faults.drop_bytes("taxels", "to_host", 0.005)
        await harness.wait(0.5)
        harness.rig.faults.drop_bytes("taxels", "to_host", 0.0)
        await until_ended(harness)

    harness.run(scenario, harness.request(STAYING))
    found = verdicts(harness)
    assert found[1] == (2, "rejected")
    assert [one for one in found if one[1] == "committed"] == COMMITTED
    assert approaches(polls) == 2


def test_a_run_that_ended_in_contact_is_resumed(harness: EngineHarness, tmp_path: Path) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: len(harness.texts("trial")) == 2)
        await until_turning(harness)
        assert harness.engine.run is not None
        harness.engine.run.control.abort("enough")
        await until_ended(harness)
        assert drum_state(harness) is State.IDLE

    harness.run(scenario, harness.request(STAYING))
    (tmp_path / "again").mkdir()
    with open_harness(tmp_path / "again") as second:
        second.run(until_ended, RunRequest(resume=str(harness.session), yes=True))
    assert [one for one in verdicts(harness) if one[1] == "committed"] == COMMITTED
    assert verify(harness.session).whole


def test_steps_between_repeats_find_a_lifted_drum(harness: EngineHarness) -> None:
    every = '[[steps]]\nat = "every"\ntrials = 2\nkind = "tare"\n'
    assert approaches(polled(harness, STAYING + every)) == 4
    assert verdicts(harness) == COMMITTED


def test_drift_is_tared_when_the_drum_is_lifted(tmp_path: Path) -> None:
    parameters = replace(WorldParameters(), loadcell_drift_g=3.0, loadcell_drift_s=600.0)
    rig = open_rig("virtual", seed=3, paced=False, world=SimulatedWorld(parameters))
    drift = '[[steps]]\nat = "drift"\nkind = "tare"\nlimit_g = 1\n'
    with engine_on(rig, tmp_path) as harness:
        harness.record(STAYING.replace("= 3", "= 12") + drift)
        assert harness.engine.run is not None and harness.engine.run.complete
        (text,) = harness.texts("tare")
        assert text.startswith("the lifted load cell read ") and text.endswith(" g: tared")


def test_no_tare_comes_without_drift(harness: EngineHarness) -> None:
    harness.record(STAYING + '[[steps]]\nat = "drift"\nkind = "tare"\nlimit_g = 1\n')
    assert harness.texts("tare") == []


def test_a_repeat_in_contact_has_the_last_lifted_baseline(harness: EngineHarness) -> None:
    harness.record(STAYING)
    statistics = [one.statistics for one in judge_session(harness.session).trials]
    baselines = [one.baseline.tolist() for one in statistics if one is not None]
    assert baselines[0] == baselines[1] == baselines[2]
    assert baselines[2] != baselines[3] == baselines[5]


@pytest.mark.parametrize("lift", ["trial", "condition"])
def test_the_estimate_is_what_the_virtual_rig_takes(harness: EngineHarness, lift: str) -> None:
    protocol = STAYING.replace('"condition"', f'"{lift}"')
    first = protocol.replace("[100, 120]", "[100]").replace("= 3", "= 1")
    planned_s, first_s = (
        parse_protocol(text, "staying", SimulatedWorld().rig_config()).plan().duration_s
        for text in (protocol, first)
    )
    harness.record(protocol)
    with open_session(harness.session) as session:
        took_s = float(session.trials["ended_s"].max() - session.trials["ended_s"].min())
    assert took_s == pytest.approx(planned_s - first_s, rel=0.03)
