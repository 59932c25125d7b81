"""The drum's ring of load-cell samples, read only where a poll came too late for some."""

from __future__ import annotations

from collections.abc import Iterator

from rigctl.devices.modbus_client import ModbusClient
from rigctl.wire.drum.poll import RingSample
from rigctl.wire.drum.register_entry import Register
from rigctl.wire.drum.register_table import BY_NAME, RING_DEPTH
from rigctl.wire.drum.registers import BlockLayout

MAX_READ = 20
"""Samples of one exchange: 40 registers."""


async def read_ring(modbus: ModbusClient, sequences: range) -> dict[int, RingSample]:
    """Return the ring's samples of ``sequences`` by sequence number.

    A newer sample may have overwritten one meanwhile; its time shows it.
    """
    samples: dict[int, RingSample] = {}
    for part in _contiguous(sequences):
        raw = await _read_part(modbus, "ring_raw", part)
        times_us = await _read_part(modbus, "ring_time_us", part)
        samples |= dict(zip(part, zip(raw, times_us, strict=True), strict=True))
    return samples


async def _read_part(modbus: ModbusClient, name: str, part: range) -> tuple[int, ...]:
    ring = BY_NAME[name]
    address = ring.address + ring.words * (part.start % RING_DEPTH)
    entry = Register(name, address, ring.kind, "", 1, "", count=len(part))
    words = await modbus.read(address, ring.words * len(part))
    return BlockLayout(address, len(words), (entry,)).unpack(words)[name]


def _contiguous(sequences: range) -> Iterator[range]:
    """Yield the parts of ``sequences`` that are contiguous in the ring and fit one read."""
    start = sequences.start
    while start < sequences.stop:
        to_end = RING_DEPTH - start % RING_DEPTH
        part = range(start, min(sequences.stop, start + min(MAX_READ, to_end)))
        yield part
        start = part.stop
