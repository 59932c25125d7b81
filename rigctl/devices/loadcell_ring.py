"""The drum's ring of load-cell samples, read only where a poll came too late for some."""

from __future__ import annotations

from rigctl.devices.modbus_client import ModbusClient
from rigctl.wire.drum.poll import RawSample
from rigctl.wire.drum.register_entry import Register
from rigctl.wire.drum.register_table import BY_NAME, RING_DEPTH
from rigctl.wire.drum.registers import BlockLayout

LONGEST_READ = 20
"""Samples read in one exchange: 40 registers."""


async def read_ring(line: ModbusClient, wanted: range) -> dict[int, RawSample]:
    """What stands in the places of the samples ``wanted``, by sequence number.

    A place may have been overwritten meanwhile; its time tells.
    """
    found: dict[int, RawSample] = {}
    for part in _parts(wanted):
        raw = await _numbers(line, "ring_raw", part)
        times_us = await _numbers(line, "ring_time_us", part)
        found |= dict(zip(part, zip(raw, times_us, strict=True), strict=True))
    return found


async def _numbers(line: ModbusClient, name: str, part: range) -> tuple[int, ...]:
    ring = BY_NAME[name]
    address = ring.address + ring.words * (part.start % RING_DEPTH)
    some = Register(name, address, ring.kind, "", 1, "", count=len(part))
    words = await line.read(address, ring.words * len(part))
    return BlockLayout(address, len(words), (some,)).raw(words)[name]


def _parts(wanted: range) -> list[range]:
    """Runs of sequence numbers that stand side by side in the ring, each one read long."""
    parts: list[range] = []
    at = wanted.start
    while at < wanted.stop:
        to_end = RING_DEPTH - at % RING_DEPTH
        part = range(at, min(wanted.stop, at + min(LONGEST_READ, to_end)))
        parts.append(part)
        at = part.stop
    return parts
