"""A trial's first sample from the drum's own clock, for a rig without a sync wire.

The drum records when its window opens. The computer's clock links both boards' clocks: data
arrive late by their time on the wire, by cables and at random, and never early, so the earliest
arrivals of the last seconds lie on a line. The time on the wire is known and subtracted.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rigctl.devices.clock_fit import ClockFit
from rigctl.values import SAMPLE_RATE_HZ
from rigctl.wire.drum import register_table
from rigctl.wire.taxels import frames

CABLE_S = 0.004
"""Delay that one USB adapter may add and the other may not; no clock shows it."""
SAMPLE_S = 1.0 / SAMPLE_RATE_HZ
_BITS_PER_BYTE = 10
_REPLY_BYTES = 2 * register_table.POLL_BLOCK[1] + 5
POLL_WIRE_S = _REPLY_BYTES * _BITS_PER_BYTE / register_table.BAUD
"""From the drum's reading of its clock to the last byte of the reply that holds it."""
FRAME_WIRE_S = SAMPLE_S + frames.FRAME_BYTES * _BITS_PER_BYTE / frames.BAUD
"""From the start of a taxel frame's first reading to the frame's last byte."""


class TrialStart(NamedTuple):
    """Board counter of the first sample after the rise, and its uncertainty in ms."""

    first_counter: int
    uncertainty_ms: float


def estimate_trial_start(rise_us: int, drum: ClockFit, taxels: ClockFit) -> TrialStart | None:
    """Return the first taxel sample after the drum's window opened at ``rise_us`` of its clock.

    ``taxels`` pairs sample counters, in seconds of 1000 samples, with their arrivals. None where
    either clock is not known yet.
    """
    drum_line, taxel_line = drum.earliest_arrivals, taxels.earliest_arrivals
    if drum_line is None or taxel_line is None:
        return None
    rise_s = drum_line.loop_s(rise_us * 1e-6) - POLL_WIRE_S
    counter_s = taxel_line.board_s(rise_s + FRAME_WIRE_S)
    spread_s = drum_line.spread_s + taxel_line.spread_s
    uncertainty_ms = 1000 * (SAMPLE_S + CABLE_S + spread_s)
    return TrialStart(math.ceil(counter_s / SAMPLE_S), round(uncertainty_ms, 2))
