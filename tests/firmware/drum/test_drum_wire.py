"""Every poll at 50 Hz is answered, and noise has no effect; the benchmark runs ten minutes."""

from __future__ import annotations

from tests.benchmarks.firmware._drum_wire import POLLS_S, fuzz, soak

SOAK_S = 15
FUZZ_BYTES = 30_000


def test_every_poll_is_answered_in_time() -> None:
    polls, missed, slowest_us = soak(SOAK_S)
    assert polls >= 0.99 * SOAK_S * POLLS_S
    assert missed == 0
    assert slowest_us < 5000


def test_noise_changes_no_register_and_restarts_nothing() -> None:
    assert fuzz(FUZZ_BYTES) == (0, 0)
