"""The scans of recorded sessions as arrays, and the data sets that pairs of sessions make."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl import __version__
from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.config.resources import source_commit
from rigctl.encoder.encoder import Encoder, encode_trials
from rigctl.encoder.features import WINDOW_MS
from rigctl.encoder.force_gain import ForceGain, ForceScaling, divided
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, EncoderParameters, preset
from rigctl.encoder.reading import Reading
from rigctl.errors import WrongUse
from rigctl.finger.analysis.settings import FingerAnalysisSettings
from rigctl.finger.scaled_time import (
    BATCH_SAMPLES,
    N_WINDOWS,
    REFERENCE_UM_PER_S,
    Gaps,
    ScaledWindows,
    feature_vector,
    first_windows,
    scale_windows,
    time_windows,
)
from rigctl.finger.session import FingerSession
from rigctl.finger.values import MODEL_KIND, ScanKind, Stage
from rigctl.session.analysis_file import content_digest
from rigctl.session.digests import damaged_trials
from rigctl.session.header import SessionHeader
from rigctl.session.model_file import TrainingInfo
from rigctl.session.sensor_passport import SensorPassport, passport_of
from rigctl.session.session_reader import read_closing_digest
from rigctl.values import SAMPLE_RATE_HZ

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Rows = NDArray[np.intp]
Raster = NDArray[np.uint8]
"""Spikes of each sample and taxel, uint8 (n, 9)."""
N_FINGER_TAXELS = 9
LEAST_COMMON = 0.5
"""Share of the textures that all stages must have; the others are left out."""
NO_PASSPORT = "name a passport of its sensor in finger.toml, and record the session again"
READING_STAGE = "reading sessions"
CLASSIFIED_STAGES = (Stage.TRAIN, Stage.CALIBRATE, Stage.RUN)
_DEFAULT_PRESET = "default"


KINDS = (ScanKind.ORIGINAL, ScanKind.SPEED_SCALED)


class Rates(NamedTuple):
    """Rates in Hz of scans: in windows of scaled time, float64 (n, 20, 9), and in all whole 100 ms,
    float64 (n, w, 9).
    """

    windows: Floats
    time_rates: Floats


class ScanRecording(NamedTuple):
    """One trial: readings uint16 (n, 9), spikes uint8 (n, 9), and each batch's velocity in µm/s.

    ``spikes`` are the board's; ``stage`` and ``profile`` by their names. ``named_by``: the
    representation of the model that named the scan in its run, empty for none.
    """

    readings: NDArray[np.uint16]
    spikes: NDArray[np.uint8]
    velocities_um_per_s: Integers
    texture: str
    profile: str
    stage: str
    trial_id: int
    named_by: str = ""


@dataclass(frozen=True, slots=True)
class ScanSet:
    """Scans of one session; every array has one element or row for each scan.

    ``texture``, ``profile``, ``stage``, ``named_by``: text. ``windows``: rates in the first 20
    windows of scaled time, float64 (n, 20, 9), Hz; ``real_ms``: the real time of each, int64
    (n, 20), 0 where the scan was shorter. ``time_rates``: rates in all whole 100 ms, float64
    (n, w, 9), 0 behind the ``n_time_windows`` of a scan. ``reading``: mean normalised reading of
    each taxel, (n, 9). ``gained``: the rates of the same scans with a gain on the SA current.
    """

    session: str
    simulated: bool
    texture: NDArray[np.str_]
    profile: NDArray[np.str_]
    stage: NDArray[np.str_]
    named_by: NDArray[np.str_]
    trial_id: Integers
    windows: Floats
    real_ms: Integers
    time_rates: Floats
    n_time_windows: Integers
    reading: Floats
    reference_um_per_s: int = REFERENCE_UM_PER_S
    window_ms: int = WINDOW_MS
    gained: Mapping[ForceScaling, Rates] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.trial_id)

    @property
    def kinds(self) -> tuple[ScanKind, ...]:
        """The representations that the scans have."""
        forces = (ForceScaling.NONE, *self.gained)
        return tuple(kind for kind in ScanKind if kind.force_scaling in forces)

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
        return self.window_ms * self.reference_um_per_s / 1e6

    def labels(self, textures: Sequence[str]) -> Integers:
        """Return the index of each scan's texture in ``textures``, int64 (n,); −1 for another."""
        index = {name: i for i, name in enumerate(textures)}
        return np.array([index.get(name, -1) for name in self.texture.tolist()], np.int64)

    def features(self, kind: ScanKind) -> Floats:
        """Return the feature vectors of the whole scans, float64 (n, 180), Hz."""
        rates = self._rates(kind)
        if kind.is_speed_scaled:
            return feature_vector(rates.windows)
        return feature_vector(self._time_windows_until(rates.time_rates, self.n_time_windows))

    def evidence(self, kind: ScanKind, n_windows: Integers | int) -> Floats:
        """Return the windows after ``n_windows`` of each scan, float64 (n, 20, 9), 0 to come.

        Original shows the last 20 so far, Speed Scaled the first 20.
        """
        rates = self._rates(kind)
        seen = np.broadcast_to(np.asarray(n_windows, np.int64), (len(self),))
        if kind.is_speed_scaled:
            return np.where(
                (np.arange(self.n_windows) < seen[:, None])[..., None], rates.windows, 0.0
            )
        ends = np.minimum(seen, self.n_time_windows)
        return self._time_windows_until(rates.time_rates, ends)

    def select(self, rows: Rows | NDArray[np.bool_]) -> ScanSet:
        """Return some of the scans, by index or by mask."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        chosen: dict[str, Any] = {
            name: value[rows] if isinstance(value, np.ndarray) else value
            for name, value in values.items()
        }
        chosen["gained"] = {
            force: Rates(*(part[rows] for part in rates)) for force, rates in self.gained.items()
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

    def _rates(self, kind: ScanKind) -> Rates:
        """Return the rates of a representation. Raises WrongUse where the scans lack it."""
        if kind not in self.kinds:
            raise WrongUse(f"{self.session} has no {kind} scans: {NO_PASSPORT}")
        if kind.force_scaling is ForceScaling.NONE:
            return Rates(self.windows, self.time_rates)
        return self.gained[kind.force_scaling]

    def _time_windows_until(self, time_rates: Floats, ends: Integers) -> Floats:
        """Return the last 20 windows of 100 ms before window ``ends``, float64 (n, 20, 9)."""
        n = self.n_windows
        columns = np.maximum(ends - n, 0)[:, None] + np.arange(n)
        inside = columns < ends[:, None]
        if not time_rates.shape[1]:
            return np.zeros((len(self), n, self.windows.shape[2]))
        reachable = np.where(inside, columns, 0)
        rates = time_rates[np.arange(len(self))[:, None], reachable]
        return np.where(inside[..., None], rates, 0.0)


def scan_set(
    session: str,
    recordings: Sequence[ScanRecording],
    normalisation: Normalisation,
    *,
    simulated: bool,
    reference_um_per_s: int = REFERENCE_UM_PER_S,
    n_windows: int = N_WINDOWS,
    gaps: Gaps = Gaps.SPLIT,
    window_ms: int = WINDOW_MS,
    gained: Mapping[ForceScaling, Sequence[Raster]] = MappingProxyType({}),
) -> ScanSet:
    """Return the scans of recorded trials. ``normalisation``: of the readings.

    ``gained``: spikes of the same trials with a gain on the SA current, uint8 (n, 9) each.
    Raises :class:`WrongUse` for no trial, or arrays that do not fit together.
    """
    if not recordings:
        raise WrongUse(f"{session} has no complete trials")
    for one in recordings:
        _check(session, one)

    def windows_of(trains: Sequence[Raster]) -> tuple[list[ScaledWindows], list[ScaledWindows]]:
        scaled = [
            scale_windows(
                spikes,
                one.velocities_um_per_s,
                reference_um_per_s,
                gaps=gaps,
                window_ms=window_ms,
            )
            for spikes, one in zip(trains, recordings, strict=True)
        ]
        return scaled, [time_windows(spikes, window_ms) for spikes in trains]

    def rates_of(scaled: Sequence[ScaledWindows], timed: Sequence[ScaledWindows]) -> Rates:
        longest = max(len(windows.counts) for windows in timed)
        return Rates(
            np.stack([first_windows(windows, n_windows) for windows in scaled]),
            np.stack([first_windows(windows, longest) for windows in timed]),
        )

    scaled, timed = windows_of([one.spikes for one in recordings])
    plain = rates_of(scaled, timed)
    return ScanSet(
        session,
        simulated,
        np.array([one.texture for one in recordings]),
        np.array([str(one.profile) for one in recordings]),
        np.array([str(one.stage) for one in recordings]),
        np.array([one.named_by for one in recordings]),
        np.array([one.trial_id for one in recordings], np.int64),
        plain.windows,
        np.stack([_first_durations(windows, n_windows) for windows in scaled]),
        plain.time_rates,
        np.array([len(windows.counts) for windows in timed], np.int64),
        np.stack([mean_reading(one.readings, normalisation) for one in recordings]),
        reference_um_per_s,
        window_ms,
        {force: rates_of(*windows_of(trains)) for force, trains in gained.items()},
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


class FingerEncoding(NamedTuple):
    """What turns readings into windows: a model is valid only for scans of its own."""

    normalisation: Normalisation
    parameters: EncoderParameters = DEFAULT
    reference_um_per_s: int = REFERENCE_UM_PER_S
    sensor: str = ""


def scale_to_population(
    recordings: Sequence[ScanRecording],
    normalisation: Normalisation,
    reference: float,
    parameters: EncoderParameters = DEFAULT,
) -> list[ScanRecording]:
    """Return recordings encoded anew with the SA current of each scan times reference over mean.

    The mean is that of a scan's normalised readings over all taxels; ``reference`` is that of the
    training scans. It is the paper's C with the population in the place of the true texture.
    """
    population = np.array([population_reading(one, normalisation) for one in recordings])
    scale = reference / np.maximum(population, np.finfo(np.float64).tiny)
    lanes = np.repeat(scale[:, None], normalisation.n_taxels, axis=1)
    readings = [one.readings for one in recordings]
    rasters = encode_all(readings, normalisation, parameters, lanes)
    return [one._replace(spikes=raster) for one, raster in zip(recordings, rasters, strict=True)]


def encode_all(
    readings: Sequence[NDArray[np.uint16]],
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    sa_scale: Floats | None = None,
) -> list[Raster]:
    """Return the SA spikes of many scans as :func:`encode_readings` does, side by side.

    ``sa_scale``: float64 (n_scans, 9), a factor on the SA current of each taxel.
    """
    rasters = []
    trains = encode_trials(readings, normalisation, parameters, sa_scale=sa_scale)
    for one, spikes in zip(readings, trains, strict=True):
        raster = np.zeros(one.shape, np.uint8)
        for taxel in range(normalisation.n_taxels):
            np.add.at(raster[:, taxel], spikes.train(taxel), 1)
        rasters.append(raster)
    return rasters


def population_reading(recording: ScanRecording, normalisation: Normalisation) -> float:
    """Return the mean normalised reading of all taxels, 0 to 1."""
    return float(normalisation.apply(recording.readings).mean())


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

    @property
    def kinds(self) -> tuple[ScanKind, ...]:
        """The representations that all its scans have."""
        others = self.calibration.kinds, self.tested.kinds
        return tuple(kind for kind in self.training.kinds if all(kind in one for one in others))

    def of_repeated_textures(self) -> FingerDataSet:
        """Return the scans of the textures with two training trials or more, with a remark.

        A single trial has no spread to train with and none to test. Raises :class:`WrongUse` where
        fewer than two textures are left.
        """
        trained = self.training.texture.tolist()
        repeated = [name for name in self.textures if trained.count(name) > 1]
        if len(repeated) < 2:
            raise WrongUse(
                f"{self.training.session} has {len(repeated)} textures with two training trials or "
                "more: a classifier needs two such textures"
            )
        return self.of_textures(repeated, "for a single training trial")

    def of_textures(
        self, textures: Sequence[str], reason: str = "which a stage lacks"
    ) -> FingerDataSet:
        """Return the scans of some textures, with a remark on the others and its reason."""
        parts = (self.training, self.calibration, self.tested)
        left_out = sorted({name for part in parts for name in part.textures} - set(textures))
        if not left_out:
            return self
        remark = f"{self.name}: textures left out, {reason}: {', '.join(left_out)}"
        training, calibration, tested = (part.of_textures(textures) for part in parts)
        return FingerDataSet(self.name, training, calibration, tested, (*self.remarks, remark))


def common_kinds(data_sets: Sequence[FingerDataSet]) -> tuple[ScanKind, ...]:
    """Return the representations that all data sets have."""
    return tuple(kind for kind in ScanKind if all(kind in one.kinds for one in data_sets))


def common_textures(each: Sequence[Sequence[str]]) -> tuple[str, ...] | None:
    """Return the textures that all stages or sets have, None where those are too few."""
    common = set(each[0]).intersection(*each[1:])
    every = set(each[0]).union(*each[1:])
    if len(common) < max(2.0, LEAST_COMMON * len(every)) and common != every:
        return None
    return tuple(sorted(common))


@dataclass(frozen=True, slots=True)
class RecordedScans:
    """The complete scans of a session, except those of normalisation.

    ``encoding``: ranges and parameters of their spikes. ``latencies``: milliseconds by kind.
    ``remarks``: what was left out or encoded anew, and why.
    """

    path: Path
    recordings: tuple[ScanRecording, ...]
    encoding: FingerEncoding
    simulated: bool
    latencies: dict[str, Floats]
    remarks: tuple[str, ...]
    n_windows: int = N_WINDOWS
    gaps: Gaps = Gaps.SPLIT
    window_ms: int = WINDOW_MS
    passport: SensorPassport | None = None

    @property
    def stages(self) -> frozenset[str]:
        """Stages that have complete scans."""
        return frozenset(one.stage for one in self.recordings)

    @property
    def scans(self) -> ScanSet:
        """The scans as arrays, with every gain that their sensor allows."""
        gained = {force: self._encoded(gain) for force, gain in self.gains.items()}
        return self._scan_set(self.recordings, gained)

    @property
    def gains(self) -> dict[ForceScaling, ForceGain]:
        """The gains of the SA current for the ranges; a calibrated one needs a passport."""
        ranges = self.encoding.normalisation
        gains = {ForceScaling.DIVIDED: divided(ranges)}
        if self.passport is not None:
            gains[ForceScaling.CALIBRATED] = self.passport.gain(ranges)
        return gains

    def _encoded(self, gain: ForceGain) -> list[Raster]:
        readings = [gain.apply(one.readings) for one in self.recordings]
        return encode_all(readings, self.encoding.normalisation, self.encoding.parameters)

    def encoded_anew(self, encode: Callable[[ScanRecording], NDArray[np.uint8]]) -> RecordedScans:
        """Return the scans with other spikes for their readings."""
        recordings = tuple(one._replace(spikes=encode(one)) for one in self.recordings)
        return replace(self, recordings=recordings)

    def scaled_to_population(self, reference: float) -> ScanSet:
        """Return the scans with the SA current scaled to a mean reading of ``reference``."""
        encoding = self.encoding
        scaled = scale_to_population(
            self.recordings, encoding.normalisation, reference, encoding.parameters
        )
        return self._scan_set(scaled)

    def _scan_set(
        self,
        recordings: Sequence[ScanRecording],
        gained: Mapping[ForceScaling, Sequence[Raster]] = MappingProxyType({}),
    ) -> ScanSet:
        return scan_set(
            str(self.path),
            recordings,
            self.encoding.normalisation,
            simulated=self.simulated,
            reference_um_per_s=self.encoding.reference_um_per_s,
            n_windows=self.n_windows,
            gaps=self.gaps,
            window_ms=self.window_ms,
            gained=gained,
        )

    def with_settings(self, settings: FingerAnalysisSettings) -> RecordedScans:
        """Return the scans with the windows of an analysis file."""
        encoding = self.encoding
        if settings.reference_speed_mm_s:
            speed_um_per_s = round(1000 * settings.reference_speed_mm_s)
            encoding = encoding._replace(reference_um_per_s=speed_um_per_s)
        return replace(
            self,
            encoding=encoding,
            n_windows=settings.windows,
            gaps=Gaps(settings.gaps),
            window_ms=settings.window_ms,
        )


@dataclass(frozen=True, slots=True)
class RecordedDataSets:
    """Data sets of sessions, and the same with label-free force scaling of the SA current.

    ``closing_digests``: of each session by its path, empty for one without.
    """

    data_sets: tuple[FingerDataSet, ...]
    scaled_currents: tuple[FingerDataSet, ...]
    latencies: dict[str, Floats]
    remarks: tuple[str, ...]
    closing_digests: dict[str, str]


def read_scans(path: Path) -> RecordedScans:
    """Return the committed scans of a session, without those whose rows were altered.

    Raises SessionError for another kind of folder, :class:`WrongUse` where no scan is complete or
    the ranges change between scans.
    """
    with FingerSession.open(path) as session:
        session.leave_out(damaged_trials(session))
        indices, torn = _usable(session)
        left_out = [*session.describe_missing(), *torn]
        if not indices:
            raise WrongUse(
                f"{path} has no complete scan to train, calibrate or run with"
                + (f" ({'; '.join(left_out)})" if left_out else "")
            )
        encoding = _encoding(session, indices)
        models = session.events_of(MODEL_KIND)
        named_by = str(models[-1].data["representation"]) if models else ""
        recordings = tuple(_recording(session, index, named_by) for index in indices)
        latencies = session.latencies
        kinds = sorted(set(latencies["kind"].tolist()))
        by_kind = {kind: latencies["ms"][latencies["kind"] == kind] for kind in kinds}
        header = session.header
    passport, obstacle = _passport(header)
    remarks = tuple(f"{path}: {text}" for text in (*left_out, *obstacle))
    found = RecordedScans(
        path, recordings, encoding, header.simulated, by_kind, remarks, passport=passport
    )
    if header.encoder_scaling == ForceScaling.NONE:
        return found
    # The board had the gain of the model that named the scans; every gain is applied to plain ones.
    return found.encoded_anew(
        lambda one: encode_readings(one.readings, encoding.normalisation, encoding.parameters)
    )


def _passport(header: SessionHeader) -> tuple[SensorPassport | None, tuple[str, ...]]:
    """Return the passport that the finger's counts can use, or a remark on one that they cannot."""
    passport = passport_of({"path": "the session", "passport": header.passport})
    if passport is None:
        return None, ()
    if passport.reading is Reading.COUNTS and len(passport.taxels) == header.n_taxels:
        return passport, ()
    return None, (
        f"Calibrated representations are left out: the passport is of the {passport.reading} of "
        f"{len(passport.taxels)} taxels, the finger gives the counts of {header.n_taxels}",
    )


