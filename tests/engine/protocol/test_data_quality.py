"""A sensor that breaks in the middle of a run: the trial repeats, the run pauses and says where."""

from __future__ import annotations

from rigctl.analysis.trial_set import join_sessions
from rigctl.session.notes import Mark, SessionNote
from rigctl.session.session import Session, add_note
from rigctl.session.session_reader import QUARANTINE_KIND
from rigctl.session.verify import verify
from tests.engine.engine_harness import EngineHarness, until_ended

EIGHT = """
name = "eight"
textures = ["D"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 8
"""


def texts(session: Session, kind: str) -> list[str]:
    return [event.text for event in session.events_of(kind)]


def test_a_broken_line_pauses_the_run_with_a_diagnosis(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: run.status().trials_committed == 4)
        harness.rig.faults.wire("taxel line open")
        await harness.until(lambda: run.status().state == "paused")
        (reason,) = run.status().reasons
        assert "6 attempts in a row were not good since trial 5: taxel 4 stays at" in reason
        assert reason.endswith("Look at the wires of line 2 and input A0, A1, A2, A3, A4, A5")
        await harness.until(lambda: run.status().trials_rejected == 6)
        harness.rig.faults.wire("taxel line open", on=False)
        run.control.resume()
        await until_ended(harness)
        assert run.status().trials_committed == 7, "the trial before the pause is given up"

    harness.run(scenario, harness.request(EIGHT))
    assert verify(harness.session).whole
    with Session.open(harness.session) as session:
        rejected = session.trials["verdict"] == "rejected"
        assert session.trials["trial_id"][rejected].tolist() == [5, 5, 5, 6, 6, 6]
        assert session.quarantined() == {}
        assert texts(session, QUARANTINE_KIND) == []


def test_a_hand_on_the_sensor_puts_trials_into_quarantine_and_repeats_none(
    harness: EngineHarness,
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: run.status().trials_committed == 6)
        harness.rig.faults.touch_sensor(places=[4])
        await until_ended(harness)
        assert run.complete

    harness.run(scenario, harness.request(EIGHT))
    with Session.open(harness.session) as session:
        why = session.quarantined()
        assert [session.trial_row(index).trial.trial_id for index in why] == [7, 8]
        assert all("counts, lifted, since the start" in text for text in why.values())
    trials = join_sessions([harness.session])
    assert len(trials.trials) == 6
    assert any("2 trials left out for quarantine" in remark for remark in trials.remarks)
    good = SessionNote(
        made_utc="2026-01-02T03:04:05Z", text="looked at", trial_id=7, attempt=1, mark=Mark.GOOD
    )
    add_note(harness.session, good)
    assert len(join_sessions([harness.session]).trials) == 7
