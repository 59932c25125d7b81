"""A figure of the drum's firmware as a row of the benchmarks."""

from __future__ import annotations

from typing import Any

from tests.benchmarks.encoder._peers import row

US = 16
"""Cycles in a microsecond."""
NOTE = "build/firmware/drum.elf on simavr, counted in cycles"
GRBL = "grbl 1.1, ATmega328P: stable control pulses (README of gnea/grbl)"
FAST_ACCEL = "FastAccelStepper, ATmega2560, one stepper (README of gin66/FastAccelStepper)"
PREDECESSOR = "the rig's predecessor, Chaudhry et al., NER 2023"


def figure(
    name: str,
    value: float,
    unit: str,
    what: str,
    peer: str | None = None,
    peer_value: float | None = None,
) -> dict[str, Any]:
    """Return ``firmware.drum.NAME``; a peer's value is published, not measured here."""
    if peer is not None:
        return row(f"firmware.drum.{name}", value, unit, peer, peer_value, f"{what}; {NOTE}")
    return {
        "name": f"firmware.drum.{name}",
        "value": value,
        "unit": unit,
        "peer": None,
        "peer_value": None,
        "ratio": None,
        "note": f"{what}; {NOTE}",
    }