def training_info(scans: RecordedScans, made_utc: str) -> TrainingInfo:
    """Return where a model's training trials are from."""
    trained = [one for one in scans.recordings if one.stage == Stage.TRAIN]
    with FingerSession.open(scans.path) as session:
        about = {"sensor": session.header.sensor, "passport": session.header.passport}
    source = {"path": str(scans.path), "content": content_digest(scans.path), **about}
    return TrainingInfo(
        made_utc,
        __version__,
        source_commit(),
        0,
        scans.simulated,
        len(trained),
        (),
        (),
        (source,),
    )


def read_data_sets(
    paths: Sequence[Path],
    resources: Resources = SERIAL_RESOURCES,
    settings: FingerAnalysisSettings | None = None,
) -> RecordedDataSets:
    """Return the data sets of sessions: each training session with a new one, in their order.

    Raises :class:`WrongUse` or SessionError for a session without its stages, pairs that do not
    match, or a session given twice.
    """
    _check_distinct(paths)
    read = []
    for number, path in enumerate(paths):
        resources.progress(READING_STAGE, number, len(paths))
        read.append(read_scans(path).with_settings(settings or FingerAnalysisSettings()))
    resources.progress(READING_STAGE, len(paths), len(paths))
    pairs, remarks = _pair(read)
    remarks.append(describe_windows(read))
    lacking = [str(one.path) for one in read if one.passport is None]
    if 0 < len(lacking) < len(read):
        remarks.append(
            "Calibrated representations are left out where a session carries no passport of its "
            f"sensor: {', '.join(lacking)}"
        )
    data_sets, currents = [], []
    for number, (first, new) in enumerate(pairs, start=1):
        name = f"set {number}"
        data_sets.append(FingerDataSet.from_sessions(name, first.scans, new.scans))
        trained = [one for one in first.recordings if one.stage == Stage.TRAIN]
        ranges = first.encoding.normalisation
        reference = float(np.mean([population_reading(one, ranges) for one in trained]))
        scaled = (one.scaled_to_population(reference) for one in (first, new))
        currents.append(FingerDataSet.from_sessions(name, *scaled))
    latencies: dict[str, list[Floats]] = {}
    remarks += dict.fromkeys(text for pair in pairs for one in pair for text in one.remarks)
    for one in read:
        for kind, ms in one.latencies.items():
            latencies.setdefault(kind, []).append(ms)
    joined = {kind: np.concatenate(parts) for kind, parts in latencies.items()}
    digests = {str(path): read_closing_digest(path) for path in paths}
    return RecordedDataSets(tuple(data_sets), tuple(currents), joined, tuple(remarks), digests)


