"""The scans of a session as arrays: labels, velocity profiles, and windows of both kinds."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.encoder import Encoder
from rigctl.encoding.features import WINDOW_MS
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.encoding.scaled_time import (
    N_WINDOWS,
    REFERENCE_UM_PER_S,
    ScaledWindows,
    feature_vector,
    first_windows,
    scale_windows,
    time_windows,
)
from rigctl.errors import WrongUse
from rigctl.protocol.finger import Stage
from rigctl.values import SAMPLE_RATE_HZ

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Rows = NDArray[np.intp]
N_FINGER_TAXELS = 9
LEAST_COMMON = 0.5
"""Share of the textures that all stages must have; the others are left out."""


class ScanKind(StrEnum):
    """The representations of a scan, by their names in the paper."""

    ORIGINAL = "Original"
    SPEED_SCALED = "Speed Scaled"


KINDS = (ScanKind.ORIGINAL, ScanKind.SPEED_SCALED)


class ScanRecording(NamedTuple):
    """One trial: readings uint16 (n, 9), spikes uint8 (n, 9), and each batch's velocity in µm/s.

    ``spikes`` are the board's; ``stage`` and ``profile`` by their names.
    """

    readings: NDArray[np.uint16]
    spikes: NDArray[np.uint8]
    velocities_um_per_s: Integers
    texture: str
    profile: str
    stage: str
    trial_id: int


@dataclass(frozen=True, slots=True)
class ScanSet:
    """Scans of one session; every array has one element or row for each scan.

    ``texture``, ``profile``, ``stage``: text. ``windows``: rates in the first 20 windows of scaled
    time, float64 (n, 20, 9), Hz; ``real_ms``: the real time of each, int64 (n, 20), 0 where the
    scan was shorter. ``time_rates``: rates in all whole 100 ms, float64 (n, w, 9), 0 behind the
    ``n_time_windows`` of a scan. ``reading``: mean normalised reading of each taxel, (n, 9).
    """

    session: str
    simulated: bool
    texture: NDArray[np.str_]
    profile: NDArray[np.str_]
    stage: NDArray[np.str_]
    trial_id: Integers
    windows: Floats
    real_ms: Integers
    time_rates: Floats
    n_time_windows: Integers
    reading: Floats
    reference_um_per_s: int = REFERENCE_UM_PER_S

    def __len__(self) -> int:
        return len(self.trial_id)

    @property
    def textures(self) -> tuple[str, ...]:
        """Names of the textures, sorted."""
        return tuple(sorted(set(self.texture.tolist())))

    @property
    def n_windows(self) -> int:
        """Windows of a feature vector: the paper's 20."""
        return int(self.windows.shape[1])

    @property
    def window_mm(self) -> float:
        """Way of a window of scaled time: the paper's 10 mm."""
        return WINDOW_MS * self.reference_um_per_s / 1e6

    def labels(self, textures: Sequence[str]) -> Integers:
        """Return the index of each scan's texture in ``textures``, int64 (n,); −1 for another."""
        index = {name: i for i, name in enumerate(textures)}
        return np.array([index.get(name, -1) for name in self.texture.tolist()], np.int64)

    def features(self, kind: ScanKind) -> Floats:
        """Return the feature vectors of the whole scans, float64 (n, 180), Hz."""
        if kind is ScanKind.SPEED_SCALED:
            return feature_vector(self.windows)
        return feature_vector(self._time_windows_until(self.n_time_windows))

    def evidence(self, kind: ScanKind, n_windows: Integers | int) -> Floats:
        """Return the windows after ``n_windows`` of each scan, float64 (n, 20, 9), 0 to come.

        Original shows the last 20 so far, Speed Scaled the first 20.
        """
        seen = np.broadcast_to(np.asarray(n_windows, np.int64), (len(self),))
        if kind is ScanKind.SPEED_SCALED:
            return np.where(
                (np.arange(self.n_windows) < seen[:, None])[..., None], self.windows, 0.0
            )
        return self._time_windows_until(np.minimum(seen, self.n_time_windows))

    def select(self, rows: Rows | NDArray[np.bool_]) -> ScanSet:
        """Return some of the scans, by index or by mask."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        chosen: dict[str, Any] = {
            name: value[rows] if isinstance(value, np.ndarray) else value
            for name, value in values.items()
        }
        return ScanSet(**chosen)

    def of_stage(self, stage: Stage) -> ScanSet:
        """Return the scans of a stage. Raises :class:`WrongUse` where there is none."""
        rows = self.stage == stage
        if not rows.any():
            raise WrongUse(
                f"{self.session} has no complete trials of the stage {stage.value}: record that "
                "stage, or name the session that has it"
            )
        return self.select(rows)

    def of_textures(self, textures: Collection[str]) -> ScanSet:
        """Return the scans of some textures."""
        return self.select(np.isin(self.texture, list(textures)))

    def of_profiles(self, profiles: Collection[str]) -> ScanSet:
        """Return the scans of some velocity profiles."""
        return self.select(np.isin(self.profile, list(profiles)))

    def _time_windows_until(self, ends: Integers) -> Floats:
        """Return the last 20 windows of 100 ms before window ``ends``, float64 (n, 20, 9)."""
        n = self.n_windows
        columns = np.maximum(ends - n, 0)[:, None] + np.arange(n)
        inside = columns < ends[:, None]
        if not self.time_rates.shape[1]:
            return np.zeros((len(self), n, self.windows.shape[2]))
        reachable = np.where(inside, columns, 0)
        rates = self.time_rates[np.arange(len(self))[:, None], reachable]
        return np.where(inside[..., None], rates, 0.0)


def scan_set(
    session: str,
    recordings: Sequence[ScanRecording],
    normalisation: Normalisation,
    *,
    simulated: bool,
    reference_um_per_s: int = REFERENCE_UM_PER_S,
    n_windows: int = N_WINDOWS,
) -> ScanSet:
    """Return the scans of recorded trials. ``normalisation``: of the readings.

    Raises :class:`WrongUse` for no trial, or arrays that do not fit together.
    """
    if not recordings:
        raise WrongUse(f"{session} has no complete trials")
    for one in recordings:
        _check(session, one)
    scaled = [
        scale_windows(one.spikes, one.velocities_um_per_s, reference_um_per_s) for one in recordings
    ]
    timed = [time_windows(one.spikes) for one in recordings]
    longest = max(len(windows.counts) for windows in timed)
    return ScanSet(
        session,
        simulated,
        np.array([one.texture for one in recordings]),
        np.array([str(one.profile) for one in recordings]),
        np.array([str(one.stage) for one in recordings]),
        np.array([one.trial_id for one in recordings], np.int64),
        np.stack([first_windows(windows, n_windows) for windows in scaled]),
        np.stack([_first_durations(windows, n_windows) for windows in scaled]),
        np.stack([first_windows(windows, longest) for windows in timed]),
        np.array([len(windows.counts) for windows in timed], np.int64),
        np.stack([mean_reading(one.readings, normalisation) for one in recordings]),
        reference_um_per_s,
    )


def encode_readings(
    readings: NDArray[np.uint16],
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
) -> NDArray[np.uint8]:
    """Return the SA spikes of a scan as the finger's board makes them: uint16 (n, 9) → uint8."""
    return Encoder(normalisation, parameters).encode(readings)[:, : normalisation.n_taxels]


