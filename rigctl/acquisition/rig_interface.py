"""What the engine needs of a rig, real or simulated: two boards, a loop, and nothing else.

Whoever opens a rig hands it in; the engine cannot tell one kind from another. Tests hand in
small fakes.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from rigctl.config.rig_config import RigConfig
from rigctl.errors import RigFault
from rigctl.values import Block, BoardIdentity, DrumState
from rigctl.wire.drum.codes import Command
from rigctl.wire.taxels.frames import TaxelStatus
from rigctl.wire.taxels.self_test import SelfTest


class DrumBoard(Protocol):
    """The drum as its driver offers it."""

    @property
    def retries(self) -> int:
        """Polls that were asked again because request or reply was lost or damaged."""
        ...

    async def connect(self) -> BoardIdentity:
        """Ask who is there. Raises LinkLost or WrongBoard."""
        ...

    async def poll(self, beat: bool = True) -> DrumState:
        """One exchange: beat, and read the state. Raises LinkLost."""
        ...

    async def set(self, **values: float) -> dict[str, float]:
        """Write settings in engineering units; what the board really took."""
        ...

    async def get(self, *names: str) -> dict[str, float]:
        """Read settings in engineering units."""
        ...

    async def command(self, command: Command, wait: bool = False) -> None:
        """Have a command executed. Raises CommandRefused."""
        ...

    async def stop(self) -> None:
        """STOP ahead of everything else, at the price of the reply in flight."""
        ...

    def close(self) -> None:
        """Let go of the port."""
        ...


class TaxelBoard(Protocol):
    """The taxel board as its driver offers it."""

    status: TaxelStatus | None
    self_test: SelfTest | None

    @property
    def findings(self) -> list[str]:
        """What the last self-test found, a sentence each."""
        ...

    async def test(self) -> SelfTest:
        """Have the board test its lines and the sensor. Raises LinkLost."""
        ...

    def on_self_test(self, consumer: Callable[[SelfTest], None]) -> None:
        """Have the outcome of every self-test given to ``consumer``."""
        ...

    async def connect(self) -> BoardIdentity:
        """Ask who is there. Raises LinkLost or WrongBoard."""
        ...

    def on_block(self, consumer: Callable[[Block], None]) -> None:
        """Have every block given to ``consumer``."""
        ...

    def on_fault(self, consumer: Callable[[RigFault], None]) -> None:
        """Have ``consumer`` told of a lost link, a reboot, or a consumer that failed."""
        ...

    def close(self) -> None:
        """Let go of the port."""
        ...


class RigInterface(Protocol):
    """A rig. ``kind`` is virtual, firmware or bench; ``faults`` is None at a real one."""

    @property
    def loop(self) -> asyncio.AbstractEventLoop: ...

    @property
    def drum(self) -> DrumBoard: ...

    @property
    def taxels(self) -> TaxelBoard: ...

    @property
    def kind(self) -> str: ...

    @property
    def simulated(self) -> bool: ...

    @property
    def config(self) -> RigConfig: ...

    @property
    def description(self) -> str: ...

    @property
    def faults(self) -> Any: ...

    @property
    def world(self) -> dict[str, Any]:
        """What a session keeps of a simulated world, by name; empty at a real rig."""
        ...

    def set_plate(self, texture: str) -> bool:
        """True where the plate changed by itself; False where a person must change it."""
        ...

    def save_truth(self, folder: Path) -> None:
        """Store what a simulated world knows to be true; nothing at a real rig."""
        ...

    def close(self) -> None:
        """Let go of ports and boards."""
        ...
