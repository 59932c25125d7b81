"""Where the hand is at each millisecond: what is planned, and what a fault makes of the plan."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.finger.bench.operator import (
    ALONG,
    EDGE_MM,
    FORCE,
    HEIGHT,
    N_COLUMNS,
    Slide,
    carry,
    lift,
    smooth_step,
)
from rigctl.finger.bench.operator_parameters import OperatorParameters
from rigctl.finger.values import MARKS_MM

KEPT_MS = 1000
"""Past milliseconds that a tracker can still report."""

RAMP_MS = 100
"""Time in which a hand changes its pace, and in which a finger is lifted or put down."""

BACK_MS = 400
"""Half of the time that a finger runs back before it goes on."""

TOO_FAST_MM_S = 600.0
_Floats = NDArray[np.float64]


class Contact(NamedTuple):
    """The part of a slide in which the finger is on the plate: rows float64 (n, 7), the rows to
    come after it, and the hand's habits.
    """

    rows: _Floats
    after: _Floats
    parameters: OperatorParameters


Change = Callable[[Contact], Contact]
"""What a fault makes of the rest of a slide."""


class Hand:
    """The hand from power-up on. Row ``ms`` holds at that millisecond."""

    def __init__(self, parameters: OperatorParameters) -> None:
        self._p = parameters
        rest = np.zeros(N_COLUMNS)
        rest[ALONG], rest[HEIGHT] = MARKS_MM[0] - parameters.run_up_mm, parameters.air_mm
        self._rows = np.tile(rest, (1, 1))
        self._first_ms = 0
        self._down_ms = self._up_ms = self._end_ms = 0

    def sliding(self, now_ms: int) -> bool:
        """Return whether a slide is planned or under way; it ends with the finger in the air."""
        return now_ms < self._end_ms

    @property
    def free_ms(self) -> int:
        """The millisecond from which nothing is planned."""
        return self._first_ms + len(self._rows)

    def plan(self, slide: Slide, now_ms: int, change: Change | None) -> int:
        """Append a slide to what is planned, and return the millisecond at which it begins."""
        begin_ms = max(now_ms + 1, self.free_ms)
        self._rows = self.rows(max(self._first_ms, now_ms - KEPT_MS), begin_ms)
        self._first_ms = begin_ms - len(self._rows)
        approach = carry(self._rows[-1], slide.rows[0], self._p.lower_s)
        self._rows = np.concatenate([self._rows, approach, slide.rows])
        first_ms = begin_ms + len(approach)
        self._down_ms, self._up_ms = first_ms + slide.down, first_ms + slide.up
        self._end_ms = self._up_ms + round(1000 * self._p.lift_s)
        if change is not None:
            self._change_middle(change)
        return begin_ms

    def change(self, now_ms: int, change: Change) -> bool:
        """Change the slide from now on, or in its middle if the finger is not down yet.

        Returns False without a slide.
        """
        if now_ms >= self._up_ms - 1:
            return False
        if now_ms < self._down_ms:
            self._change_middle(change)
        else:
            self._change(now_ms + 1, change)
        return True

    def rows(self, begin_ms: int, end_ms: int) -> _Floats:
        """Return the rows of these milliseconds, float64 (n, 7); the hand rests after its plan."""
        begin, end = begin_ms - self._first_ms, end_ms - self._first_ms
        if begin >= 0 and end <= len(self._rows):
            return self._rows[begin:end]
        rows: _Floats = self._rows[np.clip(np.arange(begin, end), 0, len(self._rows) - 1)]
        return rows

    def at(self, time_ms: float) -> _Floats:
        """Return the row at a time between milliseconds, float64 (7,)."""
        at = min(max(time_ms - self._first_ms, 0.0), len(self._rows) - 1.0)
        low = int(at)
        high = min(low + 1, len(self._rows) - 1)
        row: _Floats = self._rows[low] + (at - low) * (self._rows[high] - self._rows[low])
        return row

    def _change_middle(self, change: Change) -> None:
        along_mm = self._rows[self._down_ms - self._first_ms :, ALONG]
        self._change(self._down_ms + int(np.argmax(along_mm >= np.mean(MARKS_MM))), change)

    def _change(self, from_ms: int, change: Change) -> None:
        begin, up = from_ms - self._first_ms, self._up_ms - self._first_ms
        contact, after, _ = change(Contact(self._rows[begin:up], self._rows[up:], self._p))
        self._rows = np.concatenate([self._rows[:begin], contact, after])
        self._end_ms += len(contact) - (up - begin)
        self._up_ms = from_ms + len(contact)


def stand_still(seconds: float) -> Change:
    """Return the change that stops the hand for a time, with the finger on the plate."""
    return _at_pace(np.concatenate([_ramp(1.0, 0.0), np.zeros(round(1000 * seconds)), _ramp(0, 1)]))


def reverse(contact: Contact) -> Contact:
    """Run back for a while, then go on."""
    back = -np.ones(BACK_MS)
    pace = np.concatenate([_ramp(1.0, -1.0), back, _ramp(-1.0, 1.0)])
    return _at_pace(pace)(contact)


def too_fast(contact: Contact) -> Contact:
    """Make the rest of the slide at :data:`TOO_FAST_MM_S`."""
    rows = contact.rows
    distance_mm = rows[-1, ALONG] - rows[0, ALONG]
    pace = max(1.0, TOO_FAST_MM_S * len(rows) * 1e-3 / max(distance_mm, 1.0))
    at = np.cumsum(np.concatenate([_ramp(1.0, pace), np.full(len(rows), pace)]))
    return contact._replace(rows=_played(rows, np.append(at[at < len(rows) - 1], len(rows) - 1.0)))


def lift_for(seconds: float) -> Change:
    """Return the change that lifts the finger for a time while the hand moves on."""

    def change(contact: Contact) -> Contact:
        rows = contact.rows.copy()
        n = min(round(1000 * seconds), len(rows))
        in_air = np.minimum(np.arange(1, n + 1), np.arange(n, 0, -1)) / RAMP_MS
        rows[:n, FORCE] *= np.maximum(1.0 - 2.0 * in_air, 0.0)
        rows[:n, HEIGHT] = contact.parameters.air_mm * np.clip(2.0 * in_air - 1.0, 0.0, 1.0)
        return contact._replace(rows=rows)

    return change


def stop_early(contact: Contact) -> Contact:
    """Stop, lift the finger and carry the hand back."""
    slow = _played(contact.rows, np.minimum(np.cumsum(_ramp(1.0, 0.0)), len(contact.rows) - 1.0))
    slow[:, FORCE] *= 1.0 - smooth_step(len(slow))
    up = lift(contact.parameters, slow[-1])
    back = carry(up[-1], contact.after[-1], contact.parameters.return_s)
    return contact._replace(rows=slow, after=np.concatenate([up, back]))


def _at_pace(pace: _Floats) -> Change:
    """Return the change that plays a slide at a pace, 1 as planned, then as planned."""

    def change(contact: Contact) -> Contact:
        last = len(contact.rows) - 1.0
        at = np.cumsum(pace)
        rest = np.arange(at[-1] + 1.0, last + 0.5)
        return contact._replace(rows=_played(contact.rows, np.concatenate([at, rest])))

    return change


def _played(rows: _Floats, at: _Floats) -> _Floats:
    """Return the rows at fractional places; before the first one the hand goes back in line, but
    not off the plate.
    """
    inside = np.clip(at, 0.0, len(rows) - 1.0)
    low = np.minimum(inside.astype(int), max(len(rows) - 2, 0))
    high = np.minimum(low + 1, len(rows) - 1)
    played: _Floats = rows[low] + (inside - low)[:, None] * (rows[high] - rows[low])
    speed = rows[min(1, len(rows) - 1), ALONG] - rows[0, ALONG]
    back_mm = played[:, ALONG] + np.minimum(at, 0.0) * speed
    played[:, ALONG] = np.where(at < 0.0, np.maximum(back_mm, EDGE_MM), back_mm)
    return played


def _ramp(begin: float, end: float) -> _Floats:
    return begin + (end - begin) * np.arange(1, RAMP_MS + 1) / RAMP_MS
