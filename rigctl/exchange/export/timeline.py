"""The one clock of an export: seconds since the start of a session.

Samples lie on it a millisecond apart by the taxel board's own counter, so a trial's spikes fall on
its samples. A board's resonator is off by up to half a percent: loop times of polls and events are
put beside the samples that arrived around them. Blocks arrive late at random and never early, so
the earliest arrival of some seconds tells the difference of both clocks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.layout import ARRIVALS, COUNTER, GAPS
from rigctl.session.part import PartReader

KNOT_S = 10.0
"""Time in which the earliest arrival is sought; clocks drift 50 ms in it at most."""

Times = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PartTimes:
    """The clock of a part's samples, and how far the loop's clock is ahead of it.

    ``first_tick``: time of the sample with ``first_counter``, in samples. ``ahead_s``: loop time
    less time of the export at the loop times ``loop_s``, float64 (n,) each, one or more.
    """

    first_counter: int
    last_counter: int
    first_tick: int
    rate_hz: float
    loop_s: Times
    ahead_s: Times

    def of_counter(self, counter: NDArray[np.int64] | int) -> Times:
        """Return the times of samples by the board's counter, float64 (n,)."""
        ticks = np.asarray(counter, np.int64) - self.first_counter + self.first_tick
        return np.asarray(ticks / self.rate_hz)

    def of_loop(self, loop_s: Times | float) -> Times:
        """Return the times of loop times, float64 (n,); NaN stays NaN."""
        at_s = np.asarray(loop_s, np.float64)
        return at_s - np.interp(at_s, self.loop_s, self.ahead_s)


def session_start(parts: Sequence[PartReader]) -> datetime:
    """Return the wall-clock time that all times count from. Raises SessionError without one."""
    part = parts[0]
    try:
        start = datetime.fromisoformat(part.header.start_utc)
    except ValueError as error:
        raise SessionError(f"{part.path}: start_utc is no time: {error}") from error
    return start if start.tzinfo else start.replace(tzinfo=UTC)


def part_times(parts: Sequence[PartReader]) -> Mapping[int, PartTimes]:
    """Return the clock of each part, by its number. Raises SessionError for a wrong start.

    A later sitting begins by the wall clock; where simulated time ran ahead of that, at the end of
    the one before, so that times ascend.
    """
    start = session_start(parts)
    found: dict[int, PartTimes] = {}
    before: tuple[PartReader, PartTimes] | None = None
    for part in parts:
        wall_s = (session_start([part]) - start).total_seconds()
        found[part.number] = times = _times_of(part, wall_s, before)
        before = part, times
    return found


def _times_of(
    part: PartReader, wall_s: float, before: tuple[PartReader, PartTimes] | None
) -> PartTimes:
    rate_hz = float(part.header.sample_rate_hz)
    start_loop_s = part.header.start_loop_s
    if not part.n_samples:
        begun = np.array([start_loop_s])
        first_s = wall_s if before is None else max(wall_s, _end_s(before[1]))
        return PartTimes(0, -1, round(first_s * rate_hz), rate_hz, begun, begun - first_s)
    first, last = (int(part.read(COUNTER, row, row + 1)[0]) for row in (0, part.n_samples - 1))
    counters, loop_s = _earliest_arrivals(part, first, rate_hz)
    delay_s = loop_s - (counters - first) / rate_hz
    if before is not None and _goes_on(*before, part, first):
        first_s = float(before[1].of_counter(first))
    else:
        end_s = 0.0 if before is None else _end_s(before[1])
        first_s = max(wall_s + float(delay_s[0]) - start_loop_s, end_s)
    first_tick = round(first_s * rate_hz)
    return PartTimes(first, last, first_tick, rate_hz, loop_s, delay_s - first_tick / rate_hz)


def _end_s(times: PartTimes) -> float:
    return float(times.of_counter(times.last_counter + 1))


def _goes_on(before: PartReader, times: PartTimes, part: PartReader, first: int) -> bool:
    """Return whether a part continues the counter of the one before: same sitting, same boot."""
    one, other = before.header, part.header
    same = (one.start_utc, one.start_loop_s, one.boards) == (
        other.start_utc,
        other.start_loop_s,
        other.boards,
    )
    return same and first > times.last_counter >= times.first_counter


def _earliest_arrivals(part: PartReader, first: int, rate_hz: float) -> tuple[Times, Times]:
    """Return counter and arrival of the earliest block of every :data:`KNOT_S`, float64 (n,)."""
    arrivals = part.rows(ARRIVALS)
    end = np.append(arrivals["first_row"][1:], part.n_samples)
    known = np.isfinite(arrivals["arrived_s"]) & (end <= part.n_samples) & (end > 0)
    if not known.any():  # such as of an import
        return np.array([float(first)]), np.array([part.header.start_loop_s])
    arrived_s, last_row = arrivals["arrived_s"][known], end[known] - 1
    gaps = part.rows(GAPS)
    lost_before = np.append(0, np.cumsum(gaps["count"]))
    counters = first + last_row + lost_before[np.searchsorted(gaps["row"], last_row, "right")]
    delay_s = arrived_s - counters / rate_hz
    knots = ((counters - first) / (KNOT_S * rate_hz)).astype(np.int64)
    order = np.lexsort((delay_s, knots))
    earliest = order[np.unique(knots[order], return_index=True)[1]]
    return counters[earliest].astype(np.float64), arrived_s[earliest]
