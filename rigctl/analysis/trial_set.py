"""A set of labelled trials from one session or several, and the readers of their samples."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.executors import Progress
from rigctl.analysis.settings import AnalysisSettings
from rigctl.encoder.reading import FULL_SCALE, Reading, conductance
from rigctl.errors import SessionError, WrongUse
from rigctl.session.analysis_file import load_inputs
from rigctl.session.digests import damaged_trials
from rigctl.session.header import describe_mismatch, source_wiring, wirings_match
from rigctl.session.sample_index import SampleFile, SampleFiles, SampleRange, SampleReader
from rigctl.session.sensor_layout import SensorLayout, describe_difference, layouts_match
from rigctl.session.session import Session
from rigctl.session.session_reader import read_closing_digest
from rigctl.values import SAMPLE_RATE_HZ, Verdict

Sources = Sequence[Mapping[str, Any]]
"""For each session a mapping with its ``path`` and its ``wiring``."""
MAX_LISTED_IDS = 5
CHECKING_STAGE = "checking digests, MiB"


def check_same_wiring(first: Mapping[str, Any], other: Mapping[str, Any]) -> None:
    """Raise SessionError where two sessions have their taxels in another order."""
    _check(other, first, first["path"], "analyse them separately")


def check_same_sensor(paths: Sequence[Path], layouts: Sequence[SensorLayout | None]) -> None:
    """Raise SessionError where the last session's sensor has another layout than one before."""
    for path, layout in zip(paths, layouts, strict=False):
        if not layouts_match(layout, layouts[-1]):
            raise SessionError(
                f"{paths[len(layouts) - 1]} is of a sensor with another layout than {path} "
                f"({describe_difference(layouts[-1], layout)}): analyse them separately"
            )


def check_source_wiring(file: Path | str, sources: Sources, sessions: Sources) -> None:
    """Raise SessionError where a session has another order than the sources of ``file``."""
    for session, source in product(sessions, sources):
        remedy = "make one from sessions in that order"
        _check(session, source, f"the sessions of {file}", remedy)


def check_file_wiring(file: Path, sessions: Sequence[Path]) -> None:
    """Raise SessionError where a session has another order than a model or a spikes.h5."""
    check_source_wiring(file, load_inputs(file), [_source(path) for path in sessions])


def _check(session: Mapping[str, Any], other: Mapping[str, Any], name: str, remedy: str) -> None:
    ours, theirs = source_wiring(session), source_wiring(other)
    if not wirings_match(ours, theirs):
        raise SessionError(
            f"{session['path']} has its taxels in another order than {name} "
            f"({describe_mismatch(ours, theirs)}): {remedy}"
        )


def _source(path: Path) -> Mapping[str, Any]:
    with Session.open(path) as session:
        return {"path": str(path), "wiring": session.wiring}


class TrialRef(NamedTuple):
    """One trial: its session, its row in /trials, and its planned conditions.

    ``force_g``: in a set by depth, the depth in mm. ``sample_range``: the place of its samples in
    the ``files`` of the set. ``mount``: the mounting of its plate in its session, from 1.
    """

    session: int
    row: int
    trial_id: int
    texture: str
    speed_mm_s: float
    force_g: float
    n_planned: int
    sample_range: SampleRange
    mount: int = 1

    @property
    def n_samples(self) -> int:
        """Samples that were recorded or are held."""
        return self.sample_range.n_samples


