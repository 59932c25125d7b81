"""Pauses, stops, faults and lost cables: the rig is lifted, the session whole, nothing replayed."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from rigctl.acquisition.protocol.run_request import RunRequest
from rigctl.errors import SessionError
from rigctl.session.verify.session import verify
from rigctl.session.write.part_writer import PartWriter
from rigctl.wire.drum.codes import Command
from rigctl.wire.drum.states import State
from tests.acquisition.floor import Floor, open_floor, read, until_ended

PAIR = """
name = "pair"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 2
"""


def drum_state(floor: Floor) -> State:
    state = floor.engine.boards.watch.state
    assert state is not None
    return State(state.state)


async def until_turning(floor: Floor) -> None:
    await floor.until(lambda: drum_state(floor) is State.RUN)


def verdicts(floor: Floor) -> list[tuple[int, str]]:
    with read(floor.session) as session:
        return list(
            zip(
                session.trials["trial_id"].tolist(),
                session.trials["verdict"].tolist(),
                strict=True,
            )
        )


def test_a_pause_lifts_and_the_interrupted_trial_is_taken_anew(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        await until_turning(floor)
        run = floor.engine.run
        assert run is not None
        run.control.pause()
        await floor.until(lambda: drum_state(floor) is State.IDLE)
        assert run.status().state == "paused"
        assert run.status().reasons == ("operator",)
        await floor.passes(5)
        assert drum_state(floor) is State.IDLE
        run.control.resume()
        await until_ended(floor)

    floor.play(person, floor.order(PAIR))
    assert verdicts(floor) == [(1, "aborted"), (1, "committed"), (2, "committed")]
    assert verify(floor.session).whole


def test_one_reasons_end_does_not_lift_another(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        await until_turning(floor)
        run = floor.engine.run
        assert run is not None
        run.control.pause("operator")
        run.control.pause("disk")
        await floor.until(lambda: drum_state(floor) is State.IDLE)
        run.control.resume("disk")
        await floor.passes(2)
        assert run.status().state == "paused"
        run.control.resume("operator")
        await until_ended(floor)

    floor.play(person, floor.order(PAIR))
    assert floor.engine.run is not None and floor.engine.run.complete


def test_an_aborted_run_can_be_gone_on_with(floor: Floor, tmp_path: Path) -> None:
    async def person(floor: Floor) -> None:
        await floor.until(lambda: len(floor.texts("trial")) == 1)
        await until_turning(floor)
        assert floor.engine.run is not None
        floor.engine.run.control.abort("enough")
        await until_ended(floor)
        assert drum_state(floor) is State.IDLE

    floor.play(person, floor.order(PAIR))
    assert verdicts(floor) == [(1, "committed"), (2, "aborted")]
    assert verify(floor.session).whole
    (tmp_path / "again").mkdir()
    with open_floor(tmp_path / "again") as second:
        second.play(until_ended, RunRequest(resume=str(floor.session), yes=True))
        assert second.engine.run is not None and second.engine.run.complete
    assert verdicts(floor) == [(1, "committed"), (2, "aborted"), (2, "committed")]
    assert verify(floor.session).whole
    with read(floor.session) as session:
        assert session.trials["attempt"].tolist() == [1, 1, 2]


def test_a_session_gone_on_with_waits_for_the_plate_alone(floor: Floor, tmp_path: Path) -> None:
    """It once held for a full disk: the room left was taken as 0 until the first byte."""

    async def stopped(floor: Floor) -> None:
        await floor.until(lambda: len(floor.texts("trial")) == 1)
        assert floor.engine.run is not None
        floor.engine.run.control.abort("enough")
        await until_ended(floor)

    async def asked(floor: Floor) -> None:
        run = floor.engine.run
        assert run is not None
        await floor.until(lambda: run.status().prompt is not None)
        await floor.passes(2)
        assert run.status().reasons == ("prompt",)
        prompt = run.status().prompt
        assert prompt is not None
        run.control.answer(prompt.id, "ok")
        await until_ended(floor)

    floor.play(stopped, floor.order(PAIR))
    (tmp_path / "again").mkdir()
    with open_floor(tmp_path / "again") as second:
        second.play(asked, RunRequest(resume=str(floor.session)))
        assert second.engine.run is not None and second.engine.run.complete


def test_an_emergency_stop_ends_the_run_with_its_session_whole(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        await floor.until(lambda: len(floor.texts("trial")) == 1)
        await until_turning(floor)
        assert floor.rig.faults is not None
        floor.rig.faults.press_estop()
        await until_ended(floor)

    floor.play(person, floor.order(PAIR))
    run = floor.engine.run
    assert run is not None
    assert run.ending == "failed"
    assert "emergency stop" in run.text
    assert verdicts(floor) == [(1, "committed"), (2, "aborted")]
    assert verify(floor.session).whole


def test_lost_taxels_hold_the_run_until_they_are_back(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        await until_turning(floor)
        run, faults = floor.engine.run, floor.rig.faults
        assert run is not None and faults is not None
        unplugged_s = floor.rig.loop.time()
        faults.unplug("taxels")
        await floor.until(lambda: run.status().reasons == ("link",))
        assert floor.rig.loop.time() - unplugged_s < 0.3
        await floor.until(lambda: drum_state(floor) is State.IDLE)
        await floor.passes(3)
        faults.replug("taxels")
        await until_ended(floor)

    floor.play(person, floor.order(PAIR))
    assert verdicts(floor) == [(1, "aborted"), (1, "committed"), (2, "committed")]
    assert any("taxels is back" in text for text in floor.texts("board"))


def test_a_taxel_board_that_was_reset_costs_the_trial_only(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        await until_turning(floor)
        assert floor.rig.faults is not None
        floor.rig.faults.reset("taxels")
        await until_ended(floor)

    floor.play(person, floor.order(PAIR))
    assert floor.engine.run is not None and floor.engine.run.complete
    assert verdicts(floor)[0][1] != "committed"
    assert verdicts(floor)[-2:] == [(1, "committed"), (2, "committed")]


def test_a_lost_drum_ends_the_run_and_is_asked_again_who_it_is(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        await until_turning(floor)
        faults = floor.rig.faults
        assert faults is not None
        unplugged_s = floor.rig.loop.time()
        faults.unplug("drum")
        await floor.until(lambda: not floor.engine.boards.watch.connected)
        assert floor.rig.loop.time() - unplugged_s < 0.3
        await until_ended(floor)
        faults.replug("drum")
        await floor.until(lambda: floor.engine.boards.watch.connected)

    floor.play(person, floor.order(PAIR))
    assert floor.engine.run is not None
    assert floor.engine.run.ending == "failed"
    assert verdicts(floor) == [(1, "aborted")]
    assert any("drum is back" in text for text in floor.texts("board"))


def test_bytes_lost_on_the_line_cost_the_trial_and_it_is_repeated(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        await until_turning(floor)
        await floor.passes(1.5)
        assert floor.rig.faults is not None
        floor.rig.faults.drop_bytes("taxels", "to_host", 0.001)
        await floor.passes(0.5)
        floor.rig.faults.drop_bytes("taxels", "to_host", 0.0)
        await until_ended(floor)

    floor.play(person, floor.order(PAIR))
    assert verdicts(floor) == [(1, "rejected"), (1, "committed"), (2, "committed")]
    with read(floor.session) as session:
        assert "samples are missing" in session.trials["reasons"][0]
        assert len(session.gaps) > 0
    assert floor.engine.run is not None and floor.engine.run.status().trials_rejected == 1


def test_a_full_disk_ends_the_run_with_what_was_committed(
    floor: Floor, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def person(floor: Floor) -> None:
        await floor.until(lambda: len(floor.texts("trial")) == 1)
        await until_turning(floor)
        assert floor.engine.run is not None

        def full(self: PartWriter) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr(PartWriter, "write", full)
        await until_ended(floor)
        assert drum_state(floor) is State.IDLE

    floor.play(person, floor.order(PAIR))
    run = floor.engine.run
    assert run is not None and run.ending == "failed"
    assert "disk is full" in run.text
    assert verdicts(floor) == [(1, "committed")]


def test_stop_takes_effect_within_one_exchange(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        await until_turning(floor)
        asked_s = floor.rig.loop.time()
        await floor.engine.stop("stopped by a test")
        assert floor.rig.loop.time() - asked_s < 0.05
        await floor.until(lambda: drum_state(floor) is not State.RUN, 0.1)
        await until_ended(floor)

    floor.play(person, floor.order(PAIR))
    assert floor.engine.run is not None
    assert floor.engine.run.ending == "aborted"
    assert verdicts(floor) == [(1, "aborted")]


def test_plates_are_asked_for_and_the_drum_is_off_meanwhile(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        run = floor.engine.run
        assert run is not None
        for texture in ("A", "B"):
            await floor.until(lambda: run.status().prompt is not None)
            prompt = run.status().prompt
            assert prompt is not None and prompt.texture == texture
            assert run.status().state == "prompt"
            await floor.passes(3)
            assert drum_state(floor) is State.IDLE
            assert not run.control.answer(prompt.id + 1, "ok")
            assert run.control.answer(prompt.id, "ok")
        await until_ended(floor)

    protocol = PAIR.replace('"A"', '"A", "B"').replace("repeats = 2", "repeats = 1")
    floor.play(person, floor.order(protocol, yes=False))
    assert verdicts(floor) == [(1, "committed"), (2, "committed")]


def test_an_emergency_stop_while_people_change_the_plate_only_holds(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        run, faults = floor.engine.run, floor.rig.faults
        assert run is not None and faults is not None
        await floor.until(lambda: run.status().prompt is not None)
        faults.press_estop()
        await floor.until(lambda: "fault" in run.status().reasons)
        prompt = run.status().prompt
        assert prompt is not None
        run.control.answer(prompt.id, "ok")
        await floor.passes(2)
        assert run.status().state == "paused"
        faults.release_estop()
        await floor.passes(1)
        await floor.rig.drum.command(Command.CLEAR)
        await until_ended(floor)

    floor.play(person, floor.order(PAIR, yes=False))
    assert verdicts(floor) == [(1, "committed"), (2, "committed")]


def test_a_session_in_use_is_refused_to_a_second_run(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        await until_turning(floor)
        with pytest.raises(SessionError, match="being written"):
            floor.engine.start(RunRequest(resume=str(floor.session)))
        assert floor.engine.run is not None
        floor.engine.run.control.abort("enough")
        await until_ended(floor)

    floor.play(person, floor.order(PAIR))


def test_a_session_of_another_rig_is_not_gone_on_with(floor: Floor, tmp_path: Path) -> None:
    async def person(other: Floor) -> None:
        with pytest.raises(SessionError, match="on the virtual rig and this is the bench one"):
            other.engine.start(RunRequest(resume=str(floor.session)))

    floor.record(PAIR)
    (tmp_path / "again").mkdir()
    with open_floor(tmp_path / "again") as other:
        other.rig.kind = "bench"
        other.play(person)


def test_a_run_ended_at_its_first_question_is_a_session_too(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        run = floor.engine.run
        assert run is not None
        await floor.until(lambda: run.status().prompt is not None)
        prompt = run.status().prompt
        assert prompt is not None
        run.control.answer(prompt.id, "abort")
        await until_ended(floor)

    floor.play(person, floor.order(PAIR, yes=False))
    assert floor.engine.run is not None and floor.engine.run.ending == "aborted"
    assert verdicts(floor) == []
    assert verify(floor.session).whole
