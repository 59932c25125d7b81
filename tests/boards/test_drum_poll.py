"""Polls of the drum: no load-cell sample lost or doubled, times and counters run on."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_poll import PollDecoder
from rigctl.boards.drum_registers import BY_NAME, POLL_BLOCK, RING_DEPTH, pack_value
from rigctl.boards.modbus_client import PreemptedByStop
from rigctl.values import DrumState, LoadcellSample
from tests.boards.memory_link import (
    JumpingLoop,
    rtu,
    unconnected_drum,
)

PERIOD_US = 12_500


@dataclass
class LoadcellBoard:
    """A board whose sample n has raw value 10 n and is ready at n × 12.5 ms."""

    start_us: int = 0
    first: int = 0
    extra: dict[str, tuple[int, ...]] = field(default_factory=dict)

    def newest(self, now_us: int) -> int:
        return self.first + now_us // PERIOD_US

    def words(self, now_us: int) -> tuple[int, ...]:
        n = self.newest(now_us)
        ready = now_us // PERIOD_US * PERIOD_US
        raw = {
            "board_time_us": ((self.start_us + now_us) % 2**32,),
            "loadcell_sequence": (n % 2**16,),
            "loadcell_time_us": ((self.start_us + ready) % 2**32,),
            "loadcell_recent": tuple(10 * (n - i) for i in range(5)),
            **self.extra,
        }
        words = [0] * POLL_BLOCK[1]
        for name, values in raw.items():
            entry = BY_NAME[name]
            first = entry.address - POLL_BLOCK[0]
            packed = [word for value in values for word in pack_value(entry, value)]
            words[first : first + len(packed)] = packed
        return tuple(words)

    def ring(self, wanted: range, now_us: int) -> dict[int, tuple[int, int]]:
        """Return the contents of the ring's places of ``wanted`` at ``now_us``."""
        newest = self.newest(now_us)
        held = {n % RING_DEPTH: n for n in range(newest - RING_DEPTH + 1, newest + 1)}
        kept = {n: held[n % RING_DEPTH] for n in wanted}
        return {
            n: (10 * k, (self.start_us + (k - self.first) * PERIOD_US) % 2**32)
            for n, k in kept.items()
        }


def poll(decoder: PollDecoder, board: LoadcellBoard, now_us: int, lag_us: int = 0) -> DrumState:
    raw = decoder.layout.unpack(board.words(now_us))
    return decoder.decode(raw, now_us * 1e-6, board.ring(decoder.missing(raw), now_us + lag_us))


@given(
    st.lists(st.integers(1_000, 750_000), max_size=40),
    st.sampled_from([0, 2**32 - 3_000_000]),
    st.sampled_from([100, 2**16 - 20]),
)
def test_polls_up_to_the_rings_depth_lose_no_sample(
    pauses_us: list[int], start_us: int, first: int
) -> None:
    board, decoder = LoadcellBoard(start_us, first), PollDecoder(0, 1_000_000)
    now_us, seen = 20_000, list(poll(decoder, LoadcellBoard(start_us, first), 20_000).loadcell)
    for pause in pauses_us:
        now_us += pause
        seen += poll(decoder, board, now_us).loadcell
    expected = range(seen[0].sequence, seen[0].sequence + len(seen))
    assert [s.sequence for s in seen] == list(expected)
    assert expected[-1] == board.newest(now_us)
    assert [s.raw_counts for s in seen] == [10 * n for n in expected]
    assert [s.board_time_us for s in seen] == [start_us + (n - first) * PERIOD_US for n in expected]
    assert decoder.loadcell_lost == 0


def test_a_longer_pause_counts_what_the_ring_no_longer_holds() -> None:
    board, decoder = LoadcellBoard(), PollDecoder()
    poll(decoder, board, 1_000_000)
    state = poll(decoder, board, 3_000_000)
    assert [s.sequence for s in state.loadcell] == list(range(240 - 63, 241))
    assert state.loadcell_lost == decoder.loadcell_lost == 160 - 64
    assert poll(decoder, board, 3_050_000).loadcell_lost == 0
    assert decoder.loadcell_lost == 160 - 64


def test_a_place_overwritten_while_the_ring_was_read_is_lost_and_not_mistaken() -> None:
    board, decoder = LoadcellBoard(), PollDecoder()
    poll(decoder, board, 1_000_000)
    state = poll(decoder, board, 1_800_000, lag_us=40_000)
    assert [s.sequence for s in state.loadcell] == list(range(84, 145))
    assert all(s.raw_counts == 10 * s.sequence for s in state.loadcell)
    assert state.loadcell_lost == 3


def test_the_first_poll_gives_the_newest_sample_in_grams() -> None:
    decoder = PollDecoder(tare_counts=100, scale_ug_per_count=2400)
    (sample,) = poll(decoder, LoadcellBoard(), 125_000).loadcell
    assert sample == LoadcellSample(10, 125_000, 100, 0.0)
    (later,) = poll(decoder, LoadcellBoard(), 140_000).loadcell
    assert later.force_g == pytest.approx(10 * 2400e-6)


