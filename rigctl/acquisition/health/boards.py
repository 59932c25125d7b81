"""Health counters of both boards: late ticks, longest interrupt, free stack, idle time.

The taxel board sends its counters ten times a second. Those of the drum are read once a second,
after all other code that waited for the same poll.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from rigctl.acquisition.drum.poller import DrumPoller
from rigctl.acquisition.rpc.messages import BoardStatus
from rigctl.devices.taxels import Taxels
from rigctl.errors import RigFault
from rigctl.values import BoardIdentity, Event
from rigctl.wire.drum.codes import is_abnormal_reset, reset_cause_text
from rigctl.wire.taxels.frames import CYCLES_PER_US

DRUM, TAXELS = "drum", "taxels"
READ_PERIOD_CYCLES = 20
"""Cycles of the poll loop between two reads of the drum's counters: a second."""
EVENT_KIND = "board"
START, END = "start", "end"

_LATE_TICKS, _SPIKES, _RATE = "late_ticks", "loadcell_spikes", "loadcell_rate"
_DRUM_COUNTERS = ("longest_isr_us", "free_stack_bytes", "idle_permille")
_RAM_BYTES = {DRUM: 8192, TAXELS: 2048}
_U16 = 1 << 16

Counters = dict[str, Any]
"""The counters of one board, by their names in :class:`BoardStatus`."""


class LateTickCounter:
    """Total of a 16-bit counter that wraps and restarts with its board."""

    def __init__(self) -> None:
        self.total = 0
        self._last: tuple[int, int] | None = None

    def update(self, boot_count: int, reading: int) -> None:
        """Add the increase since the last reading; the first reading counts as zero."""
        if self._last is not None:
            boot, before = self._last
            self.total += (reading - before) % _U16 if boot == boot_count else reading
        self._last = (boot_count, reading)


class BoardHealth:
    """The newest counters of both boards. :meth:`run` reads those of the drum."""

    def __init__(
        self, poller: DrumPoller, taxels: Taxels, identities: Mapping[str, BoardIdentity]
    ) -> None:
        self._poller = poller
        self._taxels = taxels
        self._identities = identities
        self._late_ticks = {DRUM: LateTickCounter(), TAXELS: LateTickCounter()}
        self._drum_counters: Mapping[str, float] = {}

    async def run(self) -> None:
        """Read the drum's counters once a second, until cancelled."""
        while True:
            # Tasks that the same poll woke have sent their requests by the loop's next iteration.
            await asyncio.sleep(0)
            if self._poller.connected:
                with suppress(RigFault):  # the next poll reports a lost drum
                    self._drum_counters = await self._poller.drum.get(
                        _LATE_TICKS, _SPIKES, _RATE, *_DRUM_COUNTERS
                    )
                    late_ticks = round(self._drum_counters[_LATE_TICKS])
                    self._late_ticks[DRUM].update(self._identities[DRUM].boot_count, late_ticks)
            for _ in range(READ_PERIOD_CYCLES):
                await self._poller.wait_cycle()

    def counters(self) -> dict[str, Counters]:
        """Return the counters of each board that has reported, by board."""
        found = {}
        if self._drum_counters:
            readings = [self._drum_counters[name] for name in _DRUM_COUNTERS]
            found[DRUM] = _counters(DRUM, self._late_ticks[DRUM].total, *readings)
            found[DRUM]["loadcell_spikes"] = round(self._drum_counters[_SPIKES])
            found[DRUM]["loadcell_rate_hz"] = round(self._drum_counters[_RATE], 1) or None
        status = self._taxels.status
        if status is not None:
            late_ticks = self._late_ticks[TAXELS]
            late_ticks.update(status.boot_count, status.late_slots)
            longest_us = status.longest_isr_cycles / CYCLES_PER_US
            readings = [longest_us, status.free_stack_bytes, status.idle_permille]
            found[TAXELS] = _counters(TAXELS, late_ticks.total, *readings)
        return found

    def statuses(self) -> dict[str, BoardStatus]:
        """Return each connected board's part of the status message, by board."""
        counters = self.counters()
        return {
            name: BoardStatus(
                firmware=identity.firmware_version,
                boot_count=identity.boot_count,
                reset=reset_cause_text(identity.reset_cause),
                unwanted=is_abnormal_reset(identity.reset_cause),
                **(self._taxel_reports() if name == TAXELS else {}),
                **counters.get(name, {}),
            )
            for name, identity in self._identities.items()
        }

    def events(self, when: str, before: Mapping[str, Counters]) -> list[Event]:
        """Return one event per board for the session; late ticks are those since ``before``.

        ``when``: start or end of the recording.
        """
        now_s = self._poller.loop.time()
        return [
            _event(now_s, when, self._identities[name], now, before.get(name, now))
            for name, now in self.counters().items()
        ]

    def _taxel_reports(self) -> dict[str, Any]:
        taxels = self._taxels
        supply_mv = taxels.status.supply_mv if taxels.status else None
        return {
            "supply_v": supply_mv / 1000 if supply_mv else None,
            "self_test": None if taxels.self_test is None else tuple(taxels.findings),
        }


def _counters(
    board: str, late_ticks: int, longest_isr_us: float, free_bytes: float, idle_permille: float
) -> Counters:
    return {
        "late_ticks": late_ticks,
        "longest_isr_us": round(longest_isr_us, 2),
        "free_stack_bytes": round(free_bytes),
        "stack_free_percent": round(100 * free_bytes / _RAM_BYTES[board]),
        "idle_percent": round(idle_permille / 10, 1),
    }


def _event(at_s: float, when: str, board: BoardIdentity, now: Counters, before: Counters) -> Event:
    late_ticks = now["late_ticks"] - before["late_ticks"]
    reset = reset_cause_text(board.reset_cause)
    text = (
        f"{board.board} at the {when}: boot {board.boot_count} by {reset}, {late_ticks} late "
        f"ticks, longest interrupt {now['longest_isr_us']:g} µs, "
        f"{now['stack_free_percent']} % of its RAM never used"
    )
    data = {"board": board.board, "when": when, "boot_count": board.boot_count, "reset": reset}
    return Event(at_s, EVENT_KIND, text, {**data, **now, "late_ticks": late_ticks})
