"""Benchmark the finger board's image: equality with the encoder, and instructions a millisecond."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tests.benchmarks.encoder._peers import row
from tests.firmware.building import built
from tests.firmware.finger.scans import differing_trains, synthetic_scan, through_image

SCANS = 20
TEENSY_CYCLES_PER_MS = 600_000
NOTE = f"build/firmware/finger.elf under QEMU, {SCANS} scans of all velocity profiles"
BUDGET = "cycles of a Teensy 4.0 in a millisecond; QEMU counts instructions, not cycles"


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``realtime.differing_trains`` and the instructions of the longest and mean sample."""
    built("firmware/finger.elf")
    scans = [synthetic_scan(number) for number in range(SCANS)]
    sent, count = through_image(scans)
    trains = differing_trains(sent, scans)
    trials = f"of {9 * SCANS} spike trains; {NOTE}"
    yield row("realtime.differing_trains", trains, "trains", "rigctl.encoder", 0, trials)
    for name, value in (("longest", count.longest), ("mean", round(count.mean))):
        yield row(
            f"realtime.instructions_{name}",
            value,
            "instructions",
            BUDGET,
            TEENSY_CYCLES_PER_MS,
            f"{name} of {count.samples} samples; {NOTE}",
        )