@dataclass(frozen=True, slots=True)
class TrialSet:
    """Committed trials with motion, from one session or several of the same layout.

    ``paths``: absolute, as other processes open them too. ``provenance``: a mapping of plain
    values for each session; ``files``: parts of all sessions; ``remarks``: sentences on omissions;
    ``reading``: what readers of the files return. ``by_depth``: the drum pressed to depths, in mm,
    which stand in the place of grams. ``inputs``: the input of each taxel for each of ``files``,
    empty where the wiring is not known.
    """

    paths: tuple[Path, ...]
    trials: tuple[TrialRef, ...]
    n_taxels: int
    sensor_layout: SensorLayout
    provenance: tuple[dict[str, Any], ...]
    files: tuple[SampleFile, ...]
    remarks: tuple[str, ...] = field(default=())
    reading: Reading = Reading.COUNTS
    by_depth: bool = False
    inputs: tuple[tuple[int, ...], ...] = ()

    @property
    def press_unit(self) -> str:
        """The unit of what the drum pressed with: of a force, or of a depth."""
        return "mm" if self.by_depth else "g"

    @property
    def textures(self) -> tuple[str, ...]:
        """Names in sorted order."""
        return tuple(sorted({trial.texture for trial in self.trials}))

    @property
    def speeds_mm_s(self) -> tuple[float, ...]:
        """Planned speeds, ascending."""
        return tuple(sorted({trial.speed_mm_s for trial in self.trials}))

    @property
    def forces_g(self) -> tuple[float, ...]:
        """Planned forces, or depths in a set by depth, ascending."""
        return tuple(sorted({trial.force_g for trial in self.trials}))

    @property
    def simulated(self) -> bool:
        """Whether any of it comes from a simulated bench."""
        return any(source["simulated"] for source in self.provenance)

    def by_condition(self) -> dict[tuple[str, float], list[int]]:
        """Return the rows of each texture and speed, in sorted order."""
        rows: dict[tuple[str, float], list[int]] = {}
        for i, trial in enumerate(self.trials):
            rows.setdefault((trial.texture, trial.speed_mm_s), []).append(i)
        return dict(sorted(rows.items()))

    @property
    def as_conductances(self) -> TrialSet:
        """The same trials, of which readers return conductances where every wiring is known."""
        if self.reading is Reading.CONDUCTANCE or not self.inputs or not all(self.inputs):
            return self
        pairs = zip(self.files, self.inputs, strict=True)
        files = tuple(replace(file, inputs=inputs) for file, inputs in pairs)
        return replace(self, files=files, reading=Reading.CONDUCTANCE)

    def without(self, rows: Sequence[int], remark: str) -> TrialSet:
        """Return the set without the trials of some rows, with a remark on them."""
        left_out = set(rows)
        kept = tuple(trial for row, trial in enumerate(self.trials) if row not in left_out)
        return replace(self, trials=kept, remarks=(*self.remarks, remark))

    def without_gaps(self) -> TrialSet:
        """Return the set without the trials that lack samples, and a remark that lists those.

        Raises SessionError where no complete trial is left.
        """
        complete = tuple(trial for trial in self.trials if trial.sample_range.complete)
        if len(complete) == len(self.trials):
            return self
        remarks = list(self.remarks)
        for number, path in enumerate(self.paths):
            ours = (trial for trial in self.trials if trial.session == number)
            if ids := [trial.trial_id for trial in ours if not trial.sample_range.complete]:
                remarks.append(f"{path}: {_left_out(ids, 'gaps in their samples')}")
        if not complete:
            raise SessionError(f"{remarks[-1]}; no complete trial is left, record some first")
        return replace(self, trials=complete, remarks=tuple(remarks))


class ScratchMemory(threading.local):
    """Memory that each thread reuses, because fresh memory takes as long as reading into it."""

    def __init__(self) -> None:
        self._memory = np.empty(0, np.uint16)

    def array(self, n: int, n_taxels: int) -> NDArray[np.uint16]:
        """Return memory uint16 (n, n_taxels), which the next call in this thread reuses."""
        if len(self._memory) < n * n_taxels:
            self._memory = np.empty(n * n_taxels, np.uint16)
        return self._memory[: n * n_taxels].reshape(n, n_taxels)


class TrialBlock(NamedTuple):
    """Readings of several trials in one array, uint16 (n, n_taxels).

    Each trial has ``lengths`` rows from row ``starts`` on, int64 (n_trials,).
    """

    samples: NDArray[np.uint16]
    starts: NDArray[np.int64]
    lengths: NDArray[np.int64]

    @property
    def arrays(self) -> list[NDArray[np.uint16]]:
        """Samples of each trial, uint16 (n_i, n_taxels)."""
        return [self.samples[a : a + n] for a, n in zip(self.starts, self.lengths, strict=True)]