def describe_windows(read: Sequence[RecordedScans]) -> str:
    """Return how many scans end beyond their windows or inside one, and what the gaps change."""
    n = beyond = short = moved = spikes = 0
    for one in read:
        reference = one.encoding.reference_um_per_s
        for scan in one.recordings:
            split, whole = (
                scale_windows(
                    scan.spikes,
                    scan.velocities_um_per_s,
                    reference,
                    gaps=gaps,
                    window_ms=one.window_ms,
                )
                for gaps in Gaps
            )
            n, beyond = n + 1, beyond + (len(split.counts) > one.n_windows)
            short += len(split.counts) <= one.n_windows
            spikes += int(split.counts.sum())
            moved += _moved(split, whole)
    return (
        f"{beyond} of {n} scans go beyond window {read[0].n_windows}, and what lies there is "
        f"dropped; {short} end inside a window, whose rate is over its real time. The other "
        f"reading of a gap across two batches (finger.gaps) puts {moved / max(spikes, 1):.1%} of "
        "the spikes in another window"
    )


def _moved(split: ScaledWindows, whole: ScaledWindows) -> int:
    """Return the spikes that are in another window or beyond all: each train keeps its order."""
    sides = [np.repeat(np.arange(len(one.counts) + 1), _with_rest(one, split)[:, taxel])
             for taxel in range(split.counts.shape[1]) for one in (split, whole)]  # fmt: skip
    return sum(int((a != b).sum()) for a, b in zip(sides[::2], sides[1::2], strict=True))


