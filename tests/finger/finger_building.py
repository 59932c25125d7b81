"""Synthetic recordings of the moving finger; spikes and windows come from the board's firmware."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.taxel_frames import frame
from rigctl.finger import board_messages
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.board_messages import (
    BATCH_SAMPLES,
    DEFAULT_REFERENCE_UM_PER_S,
    N_TAXELS,
    BatchReport,
    Message,
    WindowReport,
)
from rigctl.finger.decoder import FingerBlock, FingerDecoder
from rigctl.finger.plan import FingerPlan, parse_finger_protocol
from rigctl.finger.recorder import FingerRecorder
from rigctl.finger.values import (
    BatchRow,
    FingerTrial,
    FingerTrialRow,
    LatencyRow,
    PredictionRow,
    Stage,
    TrackRow,
    WindowRow,
)
from rigctl.session.header import SessionHeader
from rigctl.values import BoardIdentity, Verdict

PROTOCOL = """\
name = "small"
textures = ["A", "B"]
profiles = ["fast", "slow-to-fast"]
[stages]
normalise = 0
train = 1
calibrate = 0
run = 1
"""
RIG = "[about]\noperator = 'Jörg'\n"
LOW, HIGH = tuple(range(40, 40 + N_TAXELS)), tuple(range(700, 700 + N_TAXELS))
VELOCITIES_UM_S = (180_000, 205_500, 0, 93_001, 250_000)
"""Of the batches of a scan; the last one is short."""
TOP_LAYER = (0, 1, 2, 6, 7, 8, 12, 13, 14)
"""The readings of the taxel board that are the finger's taxels (arduino/finger/board.h)."""
SCAN_MS = 437
IDLE_MS = 30


def plan() -> FingerPlan:
    return parse_finger_protocol(PROTOCOL, "small.toml").plan([Stage.TRAIN, Stage.RUN])


def header() -> SessionHeader:
    return SessionHeader(
        plan_hash=plan().hash,
        seed=0,
        trials_planned=len(plan().trials),
        rig="virtual",
        simulated=True,
        start_utc="2026-11-23T12:00:00Z",
        protocol="small",
        boards=(BoardIdentity("finger", "1.0", "0badcafe", 1, 0, 0),),
        operator="Jörg",
        n_taxels=N_TAXELS,
        taxel_low=LOW,
        taxel_high=HIGH,
        reference_um_per_s=DEFAULT_REFERENCE_UM_PER_S,
        stages=(Stage.TRAIN.value, Stage.RUN.value),
        tracker={"name": "synthetic"},
        simulation={"seed": 1},
    )


def recorder(folder: Path, *, resume: bool = False) -> FingerRecorder:
    return FingerRecorder(folder, header(), PROTOCOL, RIG, resume=resume)