class TrialReader:
    """A reader of trials, for one thread; see :func:`open_trials`.

    It returns counts or, of files with ``inputs``, conductances.
    """

    def __init__(self, reader: SampleReader, files: SampleFiles) -> None:
        self._reader = reader
        self._files = files

    def read(self, trial: TrialRef) -> NDArray[np.uint16]:
        """Return the readings of a trial, uint16 (n, n_taxels). Raises SessionError naming it."""
        samples = self._read_counts(trial)
        inputs = self._files[trial.sample_range.file].inputs
        return conductance(samples, inputs) if inputs else samples

    def _read_counts(self, trial: TrialRef) -> NDArray[np.uint16]:
        try:
            samples = self._reader.read(trial.sample_range)
        except (OSError, SessionError) as error:
            raise SessionError(
                f"{self._files[trial.sample_range.file].path.parent}: trial {trial.trial_id} "
                f"cannot be read ({error}); rigctl verify says what is left of the session"
            ) from error
        return self._with_noise(samples, trial)

    def _with_noise(self, samples: NDArray[np.uint16], trial: TrialRef) -> NDArray[np.uint16]:
        """Return counts with the noise of their file: the same for a trial, whoever reads it."""
        place = trial.sample_range
        deviation = self._files[place.file].noise_counts
        if not deviation:
            return samples
        random = np.random.default_rng([place.file, place.start])
        noisy = samples + random.normal(0.0, deviation, samples.shape)
        return np.clip(np.rint(noisy), 0, FULL_SCALE).astype(np.uint16)

    def read_block(
        self, trials: Sequence[TrialRef], scratch: ScratchMemory | None = None
    ) -> TrialBlock:
        """Return the readings of at least one trial in one array, in ``scratch`` if given.

        Raises SessionError naming the trial that cannot be read.
        """
        ranges = [trial.sample_range for trial in trials]
        lengths = np.array([trial.n_samples for trial in trials])
        starts = np.cumsum(lengths) - lengths
        samples = (scratch or ScratchMemory()).array(
            int(lengths.sum()), self._files[ranges[0].file].n_taxels
        )
        block = TrialBlock(samples, starts, lengths)
        try:
            self._reader.read_all(ranges, samples, starts.tolist())
        except (OSError, SessionError):
            for trial, out in zip(trials, block.arrays, strict=True):
                out[:] = self._read_counts(trial)  # one by one, so that the error names the trial
        else:
            if self._files[ranges[0].file].noise_counts:
                for trial, out in zip(trials, block.arrays, strict=True):
                    out[:] = self._with_noise(out, trial)
        if self._files[ranges[0].file].inputs:
            for trial, out in zip(trials, block.arrays, strict=True):
                out[:] = conductance(out, self._files[trial.sample_range.file].inputs)
        return block


@contextmanager
def open_trials(files: SampleFiles) -> Iterator[TrialReader]:
    """Yield a reader of the files of a set (:attr:`TrialSet.files`)."""
    with SampleReader(files) as reader:
        yield TrialReader(reader, files)


def join_sessions(
    paths: Sequence[Path],
    progress: Progress = lambda stage, done, total: None,
    reading: Reading = Reading.COUNTS,
) -> TrialSet:
    """Return one set from session folders, without the trials whose rows were altered.

    Raises SessionError for mixed layouts or no trial, WrongUse for conductances of a session whose
    wiring is not known.
    """
    trials: list[TrialRef] = []
    remarks: list[str] = []
    sources: list[dict[str, Any]] = []
    layouts: list[SensorLayout | None] = []
    files: list[SampleFile] = []
    depths: list[bool] = []
    inputs: list[tuple[int, ...]] = []
    for number, path in enumerate(paths):
        if path.resolve() in {p.resolve() for p in paths[:number]}:
            raise SessionError(
                f"{path} is named twice: its trials would be in both training and test"
            )
        with Session.open(path) as session:
            session.leave_out(damaged_trials(session, partial(_show_mib, progress)))
            sources.append(_provenance(session))
            layouts.append(session.header.sensor_layout)
            _check_layout(sources[0], sources[-1])
            check_same_sensor(paths, layouts)
            depths.append(bool(np.any(_in_position(session.trials))))
            _check_same_press(paths, depths)
            trials += _moving_trials(session, number, len(files), remarks)
            files += _files(session, reading)
            inputs += [_known_inputs(session)] * (len(files) - len(inputs))
    if not trials:
        details = "; ".join(remarks) or ", ".join(map(str, paths))
        raise SessionError(f"there is no committed trial with motion: {details}")
    return TrialSet(
        tuple(path.absolute() for path in paths),
        tuple(trials),
        int(sources[0]["n_taxels"]),
        next(filter(None, layouts), SensorLayout.default(int(sources[0]["n_taxels"]))),
        tuple(sources),
        tuple(replace(file, path=file.path.absolute()) for file in files),
        tuple(remarks),
        reading,
        any(depths),
        tuple(inputs),
    )


def counted(files: SampleFiles) -> SampleFiles:
    """Return files whose readers return counts, whatever the set's reading."""
    numbers = range(len(files)) if isinstance(files, Sequence) else files
    return {number: replace(files[number], inputs=()) for number in numbers}


def _files(session: Session, reading: Reading) -> Sequence[SampleFile]:
    if reading is Reading.COUNTS:
        return session.sample_files()
    return [replace(file, inputs=session.inputs) for file in session.sample_files()]


def _known_inputs(session: Session) -> tuple[int, ...]:
    """Return the input of each taxel, empty where the wiring is not known."""
    try:
        return session.inputs
    except WrongUse:
        return ()


