"""What the live views show: samples, spikes, force, speed, events and the taxels' ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gui.live.drum_course import DrumCourse
from gui.live.navigation import EventMarks
from gui.live.sample_history import SampleHistory
from rigctl.encoder.normalisation import RunningRange
from rigctl.encoder.reading import FULL_SCALE, STEPS, Reading
from rigctl.engine.live_file import LiveReader

NOMINAL_SUPPLY_V = 5.0
"""The converter's reference where the board has not reported its supply."""


@dataclass(frozen=True, slots=True)
class ValueScale:
    """The unit of readings; ``supply_v``: the voltage of the highest count, None for counts.

    ``is_conductance``: readings are steps of the divider's conductance, shown as multiples of it.
    ``full_scale``: the highest count.
    """

    supply_v: float | None = None
    is_conductance: bool = False
    full_scale: int = FULL_SCALE

    @property
    def unit(self) -> str:
        """The name of the unit."""
        if self.is_conductance:
            return "× G divider"
        return "counts" if self.supply_v is None else "V"

    @property
    def factor(self) -> float:
        """What a reading is multiplied by."""
        if self.is_conductance:
            return 1 / STEPS
        return 1.0 if self.supply_v is None else self.supply_v / self.full_scale

    def text(self, counts: float, signed: bool = False, digits: int = 3) -> str:
        """Return a reading, or with its sign a difference, without the unit.

        ``digits``: of a voltage behind the point.
        """
        sign = "+" if signed else ""
        digits = 0 if self.factor == 1 else digits
        return f"{counts * self.factor:{sign}.{digits}f}".replace("-", "−")

    def ticks(self, low: float, high: float) -> list[tuple[float, str]]:
        """Return five axis ticks of a band from 0 (``high``) to 1 (``low`` counts)."""
        return [(i / 4, self.text(high - i / 4 * (high - low))) for i in range(5)]


class LiveData:
    """The last minutes of samples, or the whole of a recorded trial that is given.

    ``reading``: what they are; ``low``, ``high``: each taxel's range in it, float64 (n_taxels,).
    """

    def __init__(
        self, n_taxels: int, history: SampleHistory | None = None, drum: DrumCourse | None = None
    ) -> None:
        if history is None:
            history = SampleHistory(n_taxels, 2 * n_taxels)
        self.history = history
        self.drum, self.marks = drum or DrumCourse(), EventMarks()
        self.reading = self._engine_reading = Reading.COUNTS
        self._own_range: RunningRange | None = None
        self._fit_range(n_taxels)

    def set_sensor(self, n_taxels: int) -> None:
        """Begin anew with counts of a sensor of another number of taxels."""
        self.clear()
        self.history = SampleHistory(n_taxels, 2 * n_taxels)
        self.reading = self._engine_reading = Reading.COUNTS
        self._own_range = None
        self._fit_range(n_taxels)

    def _fit_range(self, n_taxels: int) -> None:
        self.low = np.zeros(n_taxels)
        self.high = np.full(n_taxels, float(FULL_SCALE))

    def clear(self) -> None:
        """Remove everything, as when another rig is connected."""
        for part in (self.history, self.drum, self.marks):
            part.clear()

    def pull(self, live: LiveReader) -> None:
        """Append what the engine wrote since the last pull."""
        n_new = self.history.pull(live)
        if self._own_range is None:
            low, high = live.normalisation
        else:
            self._own_range.update(self.samples_before(self.history.newest, n_new))
            shown = self._own_range.normalisation
            low, high = shown.low, shown.high
        self.low, self.high = np.asarray(low, float), np.asarray(high, float)
        self.drum.pull(live, self.history)

    def show_reading(self, reading: Reading, engine: Reading, inputs: tuple[int, ...]) -> None:
        """Show counts or conductances from the next sample on, and remove those of before.

        ``engine``: the reading of the engine's ranges; for another one the range is that of all
        readings shown. ``inputs``: the input of each taxel.
        """
        if (reading, engine) == (self.reading, self._engine_reading):
            return
        self.reading, self._engine_reading = reading, engine
        n_taxels = len(self.low)
        is_own = reading is not engine
        self._own_range = RunningRange(n_taxels, reading.least_range, reading) if is_own else None
        self.history.inputs = inputs if reading is Reading.CONDUCTANCE else ()
        self.history.clear()

    @property
    def has_own_range(self) -> bool:
        """Whether the views show another reading than the engine encodes."""
        return self._own_range is not None

    def add_event(self, at_s: float, kind: str, text: str, data: Mapping[str, Any]) -> None:
        """Mark an event of the engine that happens about now, at its time."""
        self.marks.add(float(self.history.position_at(at_s)), kind, text, data)

    def reading_at(self, position: int, taxel: int) -> int | None:
        """Return the reading of a taxel, from 0, at a position, None if it is lost."""
        readings = self.samples_before(position, 1)
        return int(readings[0, taxel]) if len(readings) else None

    def samples_before(self, position: int, n: int) -> NDArray[np.uint16]:
        """Return the readings of at most ``n`` samples up to a position, uint16 (k, n_taxels)."""
        return self.history.samples.between(*self._rows_before(position, n))

    def spikes_before(self, position: int, n: int) -> NDArray[np.uint8]:
        """Return the spikes of at most ``n`` samples up to a position, uint8 (k, n_rows)."""
        return self.history.spikes.between(*self._rows_before(position, n))

    def _rows_before(self, position: int, n: int) -> tuple[int, int]:
        bounds = self.history.counters.count_below(np.array([position - n + 1, position + 1]))
        return int(bounds[0]), int(bounds[1])
