"""How pymodbus' frames are read here: cheap, and damage told at once instead of waited out."""

from __future__ import annotations

import struct
from collections.abc import Callable

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersResponse,
    ReadWriteMultipleRegistersResponse,
)

from rigctl.wire import modbus_rtu
from rigctl.wire.drum.register_table import UNIT

_REGISTERS: dict[int, type[ModbusPDU]] = {
    modbus_rtu.READ: ReadHoldingRegistersResponse,
    modbus_rtu.READ_WRITE: ReadWriteMultipleRegistersResponse,
}
_UNIT_BYTE = bytes([UNIT])


class ReplyDecoder(DecodePDU):
    """Replies with registers are taken apart in one go; all others as pymodbus does it."""

    def __init__(self) -> None:
        super().__init__(is_server=False)

    def decode(self, frame: bytes) -> ModbusPDU | None:
        """The reply in a frame without unit and CRC; None where it is none."""
        kind = _REGISTERS.get(frame[0])
        if kind is None:
            return super().decode(frame)
        if len(frame) % 2:
            return None
        reply = kind()
        reply.registers = list(struct.unpack_from(f">{len(frame) // 2 - 1}H", frame, 2))
        return reply


class ReplyFramer(FramerRTU):
    """Finds the reply of the one board on the line, also behind bytes that are none.

    ``on_damaged`` is called for a reply that is whole in length but not in content.
    """

    def __init__(self, on_damaged: Callable[[], None]) -> None:
        super().__init__(ReplyDecoder())
        self._on_damaged = on_damaged

    def encode(self, payload: bytes, device_id: int, _tid: int) -> bytes:
        """A request with its unit and CRC."""
        return modbus_rtu.framed(bytes([device_id]) + payload)

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        """Bytes done with, unit, 0, and the reply without unit and CRC; nothing while it comes."""
        decisive_end = 0
        start = data.find(_UNIT_BYTE)
        while start >= 0:
            length = modbus_rtu.reply_bytes(data, start)
            end = start + length
            if length and end <= len(data) and modbus_rtu.crc(data[start:end]) == 0:
                return end, UNIT, 0, data[start + 1 : end - 2]
            # What looks like the first head decides whether the reply is still coming.
            decisive_end = decisive_end or (end if length else 0)
            start = data.find(_UNIT_BYTE, start + 1)
        if not decisive_end or decisive_end > len(data):
            return 0, 0, 0, b""
        self._on_damaged()
        return len(data), 0, 0, b""
