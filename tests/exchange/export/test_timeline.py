"""One clock: samples by the board's counter, loop times beside the samples of that moment."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.errors import SessionError
from rigctl.exchange.export.timeline import part_times
from rigctl.session.header import SessionHeader
from rigctl.session.recorder import Recorder
from rigctl.session.session import Session
from rigctl.values import Block
from tests.session.building import PROTOCOL, RIG, header, plan, value_of

BLOCK = 20
START_LOOP_S = 500.0


def record(
    folder: Path, head: SessionHeader, n_blocks: int, *, fast: float = 1.0, resume: bool = False
) -> None:
    """Record blocks of a board whose clock is ``fast``, each a random while late."""
    late_s = np.random.default_rng(1).exponential(0.004, n_blocks)
    with Recorder(folder, head, PROTOCOL, RIG, resume=resume) as recorder:
        recorder.begin_part("resume" if resume else "start", "A")
        for number in range(n_blocks):
            counters = np.arange(number * BLOCK, (number + 1) * BLOCK)
            none = np.zeros(BLOCK, np.uint8)
            arrived_s = head.start_loop_s + 1 + counters[-1] / (1000 * fast) + late_s[number]
            recorder.add_block(Block(counters, value_of(counters), none, none, (), arrived_s))


def head_at(start_utc: str) -> SessionHeader:
    return replace(header(plan()), start_utc=start_utc, start_loop_s=START_LOOP_S)


@pytest.mark.parametrize("fast", [0.995, 1.0, 1.005])
def test_a_loop_time_lies_at_the_sample_of_that_moment(fast: float, tmp_path: Path) -> None:
    record(tmp_path / "s", head_at("2026-11-21T12:00:00Z"), 6000, fast=fast)
    with Session.open(tmp_path / "s") as session:
        (times,) = part_times(session.parts).values()
    counters = np.arange(0, 120_000, 777)
    at_s = times.of_counter(counters)
    assert at_s[0] == pytest.approx(1.0, abs=0.06)  # as far as 10 s of drift
    assert np.array_equal(np.rint(at_s * 1000), np.rint(at_s[0] * 1000) + counters)
    loop_s = START_LOOP_S + 1 + counters / (1000 * fast)
    middle = (counters > 10_000) & (counters < 110_000)  # at the ends the difference is held
    assert np.abs(times.of_loop(loop_s) - at_s)[middle].max() < 0.002
    assert np.abs(times.of_loop(loop_s) - at_s).max() < 0.06


def test_a_sitting_that_the_wall_clock_puts_into_the_one_before_follows_it(tmp_path: Path) -> None:
    record(tmp_path / "s", head_at("2026-11-21T12:00:00Z"), 500)
    record(tmp_path / "s", head_at("2026-11-21T12:00:02Z"), 500, resume=True)
    record(tmp_path / "s", head_at("2026-11-21T13:00:00Z"), 500, resume=True)
    with Session.open(tmp_path / "s") as session:
        one, two, three = part_times(session.parts).values()
    assert two.of_counter(0) == one.of_counter(10_000)
    assert three.of_counter(0) == pytest.approx(3601.0, abs=0.002)


def test_a_start_that_is_no_time_is_named(tmp_path: Path) -> None:
    record(tmp_path / "s", head_at("yesterday"), 2)
    with Session.open(tmp_path / "s") as session, pytest.raises(SessionError, match="no time"):
        part_times(session.parts)