class SyntheticFinger:
    """Source of a recorder's data: the board's firmware and a finger without faults.

    ``lose`` and ``miss`` are places in a scan (ms) of samples that do not reach the host, and that
    do not reach the board.
    """

    def __init__(self, rec: FingerRecorder) -> None:
        self.rec = rec
        self.board = FingerFirmware()
        self.board.boot(0)
        self.board.receive(board_messages.set_ranges(LOW, HIGH))
        self._decoder = FingerDecoder()
        self._rng = np.random.default_rng(1)
        self.scans = 0
        self.now_s = 0.0
        self._lose = self._miss = range(0)

    def __enter__(self) -> SyntheticFinger:
        return self

    def __exit__(self, *_: object) -> None:
        self.board.close()

    def trial(
        self,
        trial: FingerTrial,
        verdict: Verdict = Verdict.COMMITTED,
        attempt: int = 1,
        lose: range = range(0),
        miss: range = range(0),
    ) -> FingerTrialRow:
        """Record one scan with everything that belongs to it, and its row."""
        started_s = self.now_s
        self._samples(IDLE_MS)
        self.scans += 1
        self.board.receive(board_messages.start(self.scans))
        first = round(self.now_s * 1000)
        self._lose = range(first + lose.start, first + lose.stop)
        self._miss = range(first + miss.start, first + miss.stop)
        for batch, velocity in enumerate(VELOCITIES_UM_S):
            self._samples(min(BATCH_SAMPLES, SCAN_MS - batch * BATCH_SAMPLES))
            if batch == len(VELOCITIES_UM_S) - 1:
                self.board.receive(board_messages.stop(self.scans))
            self.board.receive(board_messages.velocity(self.scans, batch, velocity))
            self._take()
            self._predict(batch, trial)
        self._samples(IDLE_MS)
        row = finger_trial_row(trial, self.scans, first, verdict, attempt)
        row = replace(row, started_s=started_s, ended_s=self.now_s)
        if miss and not miss.start:  # the first sample that the board gets begins the scan
            row = replace(row, first_counter=first + miss.stop, count=SCAN_MS - miss.stop)
        self.rec.commit_trial(row)
        return row

    def _samples(self, count: int) -> None:
        """Pass samples to the board in blocks of 10, and record what it sends."""
        for start in range(0, count, 10):
            size = min(10, count - start)
            self.board.receive_taxels(self._frames(size))
            self.now_s += size / 1000
            self._take()
            place = 50 + 200 * self.now_s
            self.rec.add_row(TrackRow(self.now_s, place, 0.5, 2.0, place, 0.5, 1.0, True))

    def _frames(self, count: int) -> bytes:
        first = round(self.now_s * 1000)
        numbered = enumerate(self._readings(count), start=first)
        return b"".join(taxel_frame(n, row) for n, row in numbered if n not in self._miss)

    def _readings(self, count: int) -> NDArray[np.uint16]:
        phase = round(self.now_s * 1000) + np.arange(count)[:, None] + 7 * np.arange(N_TAXELS)
        noise = self._rng.normal(0, 6, (count, N_TAXELS))
        return np.clip(380 + 250 * np.sin(phase / 9) + noise, 0, 1023).astype(np.uint16)

    def _take(self) -> None:
        block, received = self._decoder.feed(self.board.take_sent())
        kept = ~np.isin(block.counters, self._lose)
        self.rec.add_samples(select(block, kept), self.now_s)
        self._record(received)

    def _record(self, received: Sequence[Message]) -> None:
        for message in received:
            if isinstance(message, BatchReport):
                self.rec.add_row(batch_row(message, self.now_s))
            elif isinstance(message, WindowReport):
                row = (message.scan, message.window, message.real_ms, message.spikes)
                self.rec.add_row(WindowRow(*row, self.now_s))

    def _predict(self, batch: int, trial: FingerTrial) -> None:
        answer = {trial.texture: 0.75, "other": 0.25}
        final = batch == len(VELOCITIES_UM_S) - 1
        self.rec.add_row(
            PredictionRow(
                self.scans,
                self.now_s,
                batch,
                10.0 * batch,
                0.1 * batch,
                trial.texture,
                answer,
                (trial.texture,),
                known=True,
                decided=batch > 1,
                is_final=final,
            )
        )
        self.rec.add_row(LatencyRow(self.now_s, self.scans, "features", 1.5))


def taxel_frame(counter: int, readings: NDArray[np.uint16]) -> bytes:
    """Return a frame of the taxel board with these readings in its top layer."""
    number = sum(int(value) << 10 * place for place, value in zip(TOP_LAYER, readings, strict=True))
    return frame(struct.pack("<BHB", 0x11, counter & 0xFFFF, 0) + number.to_bytes(23, "little"))


def select(block: FingerBlock, kept: NDArray[np.bool_]) -> FingerBlock:
    """Return the block without samples that do not arrive."""
    arrays = (array[kept] for array in block[:4])
    return FingerBlock(*arrays, missing=0)


def batch_row(report: BatchReport, at_s: float) -> BatchRow:
    return BatchRow(
        scan=report.scan,
        batch=report.batch,
        velocity_um_s=report.velocity_um_per_s,
        velocity_source=report.source,
        estimate_mm_s=report.velocity_um_per_s / 1000,
        estimate_source="measured",
        dropouts=0,
        outliers=1,
        samples=report.samples,
        lost_samples=report.lost_samples,
        start_nm=report.start_nm,
        sent_s=at_s,
        reported_s=at_s,
    )


def finger_trial_row(
    trial: FingerTrial,
    scan: int,
    first_counter: int,
    verdict: Verdict = Verdict.COMMITTED,
    attempt: int = 1,
) -> FingerTrialRow:
    classified = trial.stage is Stage.RUN
    return FingerTrialRow(
        trial_id=trial.trial_id,
        attempt=attempt,
        part=-1,
        stage=trial.stage,
        texture=trial.texture,
        profile=trial.profile,
        repeat=trial.repeat,
        scan=scan,
        first_counter=first_counter,
        first_sample=-1,
        count=SCAN_MS,
        verdict=verdict,
        reasons=() if verdict is Verdict.COMMITTED else ("the finger was lifted", "too fast"),
        started_s=0.0,
        ended_s=0.0,
        distance_mm=60.0,
        mean_mm_s=150.0,
        first_half_mm_s=140.0,
        second_half_mm_s=160.0,
        tracker_lost_s=0.0,
        contact_share=1.0,
        predicted=trial.texture if classified else "",
        correct=True if classified else None,
    )


def record_plan(folder: Path) -> FingerPlan:
    """Record a complete session of the small plan, one part for each stage."""
    of = plan()
    with recorder(folder) as rec, SyntheticFinger(rec) as finger:
        stage = ""
        for trial in of.trials:
            if trial.stage != stage:
                stage = trial.stage
                rec.begin_part("start" if trial.trial_id == 1 else "stage")
            finger.trial(trial)
    assert rec.status.failure is None
    return of
