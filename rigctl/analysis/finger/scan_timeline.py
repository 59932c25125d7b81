"""The relief of a simulated plate as the world of its session describes it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.features import WINDOW_MS
from rigctl.encoding.scaled_time import BATCH_SAMPLES, ScaledWindows
from rigctl.errors import SessionError, WrongUse
from rigctl.finger_values import FingerTrialRow, PredictionRow
from rigctl.protocol.finger import PLATE_MM
from rigctl.session.format.finger_rows import spike_counts
from rigctl.session.format.metadata.header import SessionHeader
from rigctl.session.format.metadata.sensor_layout import SensorLayout
from rigctl.session.read.finger_session import FingerSession
from rigctl.simulation.bench.textures import CATALOGUE, find_texture, printed_heights
from rigctl.simulation.bench.world.world_file import world_from_header
from rigctl.values import SAMPLE_RATE_HZ, Verdict

CELL_MM = 0.25
NM_PER_MM = 1_000_000
Floats = NDArray[np.float64]


class PlateRelief(NamedTuple):
    """Printed heights along a plate, float64 (cells,) in mm, a cell of 0.25 mm after the other.

    ``words``: the texture in a few words, such as "waves, 16 mm apart".
    """

    heights_mm: NDArray[np.float64]
    words: str


def plate_relief(header: SessionHeader, texture: str, path: Path) -> PlateRelief | None:
    """Return the relief of a plate, or None where it is not known.

    It is not on a real rig, and not in the world of another version of rigctl.
    """
    if not header.simulated or texture not in CATALOGUE:
        return None
    try:
        world = world_from_header(header.simulation, path)
    except SessionError:
        return None
    if world is None:
        return None
    plate = find_texture(texture, world.parameters)
    along_mm = np.arange(0.0, PLATE_MM, CELL_MM) + CELL_MM / 2
    heights = printed_heights(plate, along_mm, world.parameters)
    if plate.height == 0.0:
        return PlateRelief(np.zeros_like(along_mm), plate.group)
    space_mm = world.parameters.base_space_mm * plate.space
    return PlateRelief(heights, f"{plate.group}, {space_mm:g} mm apart")


@dataclass(frozen=True, slots=True, eq=False)
class ScanTimeline:
    """A scan. Every time is in seconds since its first sample.

    Readings and positions have the time at which they were taken; batches, spikes, windows and
    answers that at which the computer had them.

    ``reading_s`` float64 (n,), ``readings`` float64 (n, 9): shares of each taxel's range.
    ``track_s``, ``along_mm``, ``across_mm`` float64 (m,): valid positions, on the plate.
    ``batch_start_s``, ``batch_end_s``, ``batch_mm_s``, ``batch_known_s`` float64 (batches,): the
    mean velocities that the board used. ``spike_mm``, ``spike_known_s`` float64 (k,) and
    ``spike_taxel`` int64 (k,): spikes in scaled time, as distance. ``rates_hz`` float64
    (windows, 9) with ``window_known_s``. ``answer_s`` float64 (answers,) with ``answers``.
    """

    session: Path
    trial: FingerTrialRow
    simulated: bool
    sensor_layout: SensorLayout
    relief: PlateRelief | None
    window_mm: float
    duration_s: float
    reading_s: Floats
    readings: Floats
    track_s: Floats
    along_mm: Floats
    across_mm: Floats
    batch_start_s: Floats
    batch_end_s: Floats
    batch_mm_s: Floats
    batch_known_s: Floats
    spike_mm: Floats
    spike_known_s: Floats
    spike_taxel: NDArray[np.int64]
    rates_hz: Floats
    window_known_s: Floats
    answer_s: Floats
    answers: tuple[PredictionRow, ...]


def read_timeline(path: Path, trial_id: int | None = None) -> ScanTimeline:
    """Return the scan of a trial; by default of the last committed one.

    Of several attempts the committed one is taken, else the last one with a scan. Raises
    SessionError for another kind of folder, :class:`WrongUse` for a trial without a scan.
    """
    with FingerSession.open(path) as session:
        return _timeline(session, _index_of(session, trial_id))


def _index_of(session: FingerSession, trial_id: int | None) -> int:
    rows = session.trials
    scanned = (rows["first_sample"] >= 0) & (rows["count"] > 0)
    committed = scanned & (rows["verdict"] == Verdict.COMMITTED.value)
    if trial_id is None:
        if not committed.any():
            raise WrongUse(f"{session.path} has no committed scan: name a rejected one by --trial")
        return int(np.flatnonzero(committed)[-1])
    own = rows["trial_id"] == trial_id
    if not own.any():
        raise WrongUse(
            f"{session.path} has no trial {trial_id}: `rigctl info {session.path}` says how many "
            "it has"
        )
    if not (own & scanned).any():
        raise WrongUse(
            f"trial {trial_id} of {session.path} has no scan, the finger did not pass the marks: "
            "name another trial"
        )
    return int(np.flatnonzero(own & (committed if (own & committed).any() else scanned))[-1])


def _timeline(session: FingerSession, index: int) -> ScanTimeline:
    trial, start_s = session.trial_row(index), session.scan_start_s(index)
    batches, windows, answers = (
        session.batches(index),
        session.windows(index),
        session.predictions(index),
    )
    ends = np.cumsum(batches["samples"], dtype=np.float64) / SAMPLE_RATE_HZ
    track = session.track(index)
    track = track[(track["valid"] == 1) & np.isfinite(track["along_mm"])]
    spike_mm, spike_batch, spike_taxel = _scaled_spikes(session, index)
    batch_known_s = batches["reported_s"] - start_s
    return ScanTimeline(
        session=session.path,
        trial=trial,
        simulated=session.header.simulated,
        sensor_layout=session.sensor_layout,
        relief=plate_relief(session.header, trial.texture, session.path),
        window_mm=WINDOW_MS * session.header.reference_um_per_s / NM_PER_MM,
        duration_s=trial.count / SAMPLE_RATE_HZ,
        reading_s=(session.counters(index) - trial.first_counter) / SAMPLE_RATE_HZ,
        readings=session.normalisation(index).apply(session.samples(index)),
        track_s=track["at_s"] - start_s,
        along_mm=track["along_mm"],
        across_mm=track["across_mm"],
        batch_start_s=ends - batches["samples"] / SAMPLE_RATE_HZ,
        batch_end_s=ends,
        batch_mm_s=batches["velocity_um_s"] / 1000.0,
        batch_known_s=batch_known_s,
        spike_mm=spike_mm,
        spike_known_s=batch_known_s[spike_batch],
        spike_taxel=spike_taxel,
        rates_hz=ScaledWindows(spike_counts(windows), windows["real_ms"].astype(np.int64)).rates_hz,
        window_known_s=windows["arrived_s"] - start_s,
        answer_s=np.array([answer.at_s for answer in answers], np.float64) - start_s,
        answers=answers,
    )


def _scaled_spikes(
    session: FingerSession, index: int
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Return distance in mm, batch and taxel (from 0) of each spike whose batch was scaled."""
    velocities = session.velocities_um_s(index)
    sample, taxel = np.nonzero(session.scan_spikes(index)[: len(velocities) * BATCH_SAMPLES])
    per_sample = np.repeat(velocities, BATCH_SAMPLES)
    start_nm = np.cumsum(per_sample) - per_sample
    return start_nm[sample] / NM_PER_MM, sample // BATCH_SAMPLES, taxel