def _with_rest(one: ScaledWindows, split: ScaledWindows) -> Integers:
    """Return the counts with a row more for the spikes that are in no window."""
    return np.vstack([one.counts, split.counts.sum(axis=0) - one.counts.sum(axis=0)])


def _check_distinct(paths: Sequence[Path]) -> None:
    resolved = [path.resolve() for path in paths]
    for number, path in enumerate(resolved):
        if path in resolved[:number]:
            raise WrongUse(f"{paths[number]} is given twice: name each session once")


def _pair(
    read: Sequence[RecordedScans],
) -> tuple[list[tuple[RecordedScans, RecordedScans]], list[str]]:
    """Return pairs of a training and a new session of one encoding, and remarks."""
    first = [one for one in read if Stage.TRAIN in one.stages]
    new = _join_later([one for one in read if one.stages & {Stage.CALIBRATE, Stage.RUN}])
    if not first or len(first) != len(new):
        raise WrongUse(
            f"{len(first)} of the sessions have trials of the stage train and {len(new)} of "
            "calibrate and run: name as many training sessions as new ones"
        )
    remarks, pairs = [], []
    for one, other in zip(first, new, strict=True):
        if one is other:
            remarks.append(f"{one.path} was trained and tested in one session: it is no new one")
        matched, text = _match(one, other)
        remarks += text
        pairs.append((one, matched))
    return pairs, remarks


