"""Small synthetic recordings: samples, trials and sessions like those of a rig."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import Plan
from rigctl.session.header import SessionHeader
from rigctl.session.notes import Mark, SessionNote
from rigctl.session.recorder import Recorder
from rigctl.session.session import add_note
from rigctl.values import (
    Block,
    BoardIdentity,
    DrumState,
    Gap,
    LoadcellSample,
    PlannedTrial,
    TrialRow,
    Verdict,
)

PROTOCOL = """\
name = "small"
textures = ["A", "B"]
speeds_mm_s = [40, 120]
forces_g = [250]
repeats = 2
[trial]
travel_mm = 12
"""
RIG = "[about]\noperator = 'Jörg'\n"
BLOCK = 10
IDLE = 50
"""Samples before and after each trial of :func:`record_plan`."""


def plan() -> Plan:
    return parse_protocol(PROTOCOL, "small.toml").plan()


def header(of: Plan | None = None, n_taxels: int = 18) -> SessionHeader:
    of = of or plan()
    return SessionHeader(
        plan_hash=of.hash,
        seed=of.seed,
        trials_planned=len(of.trials),
        rig="virtual",
        simulated=True,
        start_utc="2026-11-21T12:00:00Z",
        protocol="small",
        boards=(BoardIdentity("taxels", "1.0", "0badcafe", 1, 3, 1),),
        operator="Jörg",
        n_taxels=n_taxels,
        taxel_low=tuple(range(n_taxels)),
        simulation={"seed": 1},
    )


def record_by_hand(folder: Path) -> Path:
    """Record some samples without a trial."""
    with recorder(folder) as rec:
        rec.begin_part("operated by hand", "A")
        SyntheticRig(rec).idle()
    return folder


def recorder(folder: Path, **options: int) -> Recorder:
    return Recorder(folder, header(), PROTOCOL, RIG, **options)  # type: ignore[arg-type]


def value_of(counters: np.ndarray, n_taxels: int = 18) -> np.ndarray:
    """Return readings derived from the counters, so that a misplaced row shows."""
    return ((counters[:, None] * 7 + np.arange(n_taxels)) % 1024).astype(np.uint16)


def block(
    first: int, count: int = BLOCK, *, sync: bool = False, rises: int = 0, gap: Gap | None = None
) -> Block:
    counters = np.arange(first, first + count, dtype=np.int64)
    return Block(
        counters=counters,
        samples=value_of(counters),
        flags=np.full(count, int(sync), np.uint8),
        edges=np.full(count, rises % 4, np.uint8),
        gaps=(gap,) if gap else (),
        arrived_s=(first + count) / 1000,
    )


def trial_row(
    trial: PlannedTrial, first_counter: int, verdict: Verdict = Verdict.COMMITTED, attempt: int = 1
) -> TrialRow:
    n = trial.n_samples
    return TrialRow(
        trial=trial,
        attempt=attempt,
        part=-1,
        first_counter=first_counter,
        first_sample=-1,
        count=n,
        verdict=verdict,
        reasons=() if verdict is Verdict.COMMITTED else ("2 samples lost", "force off"),
        started_s=(first_counter - IDLE) / 1000,
        ended_s=(first_counter + n + IDLE) / 1000,
        mean_speed_mm_s=trial.speed_mm_s,
        mean_force_g=trial.force_g,
    )


def drum_state(at_s: float, sequence: int = 0, rise_us: int = 0) -> DrumState:
    """A poll with two load-cell samples."""
    now_us = round(at_s * 1e6)
    return DrumState(
        at_s=at_s,
        board_time_us=now_us,
        state=7,
        fault=0,
        fault_bits=0,
        steps=-5,
        angle_deg=12.5,
        speed_mm_s=40.0,
        force_g=250.5,
        actuator_position_um=21000,
        actuator_drive_permille=-3,
        sync_count=1,
        sync_rise_us=rise_us,
        sync_fall_us=0,
        index_count=2,
        status_bits=1,
        loadcell=tuple(
            LoadcellSample(sequence + i, now_us - 12_500 * (1 - i), 80_000, 250.0) for i in (0, 1)
        ),
        loadcell_lost=0,
        values={},
    )


class SyntheticRig:
    """Source of a recorder's data, like a rig without faults."""

    def __init__(self, rec: Recorder, counter: int = 0) -> None:
        self.rec = rec
        self.counter = counter
        self.rises = 0
        self.sequence = 0

    def idle(self, count: int = IDLE) -> None:
        self._samples(count, sync=False)

    def trial(
        self, trial: PlannedTrial, verdict: Verdict = Verdict.COMMITTED, attempt: int = 1
    ) -> None:
        """Add idle samples, a window that ends before its sync, idle samples, and the row."""
        self.idle()
        rise_us = self.counter * 1000 - 400
        self.rises += 1
        self._samples(1, sync=False)  # the frame with the rising edge counts it
        first = self.counter
        self._samples(trial.n_samples + 5, sync=True)
        self.idle()
        self.sequence += 2
        self.rec.add_drum(drum_state(self.counter / 1000, self.sequence, rise_us), 250, 40)
        self.rec.commit_trial(trial_row(trial, first, verdict, attempt))

    def _samples(self, count: int, *, sync: bool) -> None:
        while count > 0:
            size = min(BLOCK, count)
            self.rec.add_block(block(self.counter, size, sync=sync, rises=self.rises))
            self.counter += size
            count -= size


def record_repeats(folder: Path) -> None:
    """Record the small plan; the first trial was rejected and the second marked bad, both again."""
    with recorder(folder) as rec:
        source, (first, second, *others) = SyntheticRig(rec), plan().trials
        rec.begin_part("start", first.texture)
        source.trial(first, Verdict.REJECTED)
        source.trial(first, attempt=2)
        source.trial(second)
        source.trial(second, attempt=2)
        for trial in others:
            source.trial(trial)
    note = SessionNote("2026-11-21T12:30:00Z", "slipped", second.trial_id, 1, Mark.BAD)
    add_note(folder, note)


def record_plan(folder: Path, of: Plan | None = None) -> Plan:
    """Record a complete session of the small plan, one part per texture; return the plan."""
    of = of or plan()
    with recorder(folder) as rec:
        source = SyntheticRig(rec)
        texture = ""
        for trial in of.trials:
            if trial.texture != texture:
                texture = trial.texture
                rec.begin_part("plate change", texture)
            source.trial(trial)
    assert rec.status.failure is None
    return of
