"""Health of a running engine: board counters, sample rate, disk, heartbeat, notices.

The taxel board sends its counters ten times a second. Those of the drum are read once a second,
after all other code that waited for the same poll.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from rigctl.boards.drum_codes import is_abnormal_reset, reset_cause_text
from rigctl.boards.taxel_frames import CYCLES_PER_US
from rigctl.boards.taxels import Taxels
from rigctl.engine.poller import DrumPoller
from rigctl.engine.rpc.messages import BoardStatus, RecordingStatus
from rigctl.errors import RigFault
from rigctl.session.recorder import SessionRecorder
from rigctl.values import SAMPLE_RATE_HZ, BoardIdentity, Event


class RateMeter:
    """Increase of a counter over the last ``window_s`` of loop time."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._readings: deque[tuple[float, int]] = deque()

    def update(self, now_s: float, count: int) -> None:
        """Add a reading of now."""
        self._readings.append((now_s, count))
        while len(self._readings) > 2 and now_s - self._readings[1][0] >= self._window_s:
            self._readings.popleft()

    @property
    def increase(self) -> int:
        """Increase over the window, or since the first reading."""
        return self._readings[-1][1] - self._readings[0][1] if self._readings else 0

    @property
    def per_s(self) -> float:
        """Mean increase per second, at least 0; 0 before the second reading."""
        elapsed_s = self._readings[-1][0] - self._readings[0][0] if self._readings else 0.0
        return max(0.0, self.increase / elapsed_s) if elapsed_s else 0.0


def age_s(seen_s: float | None, now_s: float) -> float | None:
    """Return the time since something was seen, None before it."""
    return None if seen_s is None else max(0.0, now_s - seen_s)


CHECK_IN_LIMIT_S = 1.0


class HeartbeatGate:
    """Last check-in of each part, in loop time.

    A part counts from its first :meth:`check_in` until :meth:`check_out`. One that is silent for
    longer than the limit blocks the heartbeat; without it the drum ramps down and lifts.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._checked_in_s: dict[str, float] = {}

    def check_in(self, name: str) -> None:
        """Record that ``name`` is alive now."""
        self._checked_in_s[name] = self._now_s()

    def check_out(self, name: str) -> None:
        """Expect no more check-ins of ``name``."""
        self._checked_in_s.pop(name, None)

    @property
    def overdue(self) -> list[str]:
        """Names whose check-in is overdue."""
        oldest_s = self._now_s() - CHECK_IN_LIMIT_S
        return [name for name, at_s in self._checked_in_s.items() if at_s < oldest_s]

    def is_open(self) -> bool:
        """Return whether the heartbeat may be sent."""
        return not self.overdue


MAX_LOST_SHARE = 0.01
"""More samples lost on the way make trials fail; at one damaged byte in 10,000 it is a third."""
LOST_WINDOW_S = 10.0


class LineMonitor:
    """Judges the line of the taxels by its gaps in the last ten seconds.

    A stall of the computer, too, loses samples, but in a single gap.
    """

    def __init__(self) -> None:
        self._gaps = RateMeter(LOST_WINDOW_S)
        self._received = RateMeter(LOST_WINDOW_S)

    def update(self, now_s: float, received: int, gaps: int) -> None:
        """Add the counts of now: of samples received, and of gaps between them."""
        self._received.update(now_s, received)
        self._gaps.update(now_s, gaps)

    @property
    def lost_share(self) -> float:
        """Share of the samples that were lost, at one a gap."""
        return self._gaps.increase / max(1, self._gaps.increase + self._received.increase)

    def must_pause(self, paused: bool) -> bool:
        """Return whether too many are lost; a ``paused`` run goes on with half as many."""
        is_full = self._received.increase > LOST_WINDOW_S / 2 * SAMPLE_RATE_HZ
        return paused if not is_full else self.lost_share > MAX_LOST_SHARE / (1 + paused)


DRUM, TAXELS = "drum", "taxels"
READ_PERIOD_S = 0.95
"""From one read of the drum's counters to the poll before the next, which follows a poll."""
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
            await asyncio.sleep(READ_PERIOD_S)
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


ACTIVE_WINDOW_S = 1.0
RATE_WINDOW_S = 30.0
RESERVE_S = 120.0
RESERVE_BYTES = 64 << 20
SLOW_SAMPLES = 40_000
"""A bench whose disk is 40 s behind pauses; a simulated one waits for its disk before that."""
HUNG_SAMPLES = 60_000
"""A recorder whose queue holds a minute of samples counts as hung."""


class DiskMonitor:
    """Follows one recorder. Times are loop time; call :meth:`update` about ten times a second."""

    def __init__(self, recorder: SessionRecorder) -> None:
        self._recorder = recorder
        self._status = recorder.status
        self._samples = RateMeter(ACTIVE_WINDOW_S)
        self._bytes = RateMeter(RATE_WINDOW_S)

    def update(self, now_s: float) -> None:
        """Read the recorder's status."""
        self._status = status = self._recorder.status
        self._samples.update(now_s, status.samples_on_disk)
        self._bytes.update(now_s, status.bytes_on_disk)

    @property
    def recorder_works(self) -> bool:
        """Whether the recorder keeps up or has reported a failure."""
        return self._status.failure is not None or self._status.queue_samples < HUNG_SAMPLES

    @property
    def grows(self) -> bool:
        """Whether samples have reached the disk within the last second."""
        return self._samples.increase > 0

    def must_pause(self, paused: bool) -> bool:
        """Return whether the disk is too full or too slow to record.

        A ``paused`` run needs twice the space, and everything written.
        """
        status = self._status
        reserve = (RESERVE_BYTES + RESERVE_S * self._bytes.per_s) * (2 if paused else 1)
        is_behind = status.queue_samples > (0 if paused else SLOW_SAMPLES)
        return status.disk_free_bytes < reserve or is_behind

    def status(self, recording: bool) -> RecordingStatus:
        """Return the recording's part of the status message."""
        status, rate = self._status, self._bytes.per_s
        return RecordingStatus(
            active=recording and self.grows,
            samples_on_disk=status.samples_on_disk,
            samples_last_s=self._samples.increase,
            folder=str(self._recorder.folder),
            disk_free_bytes=status.disk_free_bytes,
            hours_left=status.disk_free_bytes / rate / 3600 if rate > 0 else None,
            failure=status.failure,
        )