def _join_later(later: Sequence[RecordedScans]) -> list[RecordedScans]:
    """Return the later sessions, each session of calibration joined with the runs after it.

    As many runs as calibrations are paired in their order. Of more runs, each belongs to the last
    calibration that was named before it.
    """
    calibrations = [one for one in later if Stage.RUN not in one.stages]
    runs = [one for one in later if Stage.CALIBRATE not in one.stages]
    if len(calibrations) == len(runs):
        partner = {one.path: [other] for one, other in zip(calibrations, runs, strict=True)}
    else:
        partner = _runs_by_calibration(later)
    if len(runs) < len(calibrations) or not all(partner.values()):
        raise WrongUse(
            f"{len(calibrations)} of the sessions have scans of the stage calibrate only and "
            f"{len(runs)} of run only: name the calibration of each run before it"
        )
    joined = {path: _join(one, partner[path]) for one in calibrations for path in [one.path]}
    return [joined.get(one.path, one) for one in later if Stage.CALIBRATE in one.stages]


def _runs_by_calibration(later: Sequence[RecordedScans]) -> dict[Path, list[RecordedScans]]:
    """Return the runs that were named behind each calibration, by its path. Raises WrongUse."""
    found: dict[Path, list[RecordedScans]] = {}
    last: Path | None = None
    for one in later:
        if Stage.RUN not in one.stages:
            last = one.path
            found[last] = []
        elif Stage.CALIBRATE not in one.stages:
            if last is None:
                raise WrongUse(
                    f"{one.path} is named before any calibration: name the calibration of each run "
                    "before it"
                )
            found[last].append(one)
    return found