def _show_mib(progress: Progress, done_bytes: int, total_bytes: int) -> None:
    progress(CHECKING_STAGE, done_bytes >> 20, max(1, total_bytes >> 20))


def _in_position(trials: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which rows of /trials were pressed to a depth, bool (n,)."""
    return np.asarray(trials["force_mode"] == "position")


def _check_same_press(paths: Sequence[Path], depths: Sequence[bool]) -> None:
    """Raise SessionError where the last session was pressed to depths and the first to forces."""
    if depths[-1] != depths[0]:
        by = ("forces", "depths")
        raise SessionError(
            f"{paths[len(depths) - 1]} was pressed to {by[depths[-1]]}, {paths[0]} to "
            f"{by[depths[0]]}: analyse them separately"
        )


def _check_layout(first: dict[str, Any], last: dict[str, Any]) -> None:
    """Raise SessionError where two sessions differ in taxels, sample rate, scale or wiring."""
    for key, what in (("n_taxels", "taxels"), ("sample_rate_hz", "samples a second")):
        if first[key] != last[key]:
            raise SessionError(
                f"{last['path']} has {last[key]} {what}, {first['path']} has {first[key]}: "
                "sessions of different layouts cannot be analysed together"
            )
    if first["scaling"] != last["scaling"]:
        raise SessionError(
            f"{last['path']} stores readings on another scale than {first['path']}: import both "
            "together, or with the same low and high under [taxels]"
        )
    check_same_wiring(first, last)
    if last["sample_rate_hz"] != SAMPLE_RATE_HZ:
        raise SessionError(
            f"{last['path']} has {last['sample_rate_hz']} samples a second, not {SAMPLE_RATE_HZ}: "
            "resample it first"
        )


def _moving_trials(
    session: Session, number: int, first_file: int, remarks: list[str]
) -> list[TrialRef]:
    """Return the committed trials with motion; append remarks on the others."""
    table = session.trials
    remarks += [f"{session.path}: {line}" for line in session.describe_missing()]
    remarks += [f"{session.path}: {line}" for line in session.describe_repeated()]
    remarks += [f"{session.path}: {line}" for line in _uncounted(session)]
    if not session.finished:
        remarks.append(
            f"{session.path} is still being written or was not closed: trials committed so far"
        )
    rows = session.committed()
    unusual = np.isin(rows, list(session.quarantined()))
    if unusual.any():
        ids = table["trial_id"][rows[unusual]].tolist()
        remarks.append(f"{session.path}: {_left_out(ids, QUARANTINE)}")
        rows = rows[~unusual]
    still = (table["speed_mm_s"][rows] <= 0) | (table["travel_mm"][rows] <= 0)
    if still.any():
        ids = table["trial_id"][rows[still]].tolist()
        remarks.append(f"{session.path}: {_left_out(ids, 'no motion')}")
    return _references(session, rows[~still], number, first_file)


def _uncounted(session: Session) -> Iterator[str]:
    """Yield how many attempts the recorder did not commit, apart where another one counts."""
    verdicts = enumerate(session.trials["verdict"].tolist())
    failed = [(row, verdict) for row, verdict in verdicts if verdict != Verdict.COMMITTED]
    repeated = session.repeated
    for what, is_repeated in (("left out", False), ("repeated", True)):
        counts = Counter(verdict for row, verdict in failed if (row in repeated) == is_repeated)
        if counts:
            each = ", ".join(f"{n} {verdict}" for verdict, n in sorted(counts.items()))
            yield f"attempts {what}: {each}"


def _references(
    session: Session, rows: NDArray[np.int64], number: int, first_file: int
) -> list[TrialRef]:
    table = session.trials[rows]
    planned = np.rint(table["travel_mm"] / table["speed_mm_s"] * SAMPLE_RATE_HZ).astype(np.int64)
    press = np.where(_in_position(table), table["depth_mm"], table["force_g"])
    labels = (table[name] for name in ("trial_id", "texture", "speed_mm_s"))
    columns = [column.tolist() for column in (rows, *labels, press, planned)]
    places = session.sample_ranges(rows.tolist(), first_file)
    mounts = table["mount"].tolist()
    return list(map(TrialRef, [number] * len(rows), *columns, places, mounts))


def _provenance(session: Session) -> dict[str, Any]:
    header, layout = session.header, session.header.sensor_layout
    return {
        "path": str(session.path),
        "rig": header.rig,
        "simulated": header.simulated,
        "begun_utc": header.start_utc,
        "protocol": header.protocol,
        "plan_hash": header.plan_hash,
        "seed": header.seed,
        "simulation_seed": header.simulation.get("seed"),
        "software": f"{header.software_version} {header.software_commit}".strip(),
        "firmware": {b.board: f"{b.firmware_version} {b.build_hash}" for b in header.boards},
        "operator": header.operator,
        "sensor": header.sensor,
        "passport": header.passport,
        "n_taxels": header.n_taxels,
        "wiring": list(session.wiring),
        "sensor_layout": layout.to_values() if layout else None,
        "sample_rate_hz": header.sample_rate_hz,
        "scaling": [list(pair) for pair in session.scaling],
        "trials_planned": header.trials_planned,
        "trials_committed": len(session.committed()),
        "parts": len(session.parts),
        "closed": session.finished,
        "missing": session.describe_missing(),
        "closing_digest": read_closing_digest(session.path),
    }


QUARANTINE = "quarantine (`rigctl note SESSION --trial N --good` takes one out of it)"


def _left_out(ids: Sequence[int], reason: str) -> str:
    trials = "1 trial" if len(ids) == 1 else f"{len(ids)} trials"
    listed = ", ".join(map(str, ids[:MAX_LISTED_IDS])) + (" …" if len(ids) > MAX_LISTED_IDS else "")
    return f"{trials} left out for {reason}: {listed}"


def number_mountings(
    texture: NDArray[np.int64], places: Sequence[tuple[int, int]]
) -> NDArray[np.int64]:
    """Return the mounting of each trial's plate, from 0 for each texture, int64 (n_trials,).

    ``places``: each trial's session and its mounting there: a plate was mounted anew in another
    session.
    """
    _, place = np.unique(np.array(places, np.int64).reshape(-1, 2), axis=0, return_inverse=True)
    numbers = np.empty(len(texture), np.int64)
    for label in np.unique(texture):
        rows = texture == label
        numbers[rows] = np.unique(place.reshape(-1)[rows], return_inverse=True)[1].reshape(-1)
    return numbers


@dataclass(frozen=True, slots=True)
class Design:
    """Labels and conditions of a set's trials, an element for each trial.

    ``texture``: int64 index into ``textures``; ``speed_mm_s``, ``force_g``: float64.
    ``settings``: the groups, trained conditions and shares. ``mount``: int64, the mounting of the
    texture's plate over all sessions, from 0; empty if unknown.
    """

    textures: tuple[str, ...]
    texture: NDArray[np.int64]
    speed_mm_s: NDArray[np.float64]
    force_g: NDArray[np.float64]
    settings: AnalysisSettings = field(default_factory=AnalysisSettings)
    mount: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    @classmethod
    def from_trials(cls, trials: TrialSet, settings: AnalysisSettings | None = None) -> Design:
        """Return the design of a set of trials."""
        names = trials.textures
        texture = np.array([names.index(t.texture) for t in trials.trials], np.int64)
        return cls(
            names,
            texture,
            np.array([t.speed_mm_s for t in trials.trials]),
            np.array([t.force_g for t in trials.trials]),
            settings or AnalysisSettings(),
            mount=number_mountings(texture, [(t.session, t.mount) for t in trials.trials]),
        )

    @property
    def groups(self) -> tuple[str, ...]:
        """The texture groups in the set."""
        return self.settings.groups.present(self.textures)

    @property
    def ungrouped(self) -> tuple[str, ...]:
        """Textures without a group."""
        group_of = self.settings.groups.group_of
        return tuple(name for name in self.textures if name not in group_of)

    def classes(self, task: published.Task) -> tuple[str, ...]:
        """Return the class names of a task."""
        return self.groups if task.grouped else self.textures

    def labels(self, task: published.Task) -> NDArray[np.int64]:
        """Return the index of each trial's class in :meth:`classes`, int64; −1 for none."""
        return self.group_labels if task.grouped else self.texture

    @property
    def group_labels(self) -> NDArray[np.int64]:
        """Index of each trial's texture group, int64; −1 for a texture without one."""
        groups, group_of = self.groups, self.settings.groups.group_of
        index = [groups.index(group_of[n]) if n in group_of else -1 for n in self.textures]
        return np.array(index, np.int64)[self.texture]

    def conditions(self) -> list[NDArray[np.intp]]:
        """Return the rows of each texture × speed × force in the set, in a fixed order."""
        keys = np.stack([self.texture, self.speed_mm_s, self.force_g], axis=1)
        _, which = np.unique(keys, axis=0, return_inverse=True)
        order = np.argsort(which.reshape(-1), kind="stable")
        ends = np.cumsum(np.bincount(which.reshape(-1)))[:-1]
        return list(np.split(order, ends))
