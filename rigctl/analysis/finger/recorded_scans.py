"""Scans of recorded sessions, and the data sets that pairs of sessions make."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl import __version__
from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.finger.classifier import FingerEncoding
from rigctl.analysis.finger.evaluation import population_reading, scale_to_population
from rigctl.analysis.finger.scans import (
    FingerDataSet,
    ScanRecording,
    ScanSet,
    encode_readings,
    scan_set,
)
from rigctl.analysis.settings import FingerAnalysisSettings
from rigctl.config.resources import source_commit
from rigctl.encoding.parameters import preset
from rigctl.encoding.scaled_time import BATCH_SAMPLES, N_WINDOWS
from rigctl.errors import WrongUse
from rigctl.protocol.finger import Stage
from rigctl.session.files.analysis_file import content_digest
from rigctl.session.files.model_file import TrainingInfo
from rigctl.session.read.closing_digest import read_closing_digest
from rigctl.session.read.damage import damaged_trials
from rigctl.session.read.finger_session import FingerSession

Floats = NDArray[np.float64]
READING_STAGE = "reading sessions"
CLASSIFIED_STAGES = (Stage.TRAIN, Stage.CALIBRATE, Stage.RUN)
_DEFAULT_PRESET = "default"


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

    @property
    def stages(self) -> frozenset[str]:
        """Stages that have complete scans."""
        return frozenset(one.stage for one in self.recordings)

    @property
    def scans(self) -> ScanSet:
        """The scans as arrays."""
        return self._scan_set(self.recordings)

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

    def _scan_set(self, recordings: Sequence[ScanRecording]) -> ScanSet:
        return scan_set(
            str(self.path),
            recordings,
            self.encoding.normalisation,
            simulated=self.simulated,
            reference_um_per_s=self.encoding.reference_um_per_s,
            n_windows=self.n_windows,
        )

    def with_settings(self, settings: FingerAnalysisSettings) -> RecordedScans:
        """Return the scans with the windows of an analysis file."""
        encoding = self.encoding
        if settings.reference_speed_mm_s:
            speed_um_per_s = round(1000 * settings.reference_speed_mm_s)
            encoding = encoding._replace(reference_um_per_s=speed_um_per_s)
        return replace(self, encoding=encoding, n_windows=settings.windows)


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
        recordings = tuple(_recording(session, index) for index in indices)
        latencies = session.latencies
        kinds = sorted(set(latencies["kind"].tolist()))
        by_kind = {kind: latencies["ms"][latencies["kind"] == kind] for kind in kinds}
        simulated = session.header.simulated
    remarks = tuple(f"{path}: {text}" for text in left_out)
    return RecordedScans(path, recordings, encoding, simulated, by_kind, remarks)


def training_info(scans: RecordedScans, made_utc: str) -> TrainingInfo:
    """Return where a model's training trials are from."""
    trained = [one for one in scans.recordings if one.stage == Stage.TRAIN]
    source = {"path": str(scans.path), "content": content_digest(scans.path)}
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
    for one in read:
        remarks += one.remarks
        for kind, ms in one.latencies.items():
            latencies.setdefault(kind, []).append(ms)
    joined = {kind: np.concatenate(parts) for kind, parts in latencies.items()}
    digests = {str(path): read_closing_digest(path) for path in paths}
    return RecordedDataSets(tuple(data_sets), tuple(currents), joined, tuple(remarks), digests)


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
    """Return the later sessions, each session of calibration joined with the run after it."""
    calibrations = [one for one in later if Stage.RUN not in one.stages]
    runs = [one for one in later if Stage.CALIBRATE not in one.stages]
    if len(calibrations) != len(runs):
        raise WrongUse(
            f"{len(calibrations)} of the sessions have scans of the stage calibrate only and "
            f"{len(runs)} of run only: name the calibration of each run"
        )
    partner = {one.path: other for one, other in zip(runs, calibrations, strict=True)}
    return [
        _join(partner[one.path], one) if one.path in partner else one
        for one in later
        if Stage.RUN in one.stages
    ]


def _join(calibration: RecordedScans, run: RecordedScans) -> RecordedScans:
    """Return a calibration and a run of one session, with the encoding of the run."""
    matched, text = _match(run, calibration)
    return replace(
        run,
        recordings=matched.recordings + run.recordings,
        remarks=(*calibration.remarks, *run.remarks, *text),
    )


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


def _recording(session: FingerSession, index: int) -> ScanRecording:
    row = session.trials[index]
    return ScanRecording(
        session.samples(index),
        session.spikes(index),
        session.velocities_um_s(index),
        str(row["texture"]),
        str(row["profile"]),
        str(row["stage"]),
        int(row["trial_id"]),
    )
