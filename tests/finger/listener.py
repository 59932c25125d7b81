"""The finger board's driver on a link in memory, and all that it hands on."""

from __future__ import annotations

from rigctl.errors import RigFault
from rigctl.finger.board_messages import Message
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.driver import Finger
from tests.boards.memory_link import JumpingLoop, MemoryLink
from tests.finger.board import FirmwareBoard

LOW = tuple(range(90, 99))
HIGH = tuple(range(600, 609))


class Listener:
    """Collects what the driver hands on."""

    def __init__(self, finger: Finger) -> None:
        self.blocks: list[FingerBlock] = []
        self.arrivals_s: list[float] = []
        self.messages: list[Message] = []
        self.faults: list[RigFault] = []
        finger.on_block(self._take)
        finger.on_message(lambda message, at_s: self.messages.append(message))
        finger.on_fault(self.faults.append)

    def _take(self, block: FingerBlock, at_s: float) -> None:
        self.blocks.append(block)
        self.arrivals_s.append(at_s)

    @property
    def counters(self) -> list[int]:
        return [int(counter) for block in self.blocks for counter in block.counters]

    @property
    def missing(self) -> int:
        return sum(block.missing for block in self.blocks)

    def of(self, kind: type[Message]) -> list[Message]:
        return [message for message in self.messages if isinstance(message, kind)]


def unconnected(loop: JumpingLoop) -> tuple[Finger, FirmwareBoard, MemoryLink, Listener]:
    link = MemoryLink(loop, "/dev/finger")
    board = FirmwareBoard(loop, link)
    finger = Finger(link, loop)
    return finger, board, link, Listener(finger)
