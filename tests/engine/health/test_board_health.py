"""Health counters of both boards in the status and in the session."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.taxel_frames import Flag
from rigctl.engine.health import LateTickCounter
from rigctl.engine.poller import POLL_PERIOD_S
from rigctl.session.session import Session
from rigctl.session.summary import summarise_session
from rigctl.session.verify import verify
from tests.engine.engine_harness import TINY, EngineHarness, open_harness, open_session

ONE = TINY.replace('"A", "L"', '"D"').replace("100, 120", "120")


def test_late_ticks_are_counted_over_wraps_and_restarts() -> None:
    late = LateTickCounter()
    for boot, counted in ((1, 65530), (1, 65535), (1, 4), (2, 3), (2, 3)):
        late.update(boot, counted)
    assert late.total == 5 + 5 + 3


def test_the_first_reading_of_a_counter_counts_as_zero() -> None:
    late = LateTickCounter()
    late.update(7, 40)
    assert late.total == 0


UNDISTURBED, DISTURBED = 1, 17
"""Seeds: with the second, an edge's interrupt meets the end of a conversion on the taxel chip."""


def late_and_edged(session: Session) -> tuple[set[int], set[int]]:
    """Return the samples with a late slot and those where the sync line or index mark changed."""
    (part,) = session.parts
    flags = part.read("/taxels/flags", 0, part.n_samples)
    edges = part.read("/taxels/edges", 0, part.n_samples)
    edged = np.flatnonzero(np.diff(edges, prepend=edges[:1]) | (flags & Flag.INDEX))
    return set(np.flatnonzero(flags & Flag.LATE).tolist()), set(edged.tolist())


@pytest.mark.parametrize("kind", ["virtual", "firmware"])
def test_a_session_has_both_boards_counters_at_start_and_end(tmp_path: Path, kind: str) -> None:
    with open_harness(tmp_path, UNDISTURBED, kind) as harness:
        assert harness.record(ONE).complete
        boards = harness.engine.status().boards
    assert verify(harness.session).whole
    with open_session(harness.session) as session:
        events = [(e.data["board"], e.data["when"]) for e in session.events_of("board")]
    assert events == [("drum", "start"), ("taxels", "start"), ("drum", "end"), ("taxels", "end")]
    summary = summarise_session(harness.session)["boards"]
    for name in ("drum", "taxels"):
        assert boards[name].late_ticks == summary[name]["late_ticks"] == 0
        assert boards[name].longest_isr_us == summary[name]["longest_isr_us"]
        assert summary[name]["boot_count"] == 1 and summary[name]["reset"] == "power-up"
        free = boards[name].stack_free_percent
        assert free is not None and 25 <= free < 100
        if kind == "firmware":
            longest_us = boards[name].longest_isr_us
            assert longest_us is not None and 5 < longest_us <= 25


def test_a_slot_delayed_by_an_edge_is_counted_and_its_frame_flagged(tmp_path: Path) -> None:
    with open_harness(tmp_path, DISTURBED, "firmware") as harness:
        assert harness.record(ONE).complete
        counted = harness.engine.status().boards["taxels"].late_ticks
    with open_session(harness.session) as session:
        late, edged = late_and_edged(session)
    assert counted == len(late) == 1
    assert late <= edged


def test_reading_the_counters_does_not_delay_the_polls(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    reads: list[int] = []
    read_registers = harness.rig.drum.modbus.read

    async def read_and_count(address: int, count: int) -> list[int]:
        if address == BY_NAME["longest_isr_us"].address:
            reads.append(count)
        return await read_registers(address, count)

    async def scenario(harness: EngineHarness) -> None:
        monkeypatch.setattr(harness.rig.drum.modbus, "read", read_and_count)
        polls: list[float] = []
        harness.engine.boards.drum_poller.subscribe(lambda state: polls.append(state.at_s))
        await harness.wait(10)
        assert np.abs(np.diff(polls) - POLL_PERIOD_S).max() < 0.2 * POLL_PERIOD_S

    harness.run(scenario)
    assert 9 <= len(reads) <= 11, "once a second"