def mean_reading(readings: NDArray[np.uint16], normalisation: Normalisation) -> Floats:
    """Return the mean normalised reading of each taxel, float64 (n_taxels,), 0 to 1."""
    mean: Floats = normalisation.apply(readings).mean(axis=0)
    return mean


def _first_durations(windows: ScaledWindows, n_windows: int) -> Integers:
    first = windows.real_ms[:n_windows]
    return np.pad(first, (0, n_windows - len(first)))


def _check(session: str, one: ScanRecording) -> None:
    shape = (len(one.readings), N_FINGER_TAXELS)
    if one.readings.shape != shape or one.spikes.shape != shape:
        raise WrongUse(
            f"{session}, trial {one.trial_id}: readings {one.readings.shape} and spikes "
            f"{one.spikes.shape} should both be samples × {N_FINGER_TAXELS} taxels"
        )
    if len(one.readings) < SAMPLE_RATE_HZ // 10:
        raise WrongUse(f"{session}, trial {one.trial_id}: a scan needs 100 ms or more")


@dataclass(frozen=True, slots=True)
class FingerDataSet:
    """The scans of one data set: a training session, and calibration and run of a later one.

    ``remarks``: textures that were left out, because a stage lacks them.
    """

    name: str
    training: ScanSet
    calibration: ScanSet
    tested: ScanSet
    remarks: tuple[str, ...] = ()

    @classmethod
    def from_sessions(cls, name: str, first: ScanSet, new: ScanSet) -> FingerDataSet:
        """Return the data set of two sessions, by their stages train, calibrate and run.

        Textures that a stage lacks are left out. Raises :class:`WrongUse` for a missing stage, or
        where most textures are not in all stages.
        """
        parts = (
            first.of_stage(Stage.TRAIN),
            new.of_stage(Stage.CALIBRATE),
            new.of_stage(Stage.RUN),
        )
        common = common_textures([part.textures for part in parts])
        if common is None:
            other = next(part for part in parts[1:] if part.textures != parts[0].textures)
            raise WrongUse(
                f"{new.session} has the textures {', '.join(other.textures)}, {first.session} "
                f"{', '.join(parts[0].textures)}: pair sessions of one protocol"
            )
        return cls(name, *parts).of_textures(common)

    @property
    def textures(self) -> tuple[str, ...]:
        """Names of the textures, sorted."""
        return self.training.textures

    def of_textures(self, textures: Sequence[str]) -> FingerDataSet:
        """Return the scans of some textures, with a remark on the others."""
        parts = (self.training, self.calibration, self.tested)
        left_out = sorted({name for part in parts for name in part.textures} - set(textures))
        if not left_out:
            return self
        remark = f"{self.name}: textures left out, which a stage lacks: {', '.join(left_out)}"
        training, calibration, tested = (part.of_textures(textures) for part in parts)
        return FingerDataSet(self.name, training, calibration, tested, (*self.remarks, remark))


def common_textures(each: Sequence[Sequence[str]]) -> tuple[str, ...] | None:
    """Return the textures that all stages or sets have, None where those are too few."""
    common = set(each[0]).intersection(*each[1:])
    every = set(each[0]).union(*each[1:])
    if len(common) < max(2.0, LEAST_COMMON * len(every)) and common != every:
        return None
    return tuple(sorted(common))
