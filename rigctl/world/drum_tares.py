"""The virtual drum's tares: at rest, and over a turn of the lifted drum."""

from __future__ import annotations

from rigctl.wire.drum_map import TARE_PLACES
from rigctl.wire.drum_tare import PLACE_NAMES, TareTurn, counts_at, place_table
from rigctl.world.drum_loadcell import LoadcellWatch
from rigctl.world.drum_registers import RegisterBank
from rigctl.world.drum_turner import Turner


class Tares:
    """What the load cell reads at no load, as far as the board knows; ``tared`` since boot."""

    def __init__(self, bank: RegisterBank, cell: LoadcellWatch, turner: Turner) -> None:
        self.tared = False
        self._bank = bank
        self._cell = cell
        self._turner = turner
        self._turn: TareTurn | None = None

    def place_counts(self, now_us: int) -> float:
        """What the drum's angle adds to the tare; 0 where the angle is not known."""
        if not self._turner.homed:
            return 0.0
        return counts_at(place_table(self._bank.settings), self._turner.turn_share(now_us))

    @property
    def busy(self) -> bool:
        """Readings are being gathered for a tare."""
        return self._turn is not None or self._cell.taring

    def begin_turn(self) -> None:
        """Readings at constant speed belong to a turn's tare from now on."""
        self._turn = TareTurn()

    def abandon(self) -> None:
        """Whatever was begun changes nothing."""
        self._cell.abandon_tare()
        self._turn = None

    def reading(self, raw: int, now_us: int) -> None:
        """A reading of the load cell."""
        if self._turn is not None and self._turner.motion.constant:
            self._turn.add(raw, self._turner.turn_share(now_us))

    def finish_turn(self) -> bool:
        """The move is over; True where it gave a tare, or none was begun."""
        if self._turn is None:
            return True
        found, self._turn = self._turn.finish(), None
        if found is None:
            return False
        mean, table = found
        assert len(table) == TARE_PLACES
        for name, raw in zip(PLACE_NAMES, table, strict=True):
            self._bank.put(name, raw)
        self._take(mean)
        return True

    def finish_still(self) -> bool | None:
        """True or False once, when a tare at rest is over; None while there is none."""
        tare = self._cell.finished_tare()
        if tare is None:
            return None
        if tare.steady:
            self._take(tare.mean_counts - round(self._cell.place_counts))
        return tare.steady

    def _take(self, counts: int) -> None:
        self._bank.put("tare_counts", counts)
        self.tared = True
