"""The rows that a recorder appends to a session of the moving finger, read as they come."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rigctl.acquisition.follow.growing_reader import GrowingReader, finite
from rigctl.encoding.normalisation import Normalisation
from rigctl.finger_values import PredictionRow
from rigctl.session import finger_layout
from rigctl.session.finger_layout import parse_prediction
from rigctl.session.finger_session import FingerSession, board_ranges
from rigctl.session.layout import COUNTER, FLAGS, SAMPLES
from rigctl.session.part import PartReader, StructuredArray
from rigctl.values import Event
from rigctl.wire.finger.decoder import FingerBlock


class NewFingerRows(NamedTuple):
    """New rows of one part. ``blocks``: with the loop time at which the last sample arrived."""

    part: int
    ranges: Normalisation
    blocks: list[tuple[FingerBlock, float]]
    track: StructuredArray
    batches: StructuredArray
    predictions: list[PredictionRow]
    latencies: StructuredArray
    events: list[Event]


class GrowingFingerSession(GrowingReader[FingerSession]):
    """A session's new rows since the last :meth:`refresh`. Raises SessionError where it is damaged.

    At first these are the newest rows of the last part.
    """

    def __init__(self, path: Path) -> None:
        tables = (finger_layout.TRACK, finger_layout.LATENCIES)
        super().__init__(FingerSession.open(path), tables)

    def take_rows(self) -> Iterator[NewFingerRows]:
        """Yield the rows since the last call, part by part."""
        for part in self.new_parts():
            answers = self.rows(part, finger_layout.PREDICTIONS)
            yield NewFingerRows(
                part.number,
                board_ranges(part.header),
                [self._block(part, start, stop) for start, stop in self.slices(part)],
                self.rows(part, finger_layout.TRACK),
                self.rows(part, finger_layout.BATCHES),
                [_finite_answer(parse_prediction(row, part.path)) for row in answers],
                self.rows(part, finger_layout.LATENCIES),
                self.events(part),
            )

    def _block(self, part: PartReader, start: int, stop: int) -> tuple[FingerBlock, float]:
        arrays = (COUNTER, FLAGS, SAMPLES, finger_layout.SPIKES)
        counters, flags, samples, spikes = (part.read(path, start, stop) for path in arrays)
        block = FingerBlock(counters, flags, samples, spikes, 0)
        return block, self.arrived_s(part, stop)


def _finite_answer(row: PredictionRow) -> PredictionRow:
    """Return an answer whose numbers a message can hold."""
    shares = {
        str(name): finite(share)
        for name, share in row.probabilities.items()
        if isinstance(share, int | float)
    }
    return row._replace(
        at_s=finite(row.at_s),
        distance_mm=finite(row.distance_mm),
        seconds=finite(row.seconds),
        probabilities=shares,
        texture_set=tuple(map(str, row.texture_set)),
    )
