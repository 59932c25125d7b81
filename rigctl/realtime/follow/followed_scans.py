"""Events of a scan as the engine sends them, made again from the batches and answers on disk."""

from __future__ import annotations

from collections.abc import Iterator

from rigctl.acquisition.follow.growing_reader import finite
from rigctl.finger_values import PredictionRow
from rigctl.realtime.follow.growing_finger_session import NewFingerRows
from rigctl.session.part import StructuredArray
from rigctl.values import SAMPLE_RATE_HZ, Event


class FollowedScans:
    """Follows the way and the time of the newest scan."""

    def __init__(self) -> None:
        self.velocity_mm_s = 0.0
        self._scan = -1
        self._distance_mm = self._scaled_s = 0.0

    def events(self, rows: NewFingerRows) -> list[Event]:
        """Return all new events in the order of time, those of the session among them."""
        found = [*self._batches(rows.batches), *map(_answer, rows.predictions), *rows.events]
        return sorted(found, key=lambda event: event.at_s)

    def _batches(self, batches: StructuredArray) -> Iterator[Event]:
        for row in batches:
            scan = int(row["scan"])
            if scan != self._scan:
                self._scan, self._distance_mm, self._scaled_s = scan, 0.0, 0.0
            self.velocity_mm_s = int(row["velocity_um_s"]) / 1000
            length_s = int(row["samples"]) / SAMPLE_RATE_HZ
            self._scaled_s += length_s
            self._distance_mm += self.velocity_mm_s * length_s
            yield self._batch(finite(row["reported_s"]))

    def _batch(self, at_s: float) -> Event:
        data = {
            "scan": self._scan,
            "velocity_mm_s": self.velocity_mm_s,
            "distance_mm": self._distance_mm,
            "seconds": self._scaled_s,
            "scaled_s": self._scaled_s,
        }
        text = f"{self.velocity_mm_s:.0f} mm/s, {self._distance_mm:.0f} mm"
        return Event(at_s, "batch", text, data)


def _answer(row: PredictionRow) -> Event:
    """Return the event of an answer; without the time of sending nobody reports its painting."""
    return Event(row.at_s, "prediction", row.texture, row._asdict())
