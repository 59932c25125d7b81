"""Readings in counts, in volts, or as conductances."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.encoding.reading import FULL_SCALE, STEPS

NOMINAL_SUPPLY_V = 5.0
"""The converter's reference where the board has not reported its supply."""


@dataclass(frozen=True, slots=True)
class ValueScale:
    """The unit of readings; ``supply_v``: the voltage of the highest count, None for counts.

    ``is_conductance``: readings are steps of the divider's conductance, shown as multiples of it.
    """

    supply_v: float | None = None
    is_conductance: bool = False

    @property
    def unit(self) -> str:
        """The name of the unit."""
        if self.is_conductance:
            return "× G divider"
        return "counts" if self.supply_v is None else "V"

    def text(self, counts: float, signed: bool = False, digits: int = 3) -> str:
        """Return a reading, or with its sign a difference, without the unit.

        ``digits``: of a voltage behind the point.
        """
        sign = "+" if signed else ""
        if self.is_conductance:
            return f"{counts / STEPS:{sign}.{digits}f}".replace("-", "−")
        if self.supply_v is None:
            return f"{counts:{sign}.0f}".replace("-", "−")
        return f"{counts * self.supply_v / FULL_SCALE:{sign}.{digits}f}".replace("-", "−")

    def ticks(self, low: float, high: float) -> list[tuple[float, str]]:
        """Return five axis ticks of a band from 0 (``high``) to 1 (``low`` counts)."""
        return [(i / 4, self.text(high - i / 4 * (high - low))) for i in range(5)]
