"""The load cell's reading at no load by the drum's angle: a mean and a table over the turn.

An unbalanced drum weighs on the cell by its angle. The table holds what each of sixteen places
of the turn adds to ``tare_counts``; between two places it is a straight line.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rigctl.wire.drum.register_table import TARE_PLACES

PLACE_NAMES = tuple(f"tare_place_{place:02d}" for place in range(TARE_PLACES))
"""Registers of the table, in the order of the turn."""

LEAST_READINGS = 3
_LARGEST = 32767


def place_table(settings: Mapping[str, float]) -> tuple[int, ...]:
    """The table among the settings, empty where every place is 0."""
    # Asked at every conversion, and nearly always empty: that answer comes without a loop.
    if not any(map(settings.get, PLACE_NAMES)):
        return ()
    table = tuple(int(settings.get(name, 0)) for name in PLACE_NAMES)
    return table if any(table) else ()


def counts_at(table: Sequence[int], turn: float) -> float:
    """What the table adds at ``turn`` turns behind the index mark; 0 without a table."""
    if not table:
        return 0.0
    place = turn % 1.0 * TARE_PLACES
    first, share = int(place), place % 1.0
    here, behind = table[first % TARE_PLACES], table[(first + 1) % TARE_PLACES]
    return here + (behind - here) * share


class TareTurn:
    """Readings over a turn of the lifted drum to a mean and a table."""

    def __init__(self) -> None:
        self._readings: list[list[int]] = [[] for _ in range(TARE_PLACES)]

    def add(self, raw: int, turn: float) -> None:
        """A raw reading at ``turn`` turns behind the index mark."""
        self._readings[round(turn % 1.0 * TARE_PLACES) % TARE_PLACES].append(raw)

    def finish(self) -> tuple[int, tuple[int, ...]] | None:
        """Mean and table in counts; None where a part of the turn is missing or far off."""
        if min(map(len, self._readings)) < LEAST_READINGS:
            return None
        means = [sum(readings) / len(readings) for readings in self._readings]
        mean = round(sum(means) / TARE_PLACES)
        table = tuple(round(m - mean) for m in means)
        return (mean, table) if max(map(abs, table)) <= _LARGEST else None
