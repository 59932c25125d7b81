"""16 capacitive taxels on a Teensy: 4 × 4 in one layer, 16 bit, 1,000 samples a second.

A frame has 41 bytes: A5 5A, the sample number u32, the level of the sync line u8, 16 readings u16,
all little-endian, and CRC-16/CCITT of what is behind the first two bytes, high byte first.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.sensor_driver import Readings

START = b"\xa5\x5a"
BODY = struct.Struct("<IB16H")
FRAME_BYTES = len(START) + BODY.size + 2


class Teensy16:
    """One connection to the board, which sends from its boot on."""

    baud = 2_000_000
    n_taxels = 16
    rate_hz = 1000
    full_scale = 65_535
    counter_modulus = 1 << 32
    has_sync = True
    request = b""

    def __init__(self) -> None:
        self._rest = b""

    def decode(self, data: bytes) -> Readings:
        """Return the samples that these bytes complete."""
        wire, at, rejected, rows = self._rest + data, 0, 0, []
        while len(wire) - at >= FRAME_BYTES:
            body = wire[at + len(START) : at + len(START) + BODY.size]
            sent = int.from_bytes(wire[at + FRAME_BYTES - 2 : at + FRAME_BYTES], "big")
            if wire.startswith(START, at) and crc_hqx(body, 0xFFFF) == sent:
                rows.append(BODY.unpack(body))
                at += FRAME_BYTES
            else:
                at, rejected = at + 1, rejected + 1
        self._rest = wire[at:]
        values = np.array(rows, np.int64).reshape(-1, 2 + self.n_taxels)
        samples = values[:, 2:].astype(np.uint16)
        return Readings(values[:, 0], samples, values[:, 1] > 0, rejected)

    def encode(
        self, counters: NDArray[np.int64], samples: NDArray[np.uint16], sync: NDArray[np.bool_]
    ) -> bytes:
        """Return the frames of these samples, so that a simulated rig can have this sensor."""
        rows = zip(counters.tolist(), sync.tolist(), samples.tolist(), strict=True)
        bodies = [BODY.pack(number % (1 << 32), level, *row) for number, level, row in rows]
        return b"".join(START + body + crc_hqx(body, 0xFFFF).to_bytes(2, "big") for body in bodies)
