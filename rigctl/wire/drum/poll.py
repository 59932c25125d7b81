"""What one poll of the drum says: unwrapped times and counters, and no load-cell sample lost.

The poll block holds the five newest load-cell samples; where more are new, the board's ring
still has them for 0.8 s, and :meth:`PollDecoder.missing` says which to read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from rigctl.values import DrumState, LoadcellSample
from rigctl.wire.drum.codes import Status
from rigctl.wire.drum.register_table import LOADCELL_RECENT, POLL, POLL_BLOCK, RING_DEPTH
from rigctl.wire.drum.registers import BlockLayout
from rigctl.wire.drum.tare_table import counts_at

_U16, _U32 = 1 << 16, 1 << 32
_SCALES = {entry.name: entry.scale for entry in POLL}

Raw = Mapping[str, tuple[int, ...]]
"""The integers of one poll block by name, as :meth:`PollDecoder.read` gives them."""
RawSample = tuple[int, int]
"""Raw counts and board time, µs modulo 2³², of one load-cell sample in the ring."""


def later(known: int, wire: int, modulus: int) -> int:
    """The first integer at or after ``known`` that equals ``wire`` modulo ``modulus``."""
    return known + (wire - known) % modulus


class PollDecoder:
    """Poll blocks of one boot of the board, in order, to drum states.

    ``tare_counts``, ``scale_ug_per_count`` and, by the angle of a homed drum of
    ``steps_per_turn``, ``tare_table`` turn raw load-cell counts into grams, as the board does;
    whoever changes them there changes them here. ``loadcell_lost`` counts samples since then.
    """

    layout = BlockLayout(*POLL_BLOCK, entries=POLL)

    def __init__(self, tare_counts: int = 0, scale_ug_per_count: int = 0) -> None:
        self.tare_counts = tare_counts
        self.scale_ug_per_count = scale_ug_per_count
        self.tare_table: tuple[int, ...] = ()
        self.steps_per_turn = 1
        self.loadcell_lost = 0
        self._last: DrumState | None = None
        self._sequence: int | None = None
        self._sample_us = 0
        self._homed = False

    @property
    def last(self) -> DrumState | None:
        """The newest state decoded, None before the first."""
        return self._last

    def read(self, words: Sequence[int]) -> Raw:
        """Take a poll block apart."""
        return self.layout.raw(words)

    def missing(self, raw: Raw) -> range:
        """Sequence numbers that this block shows as new, does not hold, and the ring may."""
        if self._sequence is None:
            return range(0)
        newest = later(self._sequence, raw["loadcell_sequence"][0], _U16)
        oldest = max(self._sequence + 1, newest - RING_DEPTH + 1)
        return range(oldest, max(newest - LOADCELL_RECENT + 1, oldest))

    def decode(
        self, raw: Raw, at_s: float, ring: Mapping[int, RawSample] | None = None
    ) -> DrumState:
        """The state that a block shows, received at loop time ``at_s``.

        ``ring``: the samples that :meth:`missing` asked for, as far as they could be read.
        """
        now_us = self._board_time(raw["board_time_us"][0])
        lost_before = self.loadcell_lost
        self._homed = bool(raw["status_bits"][0] >> Status.HOMED & 1)
        samples = self._new_samples(raw, now_us, ring or {})
        lost = self.loadcell_lost - lost_before
        self._last = self._state(raw, at_s, now_us, samples, lost)
        return self._last

    def _board_time(self, wire_us: int) -> int:
        return wire_us if self._last is None else later(self._last.board_time_us, wire_us, _U32)

    def _new_samples(
        self, raw: Raw, now_us: int, ring: Mapping[int, RawSample]
    ) -> tuple[LoadcellSample, ...]:
        """Samples since the last poll, oldest first; counts those that are gone."""
        wire = raw["loadcell_sequence"][0]
        newest_us = now_us - (now_us - raw["loadcell_time_us"][0]) % _U32
        if self._sequence is None:
            known, self._sample_us = wire - 1, newest_us
        else:
            known = self._sequence
        newest = later(known, wire, _U16)
        held, recent = min(LOADCELL_RECENT, newest - known), raw["loadcell_recent"]
        found = {n: counts for n, (counts, at) in ring.items() if self._plausible(at, newest_us)}
        found |= zip(range(newest - held + 1, newest + 1), recent[:held][::-1], strict=True)
        self.loadcell_lost += newest - known - len(found)
        samples = self._timed(found, known, newest, newest_us, self._turn(raw, now_us))
        self._sequence, self._sample_us = newest, newest_us
        return samples

    def _plausible(self, ring_us: int, newest_us: int) -> bool:
        """False for a place of the ring that a newer sample has overwritten meanwhile."""
        return self._sample_us < newest_us - (newest_us - ring_us) % _U32

    def _turn(self, raw: Raw, now_us: int) -> Callable[[int], float] | None:
        """The drum's turns behind its mark at a board time, in line since the last poll.

        None where the tare is the same all around, or nobody knows where the mark is.
        """
        if not self.tare_table or not self._homed:
            return None
        steps, last = raw["steps"][0], self._last
        span_us = now_us - last.board_time_us if last is not None else 0
        rate = (steps - last.steps) / span_us if last is not None and span_us else 0.0
        return lambda at_us: (steps - rate * (now_us - at_us)) / self.steps_per_turn

    def _timed(
        self,
        found: Mapping[int, int],
        known: int,
        newest: int,
        newest_us: int,
        turn: Callable[[int], float] | None,
    ) -> tuple[LoadcellSample, ...]:
        """Times between those of the newest samples of this and of the last poll."""
        span_us, count = newest_us - self._sample_us, max(newest - known, 1)
        tare, scale = float(self.tare_counts), self.scale_ug_per_count
        samples = []
        for n in sorted(found):
            at_us, counts = newest_us - round(span_us * (newest - n) / count), found[n]
            if turn is not None:
                tare = self.tare_counts + counts_at(self.tare_table, turn(at_us))
            samples.append(LoadcellSample(n, at_us, counts, (counts - tare) * scale * 1e-6))
        return tuple(samples)

    def _state(
        self,
        raw: Raw,
        at_s: float,
        now_us: int,
        samples: tuple[LoadcellSample, ...],
        lost: int,
    ) -> DrumState:
        values = {name: numbers[0] * _SCALES[name] for name, numbers in raw.items()}
        last = self._last
        sync_count = (
            raw["sync_count"][0]
            if last is None
            else later(last.sync_count, raw["sync_count"][0], _U16)
        )
        index_count = (
            raw["index_count"][0]
            if last is None
            else later(last.index_count, raw["index_count"][0], _U16)
        )
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

    def _edge(self, name: str, raw: Raw, now_us: int) -> int:
        """Unwrapped time of a sync edge; one that did not change is not reckoned anew."""
        wire = raw[name][0]
        known = 0 if self._last is None else int(getattr(self._last, name))
        return known if known % _U32 == wire else now_us - (now_us - wire) % _U32