def _join(calibration: RecordedScans, runs: Sequence[RecordedScans]) -> RecordedScans:
    """Return a calibration and its runs as one session, with the encoding of the first run."""
    first = runs[0]
    recordings: list[ScanRecording] = []
    remarks = [*calibration.remarks]
    for one in (calibration, *runs):
        matched, text = (one, []) if one is first else _match(first, one)
        recordings += matched.recordings
        remarks += [*text, *(one.remarks if one is not calibration else ())]
    if len(runs) > 1:
        named = ", ".join(str(one.path) for one in runs)
        remarks.append(f"runs after the calibration {calibration.path}: {named}")
    return replace(first, recordings=tuple(recordings), remarks=tuple(remarks))


def _match(first: RecordedScans, new: RecordedScans) -> tuple[RecordedScans, list[str]]:
    """Return the new session with the encoding of the first, and remarks."""
    ours, theirs = first.encoding, new.encoding
    if ours.sensor != theirs.sensor:
        raise WrongUse(
            f"{new.path} was recorded with the sensor {theirs.sensor!r}, {first.path} with "
            f"{ours.sensor!r}: pair sessions of one sensor"
        )
    if ours.reference_um_per_s != theirs.reference_um_per_s:
        raise WrongUse(
            f"{new.path} has a reference speed of {theirs.reference_um_per_s / 1000:g} mm/s, "
            f"{first.path} of {ours.reference_um_per_s / 1000:g}: pair sessions of one protocol"
        )
    if ours.normalisation.has_ranges_of(theirs.normalisation):
        return new, []
    again = new.encoded_anew(
        lambda one: encode_readings(one.readings, ours.normalisation, ours.parameters)
    )
    text = (
        f"{new.path} was recorded with other taxel ranges than {first.path}: its readings are "
        "encoded anew with those"
    )
    return replace(again, encoding=ours), [text]


