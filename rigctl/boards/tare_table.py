"""The load cell's reading at no load by the drum's angle: a mean and a table over the turn.

An unbalanced drum weighs on the cell by its angle. The table holds what each of sixteen places
of the turn adds to ``tare_counts``, with linear interpolation between places.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rigctl.boards.drum_registers import TARE_PLACES

PLACE_NAMES = tuple(f"tare_place_{place:02d}" for place in range(TARE_PLACES))
"""Registers of the table, in the order of the turn."""


def tare_table(settings: Mapping[str, float]) -> tuple[int, ...]:
    """Return the table among the settings, empty where every place is 0."""
    # Every conversion calls this and the table is nearly always empty: no loop in that case.
    if not any(map(settings.get, PLACE_NAMES)):
        return ()
    table = tuple(int(settings.get(name, 0)) for name in PLACE_NAMES)
    return table if any(table) else ()


def interpolate(table: Sequence[int], turns: float) -> float:
    """Return what the table adds at ``turns`` turns since the index mark; 0 without a table."""
    if not table:
        return 0.0
    place = turns % 1.0 * TARE_PLACES
    first, share = int(place), place % 1.0
    here, following = table[first % TARE_PLACES], table[(first + 1) % TARE_PLACES]
    return here + (following - here) * share
