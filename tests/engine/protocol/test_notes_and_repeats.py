"""Notes during a run, trials that are repeated, and what a run says is coming."""

from __future__ import annotations

from typing import Any

import pytest

from rigctl.boards.drum_states import State
from rigctl.engine.drum_commands import DrumCommands
from rigctl.engine.run_request import RunRequest
from rigctl.errors import RigctlError, WrongUse
from rigctl.session.verify import verify
from tests.engine.engine_harness import EngineHarness, open_session, until_ended

TWO_PLATES = """
name = "two-plates"
textures = ["A", "L"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 2
"""


def handler_of(harness: EngineHarness) -> Any:
    return DrumCommands(harness.engine).handle


async def until_committed(harness: EngineHarness, count: int) -> None:
    await harness.until(lambda: harness.engine.status().run.trials_committed == count)


def test_a_repeated_trial_counts_once_and_the_first_attempt_is_marked(
    harness: EngineHarness,
) -> None:
    plates: list[Any] = []

    async def scenario(harness: EngineHarness) -> None:
        handle = handler_of(harness)
        await until_committed(harness, 1)
        plates.append(harness.engine.status().run.next_plate)
        await handle("repeat", {"trial_id": 1, "text": "the plate slipped"})
        assert harness.engine.status().run.trials_committed == 0
        for wrong in (2, 3, 9):
            with pytest.raises(WrongUse):
                await handle("repeat", {"trial_id": wrong})
        await harness.until(lambda: harness.engine.status().run.next_plate is None)
        with pytest.raises(WrongUse, match="plate A, which is not on"):
            await handle("repeat", {"trial_id": 1})
        await until_ended(harness)
        with pytest.raises(WrongUse, match="no run is active"):
            await handle("repeat", {"trial_id": 1})

    harness.run(scenario, harness.request(TWO_PLATES))
    (plate,) = plates
    assert (plate.texture, plate.trials) in (("L", 0), ("L", 1)) and plate.left_s < 30
    with open_session(harness.session) as session:
        assert session.trials["trial_id"].tolist() == [1, 2, 1, 3, 4]
        counted = session.trials[session.committed()]
        assert counted["trial_id"].tolist() == [1, 2, 3, 4]
        assert counted["attempt"].tolist() == [2, 1, 1, 1]
        assert session.notes[0].text == "the plate slipped"
    report = verify(harness.session)
    assert report.whole and report.trials_committed == 4, report.problems


def test_who_records_and_what_is_noted_is_in_the_session(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        handle = handler_of(harness)
        await until_committed(harness, 1)
        await handle("note", {"text": "someone leans on the table"})
        for wrong in ("", "bell \a", "x" * 2001):
            with pytest.raises(RigctlError):
                await handle("note", {"text": wrong})
        await until_ended(harness)

    request = harness.request(TWO_PLATES)
    told = {"operator": "Jörg", "sensor": "batch 7", "notes": "new skin"}
    harness.run(scenario, RunRequest(request.protocol, request.out, yes=True, **told))
    with open_session(harness.session) as session:
        assert (session.header.operator, session.header.sensor) == ("Jörg", "batch 7")
        assert [note.text for note in session.notes] == ["new skin", "someone leans on the table"]
        assert {note.author for note in session.notes} == {"Jörg"}
    assert verify(harness.session).whole


def test_a_skipped_trial_is_left_and_the_others_are_recorded(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        handle = handler_of(harness)
        await until_committed(harness, 1)
        await handle("skip", {"trial_id": 3})
        with pytest.raises(WrongUse, match="nothing to skip"):
            await handle("skip", {"trial_id": 3})
        await harness.until(lambda: harness.engine.status().run.trial_id == 2)
        await harness.until(lambda: harness.engine.status().state == State.RUN)
        await handle("skip", {})
        await until_ended(harness)
        run = harness.engine.status().run
        assert (run.state, run.trials_committed) == ("done", 2)
        with pytest.raises(WrongUse, match="no run is active"):
            await handle("skip", {})

    harness.run(scenario, harness.request(TWO_PLATES))
    with open_session(harness.session) as session:
        assert session.trials["trial_id"].tolist() == [1, 2, 4]
        assert session.trials["verdict"].tolist() == ["committed", "aborted", "committed"]
        assert session.trials["reasons"][1] == "skipped by the operator"
        texts = [event.text for event in session.events_of("trial")]
        assert "trial 2 is skipped" in texts
    assert verify(harness.session).whole


def test_a_trial_is_skipped_while_the_run_is_paused(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        handle = handler_of(harness)
        await harness.until(lambda: harness.engine.status().run.trial_id == 1)
        await handle("pause", {})
        await harness.until(lambda: harness.engine.status().run.state == "paused")
        await handle("skip", {})
        await handle("resume", {})
        await until_ended(harness)

    harness.run(scenario, harness.request(TWO_PLATES))
    with open_session(harness.session) as session:
        counted = session.trials[session.committed()]
        assert counted["trial_id"].tolist() == [2, 3, 4]


def test_a_note_during_a_trial_is_a_mark_at_its_moment(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        handle = handler_of(harness)
        await harness.until(lambda: harness.engine.status().run.trial_id == 2)
        await harness.until(lambda: harness.engine.status().state == State.RUN)
        await harness.wait(1.5)  # the run-in comes first
        await handle("note", {"text": "a squeak"})
        await until_ended(harness)

    harness.run(scenario, harness.request(TWO_PLATES))
    with open_session(harness.session) as session:
        marks = [session.trial_marks(row) for row in range(len(session.trials))]
        assert [len(found) for found in marks] == [0, 1, 0, 0]
        ((at_s, text),) = marks[1]
        assert text == "a squeak" and 0.0 < at_s < session.trials["count"][1] / 1000
        assert session.trial_notes() == {1: "a squeak"}