def _usable(session: FingerSession) -> tuple[list[int], list[str]]:
    """Return the indices of complete scans, and what was left out."""
    usable: list[int] = []
    torn: list[int] = []
    for index in session.committed().tolist():
        row = session.trials[index]
        if row["stage"] not in CLASSIFIED_STAGES:
            continue
        count = int(row["count"])
        whole = row["first_counter"] >= 0 and len(session.counters(index)) == count
        if whole and len(session.velocities_um_s(index)) == -(-count // BATCH_SAMPLES):
            usable.append(index)
        else:
            torn.append(int(row["trial_id"]))
    if not torn:
        return usable, []
    listed = ", ".join(map(str, torn))
    return usable, [f"{len(torn)} scans with lost samples or batches were left out: {listed}"]


def _encoding(session: FingerSession, indices: Sequence[int]) -> FingerEncoding:
    ranges = session.normalisation(indices[0])
    for index in indices[1:]:
        if not session.normalisation(index).has_ranges_of(ranges):
            trial = int(session.trials[index]["trial_id"])
            raise WrongUse(
                f"{session.path}: the taxel ranges change at trial {trial}: its scans cannot be "
                "compared, record the stages again with one set of ranges"
            )
    header = session.header
    return FingerEncoding(
        ranges,
        preset(header.encoder_preset or _DEFAULT_PRESET),
        header.reference_um_per_s,
        header.sensor,
    )


def _recording(session: FingerSession, index: int, named_by: str) -> ScanRecording:
    row = session.trials[index]
    return ScanRecording(
        session.samples(index),
        session.spikes(index),
        session.velocities_um_s(index),
        str(row["texture"]),
        str(row["profile"]),
        str(row["stage"]),
        int(row["trial_id"]),
        named_by,
    )
