"""Rows of a session from what arrives: positions, batches, windows, answers, attempts."""

from __future__ import annotations

from math import nan

from rigctl.devices.trackers.plate_frame import PlatePosition
from rigctl.finger_values import BatchRow, FingerTrialRow, TrackRow, WindowRow
from rigctl.protocol.finger import FingerTrial
from rigctl.realtime.scan.scan_in_progress import ScanInProgress
from rigctl.realtime.scan.scan_quality import ScanMeasures
from rigctl.values import Position, Verdict
from rigctl.wire.finger.messages import BatchReport, WindowReport


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
