"""Decode polls of the drum: unwrap times and counters, and lose no load-cell sample.

The poll block holds the five newest load-cell samples; where more are new, the board's ring
still has them for 0.8 s, and :meth:`PollDecoder.missing` returns which to read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from rigctl.boards.drum_codes import Status
from rigctl.boards.drum_registers import (
    LOADCELL_RECENT,
    POLL,
    POLL_BLOCK,
    RING_DEPTH,
    TARE_PLACES,
    BlockLayout,
)
from rigctl.values import DrumState, LoadcellSample

_U16, _U32 = 1 << 16, 1 << 32
_SCALES = {entry.name: entry.scale for entry in POLL}

RawPoll = Mapping[str, tuple[int, ...]]
"""The integers of one poll block by name, as ``PollDecoder.layout.unpack`` returns them."""
RingSample = tuple[int, int]
"""Raw counts and board time, µs modulo 2³², of one load-cell sample in the ring."""


def unwrap(last: int, wire: int, modulus: int) -> int:
    """Return the first integer at or after ``last`` that equals ``wire`` modulo ``modulus``."""
    return last + (wire - last) % modulus


# An unbalanced drum weighs on the load cell by its angle. The table holds what each of sixteen
# places of the turn adds to `tare_counts`, with linear interpolation between places.
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


class PollDecoder:
    """Decodes the poll blocks of one boot of the board, in order, into drum states.

    ``tare_counts``, ``scale_ug_per_count`` and, by the angle of a homed drum of
    ``steps_per_turn``, ``tare_table`` convert raw load-cell counts to grams, as on the board;
    set them here when they change there. ``last`` is the newest state, ``loadcell_lost`` counts
    lost samples.
    """

    layout = BlockLayout(*POLL_BLOCK, entries=POLL)

    def __init__(
        self, tare_counts: int = 0, scale_ug_per_count: int = 0, steps_per_turn: int = 1
    ) -> None:
        self.tare_counts = tare_counts
        self.scale_ug_per_count = scale_ug_per_count
        self.tare_table: tuple[int, ...] = ()
        self.steps_per_turn = steps_per_turn
        self.loadcell_lost = 0
        self.last: DrumState | None = None
        self._sequence: int | None = None
        self._sample_us = 0
        self._homed = False

    def is_behind(self, raw: RawPoll) -> bool:
        """Return whether the board took this block before the last one: it came late."""
        if self.last is None:
            return False
        return (raw["board_time_us"][0] - self.last.board_time_us) % _U32 >= _U32 // 2

    def missing(self, raw: RawPoll) -> range:
        """Return the sequence numbers that are new, not in this block, but perhaps in the ring."""
        if self._sequence is None:
            return range(0)
        newest = unwrap(self._sequence, raw["loadcell_sequence"][0], _U16)
        oldest = max(self._sequence + 1, newest - RING_DEPTH + 1)
        return range(oldest, max(newest - LOADCELL_RECENT + 1, oldest))

    def decode(
        self, raw: RawPoll, at_s: float, ring: Mapping[int, RingSample] | None = None
    ) -> DrumState:
        """Return the state of a block that was received at loop time ``at_s``.

        ``ring``: samples of :meth:`missing` by sequence number, as far as they could be read.
        """
        now_us = self._board_time(raw["board_time_us"][0])
        lost_before = self.loadcell_lost
        self._homed = bool(raw["status_bits"][0] >> Status.HOMED & 1)
        samples = self._new_samples(raw, now_us, ring or {})
        lost = self.loadcell_lost - lost_before
        self.last = self._state(raw, at_s, now_us, samples, lost)
        return self.last

    def _board_time(self, wire_us: int) -> int:
        return wire_us if self.last is None else unwrap(self.last.board_time_us, wire_us, _U32)

    def _new_samples(
        self, raw: RawPoll, now_us: int, ring: Mapping[int, RingSample]
    ) -> tuple[LoadcellSample, ...]:
        """Return the samples since the last poll, oldest first; counts the lost ones."""
        wire = raw["loadcell_sequence"][0]
        newest_us = now_us - (now_us - raw["loadcell_time_us"][0]) % _U32
        if self._sequence is None:
            last, self._sample_us = wire - 1, newest_us
        else:
            last = self._sequence
        newest = unwrap(last, wire, _U16)
        held, recent = min(LOADCELL_RECENT, newest - last), raw["loadcell_recent"]
        counts = [
            (n, raw) for n, (raw, at_us) in ring.items() if self._is_current(at_us, newest_us)
        ]
        counts += zip(range(newest - held + 1, newest + 1), recent[:held][::-1], strict=True)
        self.loadcell_lost += newest - last - len(counts)
        samples = self._timed(counts, last, newest, newest_us, self._turns(raw, now_us))
        self._sequence, self._sample_us = newest, newest_us
        return samples

    def _is_current(self, ring_us: int, newest_us: int) -> bool:
        """Return False where a newer sample has overwritten the ring's place meanwhile."""
        return self._sample_us < newest_us - (newest_us - ring_us) % _U32

    def _turns(self, raw: RawPoll, now_us: int) -> Callable[[int], float] | None:
        """Return the drum's turns since its mark as a function of board time.

        It is linear since the last poll. None without a tare table or before homing.
        """
        if not self.tare_table or not self._homed:
            return None
        steps, last = raw["steps"][0], self.last
        span_us = now_us - last.board_time_us if last is not None else 0
        rate = (steps - last.steps) / span_us if last is not None and span_us else 0.0
        return lambda at_us: (steps - rate * (now_us - at_us)) / self.steps_per_turn

    def _timed(
        self,
        counts: Sequence[tuple[int, int]],
        last: int,
        newest: int,
        newest_us: int,
        turns: Callable[[int], float] | None,
    ) -> tuple[LoadcellSample, ...]:
        """Return samples with times evenly spaced between the newest of last and this poll.

        ``counts``: sequence number and raw counts of each, ascending.
        """
        span_us, n_new = newest_us - self._sample_us, max(newest - last, 1)
        tare, scale = float(self.tare_counts), self.scale_ug_per_count
        samples = []
        for n, raw in counts:
            at_us = newest_us - round(span_us * (newest - n) / n_new)
            if turns is not None:
                tare = self.tare_counts + interpolate(self.tare_table, turns(at_us))
            samples.append(LoadcellSample(n, at_us, raw, (raw - tare) * scale * 1e-6))
        return tuple(samples)

    def _state(
        self,
        raw: RawPoll,
        at_s: float,
        now_us: int,
        samples: tuple[LoadcellSample, ...],
        lost: int,
    ) -> DrumState:
        values = {name: numbers[0] * _SCALES[name] for name, numbers in raw.items()}
        sync_count, index_count = raw["sync_count"][0], raw["index_count"][0]
        if self.last is not None:
            sync_count = unwrap(self.last.sync_count, sync_count, _U16)
            index_count = unwrap(self.last.index_count, index_count, _U16)
        return DrumState(
            at_s=at_s,
            board_time_us=now_us,
            state=raw["state"][0],
            fault=raw["fault"][0],
            fault_bits=raw["fault_bits"][0],
            steps=raw["steps"][0],
            angle_deg=values["angle"],
            speed_mm_s=values["speed"],
            force_g=values["force"],
            actuator_position_um=raw["actuator_position_um"][0],
            actuator_drive_permille=raw["actuator_drive"][0],
            sync_count=sync_count,
            sync_rise_us=self._edge("sync_rise_us", raw, now_us),
            sync_fall_us=self._edge("sync_fall_us", raw, now_us),
            index_count=index_count,
            status_bits=raw["status_bits"][0],
            loadcell=samples,
            loadcell_lost=lost,
            values=values,
        )

    def _edge(self, name: str, raw: RawPoll, now_us: int) -> int:
        """Return the unwrapped time of a sync edge; an unchanged one keeps its time."""
        wire = raw[name][0]
        last_us = 0 if self.last is None else int(getattr(self.last, name))
        return last_us if last_us % _U32 == wire else now_us - (now_us - wire) % _U32
