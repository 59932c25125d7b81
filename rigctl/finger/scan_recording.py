"""Rows of a session from what arrives: positions, batches, windows, answers, attempts."""

from __future__ import annotations

from collections.abc import Callable
from math import nan

from rigctl.engine.event_bus import EventBus
from rigctl.finger.board_messages import BatchReport, VelocitySource, WindowReport
from rigctl.finger.latency import FEATURES, PREDICTION, SCREEN, LatencyLog
from rigctl.finger.live_answers import LiveAnswers
from rigctl.finger.recorder import FingerRecorder
from rigctl.finger.scan_in_progress import ScanInProgress
from rigctl.finger.scan_quality import ScanMeasures
from rigctl.finger.trackers.plate_frame import PlatePosition
from rigctl.finger.values import (
    BatchRow,
    FingerTrial,
    FingerTrialRow,
    LatencyRow,
    PredictionRow,
    TrackRow,
    WindowRow,
)
from rigctl.values import Position, Verdict


def track_row(position: Position, plate: PlatePosition) -> TrackRow:
    """Return the row of a position."""
    return TrackRow(
        position.at_s,
        position.x_mm,
        position.y_mm,
        position.z_mm,
        plate.along_mm,
        plate.across_mm,
        plate.height_mm,
        position.valid,
    )


def batch_row(scan: ScanInProgress, report: BatchReport, arrived_s: float) -> BatchRow:
    """Return the row of a batch that the board has scaled."""
    sent = scan.data.sent.get(report.batch)
    return BatchRow(
        scan=report.scan,
        batch=report.batch,
        velocity_um_s=report.velocity_um_per_s,
        velocity_source=int(report.source),
        estimate_mm_s=sent.estimate.mm_s if sent else nan,
        estimate_source=sent.estimate.source.value if sent else "",
        dropouts=sent.estimate.dropouts if sent else 0,
        outliers=sent.estimate.outliers if sent else 0,
        samples=report.samples,
        lost_samples=report.lost_samples,
        start_nm=report.start_nm,
        sent_s=sent.sent_s if sent else nan,
        reported_s=arrived_s,
    )


def window_row(report: WindowReport, arrived_s: float) -> WindowRow:
    """Return the row of a window."""
    return WindowRow(report.scan, report.window, report.real_ms, report.spikes, arrived_s)


def trial_row(
    trial: FingerTrial,
    attempt: int,
    scan: ScanInProgress | None,
    measures: ScanMeasures,
    verdict: Verdict,
    reasons: tuple[str, ...],
    times_s: tuple[float, float],
    predicted: str = "",
) -> FingerTrialRow:
    """Return the row of an attempt; the recorder fills in part and first sample."""
    data = scan.data if scan is not None else None
    return FingerTrialRow(
        trial_id=trial.trial_id,
        attempt=attempt,
        part=0,
        stage=trial.stage.value,
        texture=trial.texture,
        profile=trial.profile.value,
        repeat=trial.repeat,
        scan=scan.number if scan is not None else 0,
        first_counter=data.first_counter if data is not None else -1,
        first_sample=-1,
        count=data.count if data is not None else 0,
        verdict=verdict,
        reasons=reasons,
        started_s=times_s[0],
        ended_s=times_s[1],
        distance_mm=measures.distance_mm,
        mean_mm_s=measures.mean_mm_s,
        first_half_mm_s=measures.first_half_mm_s,
        second_half_mm_s=measures.second_half_mm_s,
        tracker_lost_s=measures.tracker_lost_s,
        contact_share=measures.contact_share,
        predicted=predicted,
        correct=predicted == trial.texture if predicted else None,
    )


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
        self._recorder.add_row(window_row(report, arrived_s))
        self._closed_windows += 1

    def add_batch(self, scan: ScanInProgress, report: BatchReport, arrived_s: float) -> None:
        """Record a batch and the latency of the windows that it closed.

        Windows that were closed with another velocity than the batch's own have no latency: its
        own came later, or never, and counts as late.
        """
        self._recorder.add_row(batch_row(scan, report, arrived_s))
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
        self._recorder.add_row(row)
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
        self._recorder.add_row(LatencyRow(at_s, scan, kind, ms))
