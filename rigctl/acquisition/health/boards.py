"""What both boards count of themselves: late ticks, longest interrupt, stack, time to spare.

The taxel board tells it ten times a second by itself. The drum's late ticks stand in every poll;
its other counters are asked for once a second, behind everybody who waited for the same poll.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass

from rigctl.acquisition.drum.poller import DrumPoller
from rigctl.acquisition.rig_interface import TaxelBoard
from rigctl.errors import RigFault
from rigctl.values import BoardIdentity, DrumState, Event
from rigctl.wire.drum.codes import reset_cause_text
from rigctl.wire.taxels.frames import CYCLES_PER_US

DRUM, TAXELS = "drum", "taxels"
LOOK_TURNS = 20
"""Polls between two looks at the drum's counters: a second."""
KIND = "board"
START, END = "start", "end"

_COUNTERS = ("longest_isr_us", "free_stack_bytes", "idle_permille")
_RAM_BYTES = {DRUM: 8192, TAXELS: 2048}
_U16 = 1 << 16


@dataclass(frozen=True, slots=True)
class BoardFigures:
    """What one board counted.

    ``late_ticks``: ticks or slots that began late, since the engine heard of the board, over
    its restarts. ``longest_isr_us``, ``free_stack_bytes`` (never used): since the board's boot.
    ``stack_free_percent``: of the chip's RAM. ``idle_percent``: of the last second.
    """

    late_ticks: int
    longest_isr_us: float
    free_stack_bytes: int
    stack_free_percent: int
    idle_percent: float


class LateTicks:
    """Sums up a counter of 16 bits that wraps, and begins anew when its board restarts."""

    def __init__(self) -> None:
        self.total = 0
        self._last: tuple[int, int] | None = None

    def note(self, boot_count: int, counted: int) -> None:
        """The counter reads ``counted`` in that boot; the first reading is where we begin."""
        if self._last is not None:
            boot, before = self._last
            self.total += (counted - before) % _U16 if boot == boot_count else counted
        self._last = (boot_count, counted)


class BoardHealth:
    """The newest figures of both boards. :meth:`follow` keeps the drum's up to date."""

    def __init__(
        self, watch: DrumPoller, taxels: TaxelBoard, identities: Mapping[str, BoardIdentity]
    ) -> None:
        self._watch = watch
        self._taxels = taxels
        self._identities = identities
        self._late = {DRUM: LateTicks(), TAXELS: LateTicks()}
        self._counters: Mapping[str, float] = {}
        watch.watch(self._note_drum)

    async def follow(self) -> None:
        """Ask the drum for its counters once a second, until cancelled."""
        while True:
            # Whoever was woken by the same poll has asked before us by the next turn of the loop.
            await asyncio.sleep(0)
            if self._watch.connected:
                with suppress(RigFault):  # a drum that is lost is told by the next poll
                    self._counters = await self._watch.drum.get(*_COUNTERS)
            for _ in range(LOOK_TURNS):
                await self._watch.turn()

    def figures(self) -> dict[str, BoardFigures]:
        """Figures by board, of those that told theirs."""
        found = {}
        if self._counters:
            told = [self._counters[name] for name in _COUNTERS]
            found[DRUM] = _figures(DRUM, self._late[DRUM].total, *told)
        status = self._taxels.status
        if status is not None:
            late, longest_us = self._late[TAXELS], status.longest_isr_cycles / CYCLES_PER_US
            late.note(status.boot_count, status.late_slots)
            told = [longest_us, status.free_stack_bytes, status.idle_permille]
            found[TAXELS] = _figures(TAXELS, late.total, *told)
        return found

    def events(self, when: str, before: Mapping[str, BoardFigures]) -> list[Event]:
        """For a recording's ``when``: a row a board; late ticks are those since ``before``."""
        now_s = self._watch.loop.time()
        return [
            _event(now_s, when, self._identities[name], now, before.get(name, now))
            for name, now in self.figures().items()
        ]

    def _note_drum(self, state: DrumState) -> None:
        identity = self._watch.identity
        if identity is not None:
            self._late[DRUM].note(identity.boot_count, round(state.values["late_ticks"]))


def _figures(
    board: str, late_ticks: int, longest_isr_us: float, free_bytes: float, idle_permille: float
) -> BoardFigures:
    return BoardFigures(
        late_ticks=late_ticks,
        longest_isr_us=round(longest_isr_us, 2),
        free_stack_bytes=round(free_bytes),
        stack_free_percent=round(100 * free_bytes / _RAM_BYTES[board]),
        idle_percent=round(idle_permille / 10, 1),
    )


def _event(
    at_s: float, when: str, board: BoardIdentity, now: BoardFigures, before: BoardFigures
) -> Event:
    late = now.late_ticks - before.late_ticks
    reset = reset_cause_text(board.reset_cause)
    text = (
        f"{board.board} at the {when}: boot {board.boot_count} by {reset}, {late} late ticks, "
        f"longest interrupt {now.longest_isr_us:g} µs, "
        f"{now.stack_free_percent} % of its RAM never used"
    )
    data = {"board": board.board, "when": when, "boot_count": board.boot_count, "reset": reset}
    return Event(at_s, KIND, text, {**data, **asdict(now), "late_ticks": late})