def test_counters_and_edge_times_run_on_across_their_wraps() -> None:
    decoder = PollDecoder()
    start_us = 2**32 - 1_000_000
    edges = {"sync_count": (65535,), "index_count": (65535,), "sync_rise_us": (2**32 - 500_000,)}
    board = LoadcellBoard(start_us, extra=edges)
    before = poll(decoder, board, 600_000)
    board.extra = {"sync_count": (1,), "index_count": (0,), "sync_rise_us": (200_000,)}
    after = poll(decoder, board, 1_300_000)
    assert (before.sync_count, before.index_count) == (65535, 65535)
    assert (after.sync_count, after.index_count) == (65537, 65536)
    assert before.sync_rise_us == 2**32 - 500_000
    assert after.sync_rise_us == 2**32 + 200_000
    assert after.board_time_us == 2**32 + 300_000


def test_the_poll_block_comes_in_engineering_units() -> None:
    extra = {"angle": (9_000,), "speed": (-8_000,), "force": (4_995,), "steps": (-3,)}
    state = poll(PollDecoder(), LoadcellBoard(extra=extra), 20_000)
    assert (state.angle_deg, state.speed_mm_s, state.steps) == (90.0, -80.0, -3)
    assert state.force_g == pytest.approx(499.5)
    assert state.values["force"] == state.force_g


async def test_a_late_reply_to_an_older_poll_is_ignored(loop: JumpingLoop) -> None:
    drum, board, _ = unconnected_drum(loop)
    await drum.connect()
    await drum.poll()
    board.reply_s = 0.07
    loop.call_later(0.065, setattr, board, "reply_s", 0.001)
    state = await drum.poll()
    assert state.values["heartbeat_seen"] == 2
    assert drum.modbus.stale == 0
    drum.close()


async def test_a_stop_waits_for_no_reply(loop: JumpingLoop) -> None:
    drum, board, link = unconnected_drum(loop)
    await drum.connect()
    board.reply_s = 0.05
    poll = asyncio.create_task(drum.poll())
    await asyncio.sleep(0.001)
    setting = asyncio.create_task(drum.set(speed_set=80))
    running = asyncio.create_task(drum.command(Command.RUN))
    await asyncio.sleep(0.001)
    asked_s, board.reply_s = loop.time(), 0.001
    stop = asyncio.create_task(drum.stop())
    await asyncio.sleep(1e-4)
    assert link.written[-1][1:11].hex() == "10004100020400070002"
    await stop
    assert loop.time() - asked_s < 0.1
    assert board.executed == [(Command.STOP, 2)]
    assert (await poll).at_s > asked_s
    assert (await setting)["speed_set"] == 80.0
    with pytest.raises(PreemptedByStop, match="a stop preempted this request"):
        await running
    assert [command for command, _ in board.executed] == [Command.STOP]
    drum.close()


async def test_stops_of_several_clients_at_once_are_all_answered(loop: JumpingLoop) -> None:
    """The second stop abandoned the reply to the first, which then counted as refused."""
    drum, board, _ = unconnected_drum(loop)
    await drum.connect()
    board.reply_s = 0.01
    stops = []
    for _ in range(3):
        stops.append(asyncio.create_task(drum.stop()))
        await asyncio.sleep(0.001)
    assert await asyncio.gather(*stops) == [None, None, None]
    assert {command for command, _ in board.executed} == {Command.STOP}
    assert {sequence for _, sequence in board.executed} == {1, 2, 3}
    drum.close()


async def test_a_command_overtaken_by_a_stop_is_not_repeated(loop: JumpingLoop) -> None:
    drum, board, _ = unconnected_drum(loop)
    await drum.connect()
    board.reply_s = 0.05
    running = asyncio.create_task(drum.command(Command.RUN))
    await asyncio.sleep(0.001)
    board.reply_s = 0.001
    await drum.stop()
    with pytest.raises(PreemptedByStop, match="a stop preempted this request"):
        await running
    assert [command for command, _ in board.executed] == [Command.RUN, Command.STOP]
    drum.close()


async def test_a_late_reply_to_an_abandoned_command_does_not_answer_the_stop(
    loop: JumpingLoop,
) -> None:
    """Both are acknowledged by the same bytes; the stop itself was lost."""
    drum, board, link = unconnected_drum(loop)
    await drum.connect()
    board.reply_s = 0.03
    command = asyncio.create_task(drum.command(Command.ARM))
    await asyncio.sleep(0.02)
    stops: list[bytes] = []

    def lose_the_first_stop(request: bytes) -> None:
        stops.append(request)
        if len(stops) > 1:
            board.receive(request)

    link.board = lose_the_first_stop
    await drum.stop()
    with pytest.raises(PreemptedByStop):
        await command
    assert [kind for kind, _ in board.executed] == [Command.ARM, Command.STOP]
    assert len(set(stops)) == 1
    drum.close()


async def test_a_repeated_reply_does_not_answer_the_next_request(loop: JumpingLoop) -> None:
    drum, board, link = unconnected_drum(loop)
    await drum.connect()
    await drum.command(Command.ARM)
    link.say(rtu(bytes.fromhex("10 0041 0002")), 0.001)
    link.board = lambda request: setattr(link, "board", board.receive)
    await drum.command(Command.STOP)
    assert [kind for kind, _ in board.executed] == [Command.ARM, Command.STOP]
    drum.close()
