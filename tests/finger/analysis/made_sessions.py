"""Sessions of made-up scans, written by the recorder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rigctl.finger.analysis.scans import ScanRecording
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.recorder import FingerRecorder
from rigctl.finger.values import BatchRow, FingerTrialRow, LatencyRow
from rigctl.session.header import SessionHeader
from rigctl.values import BoardIdentity, Verdict

PROTOCOL = 'name = "made up"\n'
HEADER = SessionHeader(
    plan_hash="0" * 64,
    seed=0,
    trials_planned=100,
    rig="virtual",
    simulated=True,
    start_utc="2030-01-01T00:00:00Z",
    protocol="made up",
    boards=(BoardIdentity("finger", "1.0", "0badcafe", 1, 0, 0),),
    sensor="finger 1",
    n_taxels=9,
    taxel_low=(0,) * 9,
    taxel_high=(1023,) * 9,
    reference_um_per_s=100_000,
    stages=("train", "calibrate", "run"),
    tracker={"name": "made up"},
    simulation={"seed": 1},
)
IDLE_MS = 20


def write_session(
    folder: Path,
    recordings: Sequence[ScanRecording],
    header: SessionHeader = HEADER,
    *,
    lost: Sequence[int] = (),
    rejected: Sequence[int] = (),
) -> Path:
    """Record scans; ``lost``: ids of trials that lose a sample, ``rejected``: of rejected ones."""
    counter = IDLE_MS
    with FingerRecorder(folder, header, PROTOCOL, "") as recorder:
        recorder.begin_part("start")
        for scan, one in enumerate(recordings, start=1):
            at_s = counter / 1000.0
            recorder.add_samples(_block(one, counter, one.trial_id in lost), at_s)
            for row in _batches(one, scan, at_s):
                recorder.add_row(row)
            recorder.add_row(LatencyRow(at_s, scan, "features", 1.0 + 0.01 * scan))
            verdict = Verdict.REJECTED if one.trial_id in rejected else Verdict.COMMITTED
            recorder.commit_trial(_row(one, scan, counter, verdict))
            counter += len(one.readings) + IDLE_MS
    assert recorder.status.failure is None
    return folder


def with_ranges(low: int, high: int) -> SessionHeader:
    """Return the header of a session with other taxel ranges."""
    return replace(HEADER, taxel_low=(low,) * 9, taxel_high=(high,) * 9)


def _block(one: ScanRecording, counter: int, lost: bool) -> FingerBlock:
    n = len(one.readings)
    kept = np.delete(np.arange(n), [n // 2] if lost else [])
    counters = counter + kept.astype(np.int64)
    return FingerBlock(
        counters, np.zeros(len(kept), np.uint8), one.readings[kept], one.spikes[kept], 0
    )


def _batches(one: ScanRecording, scan: int, at_s: float) -> list[BatchRow]:
    n, start_nm, rows = len(one.readings), 0, []
    for batch, velocity in enumerate(one.velocities_um_per_s.tolist()):
        samples = min(100, n - 100 * batch)
        estimate = velocity / 1000
        rows.append(
            BatchRow(
                scan,
                batch,
                velocity,
                0,
                estimate,
                "measured",
                0,
                0,
                samples,
                0,
                start_nm,
                at_s,
                at_s,
            )
        )
        start_nm += samples * velocity
    return rows


def _row(one: ScanRecording, scan: int, counter: int, verdict: Verdict) -> FingerTrialRow:
    n = len(one.readings)
    return FingerTrialRow(
        trial_id=one.trial_id,
        attempt=1,
        part=-1,
        stage=one.stage,
        texture=one.texture,
        profile=one.profile,
        repeat=1,
        scan=scan,
        first_counter=counter,
        first_sample=-1,
        count=n,
        verdict=verdict,
        reasons=() if verdict is Verdict.COMMITTED else ("too fast",),
        started_s=counter / 1000.0,
        ended_s=(counter + n) / 1000.0,
        distance_mm=200.0,
        mean_mm_s=100.0,
        first_half_mm_s=100.0,
        second_half_mm_s=100.0,
        tracker_lost_s=0.0,
        contact_share=1.0,
    )
