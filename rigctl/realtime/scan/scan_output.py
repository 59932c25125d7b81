"""What a scan produces, once: to the session, to the classifier, and to the clients."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.acquisition.event_bus import EventBus
from rigctl.finger_values import LatencyRow, PredictionRow
from rigctl.realtime.latency import FEATURES, PREDICTION, SCREEN, LatencyLog
from rigctl.realtime.scan.live_answers import LiveAnswers
from rigctl.realtime.scan.scan_in_progress import ScanInProgress
from rigctl.realtime.scan.scan_recording import batch_row, window_row
from rigctl.session.finger_recorder import FingerRecorder
from rigctl.wire.finger.messages import BatchReport, VelocitySource, WindowReport


class ScanOutput:
    """Consumer of a run's scans. ``answers`` is None in stages that classify nothing.

    ``prediction``: the last answer. Latencies count from the time at which a velocity was sent.
    """

    def __init__(
        self,
        recorder: FingerRecorder,
        event_bus: EventBus,
        latencies: LatencyLog,
        now_s: Callable[[], float],
    ) -> None:
        self.answers: LiveAnswers | None = None
        self.prediction: PredictionRow | None = None
        self._recorder = recorder
        self._event_bus = event_bus
        self._latencies = latencies
        self._now_s = now_s
        self._closed_windows = 0

    def begin_scan(self) -> None:
        """Forget what is left of the scan before."""
        self.prediction, self._closed_windows = None, 0

    def add_window(self, report: WindowReport, arrived_s: float) -> None:
        """Record a window; the report of its batch follows it."""
        self._recorder.add_window(window_row(report, arrived_s))
        self._closed_windows += 1

    def add_batch(self, scan: ScanInProgress, report: BatchReport, arrived_s: float) -> None:
        """Record a batch and the latency of the windows that it closed.

        Windows that were closed with another velocity than the batch's own have no latency: its
        own came later, or never, and counts as late.
        """
        self._recorder.add_batch(batch_row(scan, report, arrived_s))
        sent = scan.data.sent.get(report.batch)
        is_own = report.source is VelocitySource.RECEIVED
        if self._closed_windows and sent is not None and is_own:
            self._add_latency(scan.number, FEATURES, arrived_s, sent.sent_s)

    def add_progress(self, scan: ScanInProgress) -> None:
        """Answer after a batch, and at the end of the scan."""
        closed, self._closed_windows = self._closed_windows, 0
        batches = scan.data.batches
        velocity_mm_s = batches[-1][0].velocity_um_per_s / 1000.0 if batches else 0.0
        self._event_bus.publish(
            "batch",
            f"{velocity_mm_s:.0f} mm/s, {scan.distance_mm:.0f} mm",
            scan=scan.number,
            velocity_mm_s=velocity_mm_s,
            distance_mm=scan.distance_mm,
            seconds=scan.duration_s,
            scaled_s=scan.scaled_s,
        )
        if self.answers is not None and (closed or scan.ended):
            self._predict(scan, self.answers)

    def _predict(self, scan: ScanInProgress, answers: LiveAnswers) -> None:
        row = answers.answer(scan, self._now_s())
        if row is None:
            return
        self.prediction = row
        self._recorder.add_prediction(row)
        sent = max((velocity.sent_s for velocity in scan.data.sent.values()), default=None)
        if sent is not None:
            self._add_latency(scan.number, PREDICTION, row.at_s, sent)
        self._event_bus.publish("prediction", row.texture, **row._asdict(), sent_s=sent)

    def add_screen(self, scan: int, at_s: float, sent_s: float) -> None:
        """Record that a window has painted an answer; its report has arrived at ``at_s``."""
        self._add_latency(scan, SCREEN, at_s, sent_s)

    def _add_latency(self, scan: int, kind: str, at_s: float, since_s: float) -> None:
        ms = 1000.0 * (at_s - since_s)
        self._latencies.add(kind, ms)
        self._recorder.add_latency(LatencyRow(at_s, scan, kind, ms))
