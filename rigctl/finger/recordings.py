"""Import of finger recordings from elsewhere as a session: a list of scans, a table for each.

The list says file, texture, stage and profile of each scan; a scan's table has the time, nine
taxels, and the way along the plate or the velocity. Spikes are computed here, by the encoder that
the board's equal.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl import __version__
from rigctl.config.resources import source_commit
from rigctl.encoder.encoder import Encoder
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT
from rigctl.errors import DiskFault, WrongUse
from rigctl.exchange.resampling import TimeSeries, resample
from rigctl.finger.board_messages import SampleFlag
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.recorder import FingerRecorder
from rigctl.finger.scaled_time import BATCH_SAMPLES, REFERENCE_UM_PER_S, scale_windows
from rigctl.finger.values import (
    N_FINGER_TAXELS,
    BatchRow,
    FingerTrialRow,
    Stage,
    VelocityProfile,
    WindowRow,
)
from rigctl.session.header import IMPORTED, SessionHeader
from rigctl.values import SAMPLE_RATE_HZ, Event, Verdict

LIST_COLUMNS = ("file", "texture", "stage")
TAXELS = tuple(f"taxel_{number}" for number in range(1, N_FINGER_TAXELS + 1))
TIME, ALONG, VELOCITY = "time_s", "along_mm", "velocity_mm_s"
HIGHEST = 65_535
Floats = NDArray[np.float64]


class ListedScan(NamedTuple):
    """A line of the list."""

    file: Path
    texture: str
    stage: Stage
    profile: str


@dataclass(frozen=True, slots=True)
class ImportedScan:
    """One scan at 1 kHz: readings uint16 (n, 9), and the mean velocity of each 100 ms in mm/s."""

    listed: ListedScan
    readings: NDArray[np.uint16]
    velocity_mm_s: Floats
    digest: str


def read_list(path: Path) -> list[ListedScan]:
    """Return the scans of a list, a CSV with file, texture, stage and, if known, profile.

    Raises WrongUse, with the line, for what is missing or unknown.
    """
    table = _table(path, LIST_COLUMNS)
    scans = []
    for line, row in zip(count(2), table.to_dict("records")):
        stage, profile = str(row["stage"]).strip(), str(row.get("profile", "") or "").strip()
        if stage not in list(Stage):
            raise WrongUse(f"{path}, line {line}: stage {stage!r} is none of {', '.join(Stage)}")
        if profile and profile not in list(VelocityProfile):
            known = ", ".join(VelocityProfile)
            raise WrongUse(f"{path}, line {line}: profile {profile!r} is none of {known}")
        file = path.parent / str(row["file"]).strip()
        scans.append(ListedScan(file, str(row["texture"]).strip(), Stage(stage), profile))
    if not scans:
        raise WrongUse(f"{path} lists no scan")
    return scans


def read_scan(listed: ListedScan) -> ImportedScan:
    """Return a scan from its table. Raises WrongUse for what cannot be imported."""
    path = listed.file
    table = _table(path, (TIME, *TAXELS))
    motion = next((name for name in (ALONG, VELOCITY) if name in table.columns), None)
    if motion is None:
        raise WrongUse(f"{path} has neither a column {ALONG} nor {VELOCITY}: add one")
    try:
        values = table[[TIME, *TAXELS, motion]].to_numpy(np.float64)
    except ValueError as error:
        raise WrongUse(f"{path} has a cell that is no number: {error}") from None
    time_s, taxels = values[:, 0], values[:, 1:-1]
    if not np.isfinite(values).all() or len(values) < 2 or (np.diff(time_s) <= 0).any():
        raise WrongUse(f"{path} needs two rows or more, numbers only, and times that rise")
    if taxels.min() < 0 or taxels.max() > HIGHEST or (taxels != np.rint(taxels)).any():
        raise WrongUse(
            f"{path} has readings that are no whole numbers from 0 to {HIGHEST}: scale them, in "
            "the same way for all sessions"
        )
    found, gaps = resample(TimeSeries(time_s - time_s[0], values[:, 1:]), 0.0)
    if gaps:
        raise WrongUse(f"{path} has a gap at {gaps[0][0]:.3f} s: leave the scan out")
    if len(found.values) < BATCH_SAMPLES:
        raise WrongUse(f"{path} has less than 100 ms")
    readings = np.rint(found.values[:, :-1]).astype(np.uint16)
    # A finger that goes back stays in its window, as on the board.
    velocity = np.maximum(_velocities(found.values[:, -1], is_place=motion == ALONG), 0.0)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return ImportedScan(listed, readings, velocity, digest)


def import_scans(path: Path, folder: Path, sensor: str, start_utc: str) -> list[str]:
    """Write the scans of a list into the new session ``folder``; return what was done.

    Raises WrongUse before anything is written, DiskFault where it cannot be.
    """
    if folder.exists():
        raise WrongUse(f"{folder} already exists: name another folder, or remove it")
    scans = [read_scan(listed) for listed in read_list(path)]
    ranges = _ranges(scans)
    header = _header(path, scans, ranges, sensor, start_utc)
    counter = 0
    repeats: dict[tuple[str, ...], int] = {}
    with FingerRecorder(folder, header, "", "") as recorder:
        recorder.begin_part("import")
        for number, scan in enumerate(scans, start=1):
            key = (scan.listed.stage, scan.listed.texture, scan.listed.profile)
            repeats[key] = repeats.get(key, 0) + 1
            _write(recorder, scan, number, repeats[key], counter, ranges)
            counter += len(scan.readings)
        recorder.wait_written()
        if recorder.status.failure is not None:
            raise DiskFault(recorder.status.failure)
    stages = {stage: sum(one.listed.stage is stage for one in scans) for stage in Stage}
    listed = ", ".join(f"{n} {stage}" for stage, n in stages.items() if n)
    return [f"{len(scans)} scans: {listed}", f"taxel ranges: {ranges.source}"]


def _table(path: Path, columns: Sequence[str]) -> Any:
    """Return a CSV as a data frame with these columns. Raises WrongUse."""
    import pandas as pd

    try:
        table = pd.read_csv(path, skipinitialspace=True, comment="#", keep_default_na=False)
    except (OSError, ValueError) as error:
        raise WrongUse(f"{path} cannot be read as CSV: {error}") from error
    table.columns = [str(name).strip() for name in table.columns]
    if missing := [name for name in columns if name not in table.columns]:
        raise WrongUse(f"{path} has no column {missing[0]}: it needs {', '.join(columns)}")
    return table


def _velocities(motion: Floats, *, is_place: bool) -> Floats:
    """Return the mean velocity of each batch in mm/s from places (mm) or velocities, (n,)."""
    starts = np.arange(0, len(motion), BATCH_SAMPLES)
    if not is_place:
        return np.array([motion[at : at + BATCH_SAMPLES].mean() for at in starts])
    ends = np.minimum(starts + BATCH_SAMPLES, len(motion) - 1)
    way, samples = motion[ends] - motion[starts], np.maximum(ends - starts, 1)
    return np.asarray(way / samples * SAMPLE_RATE_HZ)


def _ranges(scans: Sequence[ImportedScan]) -> Normalisation:
    """Return the taxel ranges of the scans of normalisation, or of all where there are none."""
    chosen = [one.readings for one in scans if one.listed.stage is Stage.NORMALISE]
    source = f"{len(chosen)} scans of the stage {Stage.NORMALISE}"
    if not chosen:
        chosen, source = [one.readings for one in scans], "all imported scans"
    return Normalisation.from_samples(chosen, source)


def _header(
    path: Path, scans: Sequence[ImportedScan], ranges: Normalisation, sensor: str, start_utc: str
) -> SessionHeader:
    plan = "\n".join(repr(one.listed._replace(file=Path(one.listed.file.name))) for one in scans)
    present = {one.listed.stage for one in scans}
    return SessionHeader(
        plan_hash=hashlib.sha256(plan.encode()).hexdigest()[:32],
        seed=0,
        trials_planned=len(scans),
        rig=IMPORTED,
        simulated=False,
        start_utc=start_utc,
        protocol=path.stem,
        sensor=sensor,
        software_version=__version__,
        software_commit=source_commit(),
        n_taxels=N_FINGER_TAXELS,
        highest_reading=HIGHEST,
        taxel_low=tuple(ranges.low.tolist()),
        taxel_high=tuple(ranges.high.tolist()),
        reference_um_per_s=REFERENCE_UM_PER_S,
        stages=tuple(stage.value for stage in Stage if stage in present),
        tracker={"name": IMPORTED},
    )


def _write(
    recorder: FingerRecorder,
    scan: ImportedScan,
    number: int,
    repeat: int,
    counter: int,
    ranges: Normalisation,
) -> None:
    """Write samples, spikes, batches and the row of one scan."""
    n, at_s = len(scan.readings), counter / SAMPLE_RATE_HZ
    spikes = Encoder(ranges, DEFAULT).encode(scan.readings)[:, :N_FINGER_TAXELS]
    counters = counter + np.arange(n, dtype=np.int64)
    flags = np.full(n, SampleFlag.IN_SCAN, np.uint8)
    flags[0] |= SampleFlag.FIRST
    block = FingerBlock(counters, flags, scan.readings, spikes, 0)
    recorder.add_samples(block, at_s)
    um_s = np.rint(1000 * scan.velocity_mm_s).astype(np.int64)
    start_nm = 0
    for batch, mm_s in enumerate(scan.velocity_mm_s.tolist()):
        samples = min(BATCH_SAMPLES, n - BATCH_SAMPLES * batch)
        shape = (0, 0, samples, 0, start_nm, at_s, at_s)
        velocity = int(um_s[batch])
        recorder.add_row(BatchRow(number, batch, velocity, 0, mm_s, "measured", *shape))
        start_nm += samples * velocity
    windows = scale_windows(spikes, um_s, REFERENCE_UM_PER_S)
    for window, (counts, real_ms) in enumerate(zip(*windows, strict=True)):
        row = WindowRow(number, window, int(real_ms), tuple(counts.tolist()), at_s)
        recorder.add_row(row)
    recorder.add_event(
        Event(at_s, "trial", f"scan {number} is {scan.listed.file.name}", {"sha256": scan.digest})
    )
    recorder.commit_trial(_row(scan, number, repeat, counter, start_nm / 1e6))


def _row(
    scan: ImportedScan, number: int, repeat: int, counter: int, distance_mm: float
) -> FingerTrialRow:
    n, half = len(scan.readings), max(1, len(scan.velocity_mm_s) // 2)
    return FingerTrialRow(
        trial_id=number,
        attempt=1,
        part=-1,
        stage=scan.listed.stage,
        texture=scan.listed.texture,
        profile=scan.listed.profile,
        repeat=repeat,
        scan=number,
        first_counter=counter,
        first_sample=-1,
        count=n,
        verdict=Verdict.COMMITTED,
        reasons=(),
        started_s=counter / SAMPLE_RATE_HZ,
        ended_s=(counter + n) / SAMPLE_RATE_HZ,
        distance_mm=distance_mm,
        mean_mm_s=float(scan.velocity_mm_s.mean()),
        first_half_mm_s=float(scan.velocity_mm_s[:half].mean()),
        second_half_mm_s=float(scan.velocity_mm_s[-half:].mean()),
        tracker_lost_s=0.0,
        contact_share=1.0,
    )
