"""Pauses, stops, faults and lost cables: the drum lifts, the session stays valid."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import State
from rigctl.engine.run_request import RunRequest
from rigctl.errors import SessionError
from rigctl.session import recorder
from rigctl.session.verify import verify
from rigctl.session.writer import PartWriter
from tests.engine.engine_harness import EngineHarness, open_harness, open_session, until_ended

PAIR = """
name = "pair"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 2
"""


def drum_state(harness: EngineHarness) -> State:
    state = harness.engine.boards.drum_poller.state
    assert state is not None
    return State(state.state)


async def until_turning(harness: EngineHarness) -> None:
    await harness.until(lambda: drum_state(harness) is State.RUN)


def verdicts(harness: EngineHarness) -> list[tuple[int, str]]:
    with open_session(harness.session) as session:
        return list(
            zip(
                session.trials["trial_id"].tolist(),
                session.trials["verdict"].tolist(),
                strict=True,
            )
        )


def test_a_pause_lifts_and_the_interrupted_trial_repeats(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        run = harness.engine.run
        assert run is not None
        run.control.pause()
        await harness.until(lambda: drum_state(harness) is State.IDLE)
        assert run.status().state == "paused"
        assert run.status().reasons == ("operator",)
        await harness.wait(5)
        assert drum_state(harness) is State.IDLE
        run.control.resume()
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert verdicts(harness) == [(1, "aborted"), (1, "committed"), (2, "committed")]
    assert verify(harness.session).whole


def test_the_end_of_one_reason_does_not_remove_another(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        run = harness.engine.run
        assert run is not None
        run.control.pause("operator")
        run.control.pause("disk")
        await harness.until(lambda: drum_state(harness) is State.IDLE)
        run.control.resume("disk")
        await harness.wait(2)
        assert run.status().state == "paused"
        run.control.resume("operator")
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert harness.engine.run is not None and harness.engine.run.complete


def test_an_aborted_run_can_be_resumed(harness: EngineHarness, tmp_path: Path) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: len(harness.texts("trial")) == 1)
        await until_turning(harness)
        assert harness.engine.run is not None
        harness.engine.run.control.abort("enough")
        await until_ended(harness)
        assert drum_state(harness) is State.IDLE

    harness.run(scenario, harness.request(PAIR))
    assert verdicts(harness) == [(1, "committed"), (2, "aborted")]
    assert verify(harness.session).whole
    (tmp_path / "again").mkdir()
    with open_harness(tmp_path / "again") as second:
        second.run(until_ended, RunRequest(resume=str(harness.session), yes=True))
        assert second.engine.run is not None and second.engine.run.complete
    assert verdicts(harness) == [(1, "committed"), (2, "aborted"), (2, "committed")]
    assert verify(harness.session).whole
    with open_session(harness.session) as session:
        assert session.trials["attempt"].tolist() == [1, 1, 2]


def test_the_trials_of_a_damaged_part_are_run_again(harness: EngineHarness, tmp_path: Path) -> None:
    harness.run(until_ended, harness.request())
    planned = sorted(trial for trial, _ in verdicts(harness))
    (harness.session / "part-0001.h5").write_bytes(bytes(100))
    (tmp_path / "again").mkdir()
    with open_harness(tmp_path / "again") as second:
        second.run(until_ended, RunRequest(resume=str(harness.session), yes=True))
        assert second.engine.run is not None and second.engine.run.complete
        assert any("part-0001.h5 is damaged" in text for text in second.texts("log"))
    with open_session(harness.session) as session:
        assert session.trials["trial_id"][session.committed()].tolist() == planned
        assert session.parts[-1].number == 3
    (problem,) = verify(harness.session).problems
    assert problem.startswith("part-0001.h5 is damaged")


def test_a_resumed_session_waits_only_for_the_plate(harness: EngineHarness, tmp_path: Path) -> None:
    """It once paused for a full disk: the free space counted as 0 until the first byte."""

    async def stopped(harness: EngineHarness) -> None:
        await harness.until(lambda: len(harness.texts("trial")) == 1)
        assert harness.engine.run is not None
        harness.engine.run.control.abort("enough")
        await until_ended(harness)

    async def answer_prompt(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: run.status().prompt is not None)
        await harness.wait(2)
        assert run.status().reasons == ("prompt",)
        prompt = run.status().prompt
        assert prompt is not None
        run.control.answer(prompt.id, "ok")
        await until_ended(harness)

    harness.run(stopped, harness.request(PAIR))
    (tmp_path / "again").mkdir()
    with open_harness(tmp_path / "again") as second:
        second.run(answer_prompt, RunRequest(resume=str(harness.session)))
        assert second.engine.run is not None and second.engine.run.complete


def test_an_emergency_stop_ends_the_run_with_a_valid_session(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: len(harness.texts("trial")) == 1)
        await until_turning(harness)
        assert harness.rig.faults is not None
        harness.rig.faults.press_estop()
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    run = harness.engine.run
    assert run is not None
    assert run.outcome == "failed"
    assert "emergency stop" in run.text
    assert verdicts(harness) == [(1, "committed"), (2, "aborted")]
    assert verify(harness.session).whole


def test_lost_taxels_pause_the_run_until_they_are_back(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        run, faults = harness.engine.run, harness.rig.faults
        assert run is not None and faults is not None
        unplugged_s = harness.rig.loop.time()
        faults.unplug("taxels")
        await harness.until(lambda: run.status().reasons == ("link",))
        assert harness.rig.loop.time() - unplugged_s < 0.3
        await harness.until(lambda: drum_state(harness) is State.IDLE)
        await harness.wait(3)
        faults.replug("taxels")
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert verdicts(harness) == [(1, "aborted"), (1, "committed"), (2, "committed")]
    assert any("taxel board is back" in text for text in harness.texts("board"))


def test_a_reset_of_the_taxel_board_costs_one_trial(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        assert harness.rig.faults is not None
        harness.rig.faults.reset("taxels")
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert harness.engine.run is not None and harness.engine.run.complete
    assert verdicts(harness)[0][1] != "committed"
    assert verdicts(harness)[-2:] == [(1, "committed"), (2, "committed")]


def test_a_drum_that_stays_lost_ends_the_run_and_is_reconnected(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        faults = harness.rig.faults
        assert faults is not None
        unplugged_s = harness.rig.loop.time()
        faults.unplug("drum")
        await harness.until(lambda: not harness.engine.boards.drum_poller.connected)
        assert harness.rig.loop.time() - unplugged_s < 0.3
        await until_ended(harness)
        faults.replug("drum")
        await harness.until(lambda: harness.engine.boards.drum_poller.connected)

    harness.run(scenario, harness.request(PAIR))
    assert harness.engine.run is not None
    assert harness.engine.run.outcome == "failed"
    assert verdicts(harness) == [(1, "aborted")]
    assert any("drum board is back" in text for text in harness.texts("board"))


def test_a_trial_with_lost_bytes_is_repeated(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        await harness.wait(1.5)
        assert harness.rig.faults is not None
        harness.rig.faults.drop_bytes("taxels", "to_host", 0.005)
        await harness.wait(0.5)
        harness.rig.faults.drop_bytes("taxels", "to_host", 0.0)
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert verdicts(harness) == [(1, "rejected"), (1, "committed"), (2, "committed")]
    with open_session(harness.session) as session:
        assert "samples are missing" in session.trials["reasons"][0]
        assert len(session.gaps) > 0
    assert harness.engine.run is not None and harness.engine.run.status().trials_rejected == 1


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO, errno.EROFS])
def test_a_disk_that_refuses_pauses_the_run_until_it_takes_files_again(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """The second trial is lost with it: its row was on the way to the disk."""

    def refuse(*_: object) -> None:
        raise OSError(number, "refused")

    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: len(harness.texts("trial")) == 1)
        await until_turning(harness)
        run = harness.engine.run
        assert run is not None
        with monkeypatch.context() as patch:
            patch.setattr(PartWriter, "write", refuse)
            patch.setattr(recorder, "probe_disk", refuse)
            await harness.until(lambda: run.status().reasons == ("disk error",))
            await harness.until(lambda: drum_state(harness) is State.IDLE)
            await harness.wait(300)
            assert run.status().state == "paused"
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert harness.engine.run is not None and harness.engine.run.complete
    assert "then resume the session" in harness.texts("disk")[0]
    assert [row for row in verdicts(harness) if row[1] == "committed"] == [
        (1, "committed"),
        (2, "committed"),
    ]
    assert verify(harness.session).problems == []


def test_a_trial_whose_row_did_not_reach_the_disk_is_recorded_again(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "refused")

    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        await harness.until(lambda: drum_state(harness) is State.HOLD)
        with monkeypatch.context() as patch:
            patch.setattr(PartWriter, "sync", refuse)
            patch.setattr(recorder, "probe_disk", refuse)
            await harness.until(lambda: "disk error" in harness.engine.status().run.reasons)
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert harness.texts("trial")[0] == "trial 1 committed"
    assert harness.engine.run is not None and harness.engine.run.complete
    with open_session(harness.session) as session:
        assert sorted(session.trials["trial_id"][session.committed()]) == [1, 2]


def test_a_disk_that_stays_full_keeps_committed_trials(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: len(harness.texts("trial")) == 1)
        await until_turning(harness)
        run = harness.engine.run
        assert run is not None
        monkeypatch.setattr(PartWriter, "write", full)
        monkeypatch.setattr(recorder, "probe_disk", full)
        await harness.until(lambda: run.status().reasons == ("disk error",))
        run.control.abort("enough")
        await until_ended(harness)
        assert drum_state(harness) is State.IDLE

    harness.run(scenario, harness.request(PAIR))
    assert "disk is full" in harness.texts("disk")[0]
    assert verdicts(harness) == [(1, "committed")]


@pytest.mark.parametrize("replaced", [False, True])
def test_a_part_that_vanishes_ends_the_run_within_one_trial(
    harness: EngineHarness, replaced: bool
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        part = harness.session / "part-0001.h5"
        part.unlink()
        if replaced:
            part.write_bytes(b"something else")
        await until_ended(harness)
        assert drum_state(harness) is State.IDLE

    harness.run(scenario, harness.request(PAIR.replace("repeats = 2", "repeats = 8")))
    run = harness.engine.run
    assert run is not None and run.outcome == "failed"
    assert "part-0001.h5 was removed, renamed or replaced" in run.text
    assert run.status().trials_committed <= 1
    if not replaced:
        assert verdicts(harness) == [(1, "committed")]


def test_stop_takes_effect_within_one_exchange(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        asked_s = harness.rig.loop.time()
        await harness.engine.send_stop("stopped by a test")
        assert harness.rig.loop.time() - asked_s < 0.05
        await harness.until(lambda: drum_state(harness) is not State.RUN, 0.1)
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert harness.engine.run is not None
    assert harness.engine.run.outcome == "aborted"
    assert verdicts(harness) == [(1, "aborted")]


def test_the_drum_is_off_while_a_plate_is_requested(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        for texture in ("A", "B"):
            await harness.until(lambda: run.status().prompt is not None)
            prompt = run.status().prompt
            assert prompt is not None and prompt.texture == texture
            assert run.status().state == "prompt"
            await harness.wait(3)
            assert drum_state(harness) is State.IDLE
            assert not run.control.answer(prompt.id + 1, "ok")
            assert run.control.answer(prompt.id, "ok")
        await until_ended(harness)

    protocol = PAIR.replace('"A"', '"A", "B"').replace("repeats = 2", "repeats = 1")
    harness.run(scenario, harness.request(protocol, yes=False))
    assert verdicts(harness) == [(1, "committed"), (2, "committed")]


def test_an_emergency_stop_during_a_plate_change_only_pauses(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        run, faults = harness.engine.run, harness.rig.faults
        assert run is not None and faults is not None
        await harness.until(lambda: run.status().prompt is not None)
        faults.press_estop()
        await harness.until(lambda: "fault" in run.status().reasons)
        prompt = run.status().prompt
        assert prompt is not None
        run.control.answer(prompt.id, "ok")
        await harness.wait(2)
        assert run.status().state == "paused"
        faults.release_estop()
        await harness.wait(1)
        await harness.rig.drum.command(Command.CLEAR)
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR, yes=False))
    assert verdicts(harness) == [(1, "committed"), (2, "committed")]


def test_a_session_in_use_is_refused_to_a_second_run(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        with pytest.raises(SessionError, match="being written"):
            harness.engine.start(RunRequest(resume=str(harness.session)))
        assert harness.engine.run is not None
        harness.engine.run.control.abort("enough")
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))


def test_a_session_of_another_rig_is_not_resumed(harness: EngineHarness, tmp_path: Path) -> None:
    async def scenario(other: EngineHarness) -> None:
        with pytest.raises(SessionError, match="on the virtual rig and this is the bench one"):
            other.engine.start(RunRequest(resume=str(harness.session)))

    harness.record(PAIR)
    (tmp_path / "again").mkdir()
    with open_harness(tmp_path / "again") as other:
        other.rig.kind = "bench"
        other.run(scenario)


def test_a_run_aborted_at_its_first_question_has_a_session(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: run.status().prompt is not None)
        prompt = run.status().prompt
        assert prompt is not None
        run.control.answer(prompt.id, "abort")
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR, yes=False))
    assert harness.engine.run is not None and harness.engine.run.outcome == "aborted"
    assert verdicts(harness) == []
    assert verify(harness.session).whole
