"""One entry of the drum's register table."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.wire.drum.codes import Guard


@dataclass(frozen=True, slots=True)
class Register:
    """One value on the drum's wire; ``count`` values of the same kind for an array.

    ``kind`` is u16, i16, u32 or i32. ``low`` and ``high`` bound what may be written, ``least``
    bounds its magnitude, ``default`` is the value at boot: all are raw integers. ``guard`` says
    when the value may be changed.
    """

    name: str
    address: int
    kind: str
    unit: str
    scale: float
    doc: str
    writable: bool = False
    low: int = 0
    high: int = 0
    default: int = 0
    count: int = 1
    least: int = 0
    guard: Guard = Guard.NONE

    @property
    def words(self) -> int:
        """Registers of 16 bits that one value takes."""
        return 2 if self.kind in ("u32", "i32") else 1

    @property
    def end(self) -> int:
        """First address behind this entry."""
        return self.address + self.words * self.count

    def accepts(self, raw: int) -> bool:
        """Return whether ``raw`` is within the bounds of what may be written."""
        return self.low <= raw <= self.high and abs(raw) >= self.least


def read_only(
    address: int, name: str, kind: str, unit: str, doc: str, scale: float = 1, count: int = 1
) -> Register:
    """Return an entry that the host cannot write."""
    return Register(name, address, kind, unit, scale, doc, count=count)


def setting(
    address: int,
    name: str,
    kind: str,
    unit: str,
    doc: str,
    bounds: tuple[int, int, int],
    scale: float = 1,
    guard: Guard = Guard.NONE,
    least: int = 0,
) -> Register:
    """Return a setting; ``bounds`` are low, high and default as raw integers."""
    low, high, default = bounds
    return Register(
        name, address, kind, unit, scale, doc, True, low, high, default, least=least, guard=guard
    )
