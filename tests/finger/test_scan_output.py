"""What a scan produces: latencies of the features."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from rigctl.engine.event_bus import EventBus
from rigctl.finger.board_messages import BatchReport, VelocitySource, WindowReport
from rigctl.finger.latency import LatencyLog
from rigctl.finger.scan_in_progress import ScanData, SentVelocity
from rigctl.finger.scan_recording import ScanOutput
from rigctl.finger.trackers.velocity import BatchVelocity, EstimateSource
from rigctl.finger.values import LatencyRow


class _Recorder:
    """Keeps the latencies, and takes everything else."""

    def __init__(self) -> None:
        self.latencies_ms: list[float] = []

    def add_row(self, row: Any) -> None:
        if isinstance(row, LatencyRow):
            self.latencies_ms.append(row.ms)


@pytest.mark.parametrize(
    ("source", "sent_s", "latencies_ms"),
    [
        (VelocitySource.RECEIVED, 9.998, [2.0]),
        (VelocitySource.HELD, 10.001, []),
        (VelocitySource.MISSING, 10.001, []),
    ],
)
def test_features_of_a_velocity_that_came_too_late_have_no_latency(
    source: VelocitySource, sent_s: float, latencies_ms: list[float]
) -> None:
    """The board did not wait: its report was on the way when the velocity was sent."""
    recorder: Any = _Recorder()
    output = ScanOutput(recorder, EventBus(lambda: 10.0), LatencyLog(), lambda: 10.0)
    estimate = BatchVelocity(100.0, 100_000, EstimateSource.MEASURED, 0, 0, 10)
    data = ScanData(sent={0: SentVelocity(0, estimate, sent_s)})
    scan: Any = SimpleNamespace(number=1, data=data)
    output.add_window(WindowReport(1, 0, 100, (0,) * 9), 10.0)
    output.add_batch(scan, BatchReport(1, 0, 100_000, source, 100, 0, 0), 10.0)
    assert recorder.latencies_ms == pytest.approx(latencies_ms)
