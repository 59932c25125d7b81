"""Several sessions joined into one set of labelled trials, and what was left out of it."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.wiring_check import check_alike
from rigctl.errors import SessionError
from rigctl.session.read.sample_index import SampleFile, SampleFiles, SampleRange, SampleReader
from rigctl.session.read.session import Session
from rigctl.values import SAMPLE_RATE_HZ, Verdict

NAMED_IDS = 5


class TrialRef(NamedTuple):
    """One trial: which session and row it is, and what was under the sensor, as planned.

    ``place``: where its samples lie in the ``files`` of the set.
    """

    session: int
    row: int
    trial_id: int
    texture: str
    speed_mm_s: float
    force_g: float
    n_planned: int
    place: SampleRange


@dataclass(frozen=True, slots=True)
class TrialSet:
    """Committed trials with motion, out of one session or several of one layout.

    ``paths``: absolute, as other processes open them too. ``provenance``: a plain mapping for each
    session; ``files``: parts of all sessions; ``remarks``: sentences on what was left out.
    """

    paths: tuple[Path, ...]
    trials: tuple[TrialRef, ...]
    n_taxels: int
    provenance: tuple[dict[str, Any], ...]
    files: tuple[SampleFile, ...]
    remarks: tuple[str, ...] = field(default=())

    @property
    def textures(self) -> tuple[str, ...]:
        """Names, sorted."""
        return tuple(sorted({trial.texture for trial in self.trials}))

    @property
    def speeds_mm_s(self) -> tuple[float, ...]:
        """Planned speeds, ascending."""
        return tuple(sorted({trial.speed_mm_s for trial in self.trials}))

    @property
    def forces_g(self) -> tuple[float, ...]:
        """Planned forces, ascending."""
        return tuple(sorted({trial.force_g for trial in self.trials}))

    @property
    def simulated(self) -> bool:
        """Whether any of it comes from a simulated bench."""
        return any(source["simulated"] for source in self.provenance)

    def without(self, rows: Sequence[int], why: str) -> TrialSet:
        """The set less some trials (indices into ``trials``), with a remark that names them."""
        if not rows:
            return self
        gone = set(rows)
        kept = tuple(trial for i, trial in enumerate(self.trials) if i not in gone)
        remarks = list(self.remarks)
        for number, path in enumerate(self.paths):
            ids = [self.trials[i].trial_id for i in rows if self.trials[i].session == number]
            if ids:
                remarks.append(f"{path}: {_plural(len(ids))} left out for {why}: {_named(ids)}")
        if not kept:
            raise SessionError(f"{remarks[-1]}; no complete trial is left, record some first")
        return replace(self, trials=kept, remarks=tuple(remarks))


class ScratchMemory(threading.local):
    """Memory of each thread that is used again: fresh memory costs as much as to read into it."""

    def __init__(self) -> None:
        self._memory = np.empty(0, np.uint16)

    def room(self, n: int, n_taxels: int) -> NDArray[np.uint16]:
        """Memory uint16 (n, n_taxels), which the next call in this thread takes back."""
        if len(self._memory) < n * n_taxels:
            self._memory = np.empty(n * n_taxels, np.uint16)
        return self._memory[: n * n_taxels].reshape(n, n_taxels)


class TrialBlock(NamedTuple):
    """Readings of several trials in one ``memory``, uint16 (n, n_taxels).

    Each has ``lengths`` rows from ``begins`` on, int64 (n_trials,).
    """

    memory: NDArray[np.uint16]
    begins: NDArray[np.int64]
    lengths: NDArray[np.int64]

    @property
    def arrays(self) -> list[NDArray[np.uint16]]:
        """Of each trial, (n, n_taxels)."""
        pairs = zip(self.begins.tolist(), self.lengths.tolist(), strict=True)
        return [self.memory[begin : begin + n] for begin, n in pairs]


class TrialReader:
    """Reads the samples of trials, in one thread, while it is open."""

    def __init__(self, reader: SampleReader, files: SampleFiles) -> None:
        self._reader = reader
        self._files = files

    def of(self, trial: TrialRef, out: NDArray[np.uint16] | None = None) -> NDArray[np.uint16]:
        """Readings uint16 (n, n_taxels), in ``out`` where it is given.

        Raises SessionError naming the trial.
        """
        try:
            return self._reader.read(trial.place, out)
        except (OSError, SessionError) as error:
            raise SessionError(
                f"{self._files[trial.place.file].path.parent}: trial {trial.trial_id} cannot be "
                f"read ({error}); rigctl verify says what is left of the session"
            ) from error

    def all_of(
        self, trials: Sequence[TrialRef], scratch: ScratchMemory | None = None
    ) -> list[NDArray[np.uint16]]:
        """Readings of several trials, in one memory, ``scratch`` if given."""
        return self.block_of(trials, scratch).arrays if trials else []

    def block_of(
        self, trials: Sequence[TrialRef], scratch: ScratchMemory | None = None
    ) -> TrialBlock:
        """Readings of at least one trial, in one memory, ``scratch`` if given.

        Raises SessionError naming the trial that cannot be read.
        """
        places = [trial.place for trial in trials]
        lengths = np.array([place.stop - place.start for place in places])
        begins = np.cumsum(lengths) - lengths
        n_taxels = self._files[places[0].file].n_taxels
        block = TrialBlock(
            (scratch or ScratchMemory()).room(int(lengths.sum()), n_taxels), begins, lengths
        )
        try:
            self._reader.read_all(places, block.memory, begins.tolist())
        except (OSError, SessionError):
            for trial, samples in zip(trials, block.arrays, strict=True):
                self.of(trial, samples)  # one by one, so that the error names the trial
        return block


@contextmanager
def opened(files: SampleFiles) -> Iterator[TrialReader]:
    """The files of a set (:attr:`TrialSet.files`) for reading."""
    with SampleReader(files) as reader:
        yield TrialReader(reader, files)


def join_sessions(paths: Sequence[Path]) -> TrialSet:
    """One set out of session folders. Raises SessionError for mixed layouts or no trial at all."""
    trials: list[TrialRef] = []
    remarks: list[str] = []
    sources: list[dict[str, Any]] = []
    files: list[SampleFile] = []
    for number, path in enumerate(paths):
        if path.resolve() in {p.resolve() for p in paths[:number]}:
            raise SessionError(f"{path} is named twice: its trials would be both learnt and tested")
        with Session.open(path) as session:
            sources.append(_provenance(session))
            _same_layout(sources)
            found, said = _trials_of(session, number, len(files))
            files += session.sample_files()
        trials += found
        remarks += said
    if not trials:
        told = "; ".join(remarks) or ", ".join(map(str, paths))
        raise SessionError(f"there is no committed trial with motion: {told}")
    return TrialSet(
        tuple(path.absolute() for path in paths),
        tuple(trials),
        int(sources[0]["n_taxels"]),
        tuple(sources),
        tuple(replace(file, path=file.path.absolute()) for file in files),
        tuple(remarks),
    )


def _same_layout(sources: Sequence[dict[str, Any]]) -> None:
    first, last = sources[0], sources[-1]
    for key, what in (("n_taxels", "taxels"), ("sample_rate_hz", "samples a second")):
        if first[key] != last[key]:
            raise SessionError(
                f"{last['path']} has {last[key]} {what}, {first['path']} has {first[key]}: "
                "sessions of different layout cannot be analysed together"
            )
    if first["scaling"] != last["scaling"]:
        raise SessionError(
            f"{last['path']} stores readings on another scale than {first['path']}: import both "
            "at once, or with the same low and high under [taxels]"
        )
    check_alike(first, last)
    if last["sample_rate_hz"] != SAMPLE_RATE_HZ:
        raise SessionError(
            f"{last['path']} has {last['sample_rate_hz']} samples a second, not {SAMPLE_RATE_HZ}: "
            "resample it first"
        )


def _trials_of(session: Session, number: int, first_file: int) -> tuple[list[TrialRef], list[str]]:
    table = session.trials
    remarks = []
    verdicts = Counter(table["verdict"].tolist())
    ill = {v: n for v, n in verdicts.items() if v != Verdict.COMMITTED.value}
    if ill:
        told = ", ".join(f"{n} {verdict}" for verdict, n in sorted(ill.items()))
        remarks.append(f"{session.path}: attempts left out: {told}")
    if not session.finished:
        remarks.append(
            f"{session.path} is still being written or was not closed: trials committed so far"
        )
    rows = session.committed()
    still = (table["speed_mm_s"][rows] <= 0) | (table["travel_mm"][rows] <= 0)
    if still.any():
        ids = table["trial_id"][rows[still]].tolist()
        remarks.append(f"{session.path}: {_plural(len(ids))} left out for no motion: {_named(ids)}")
    return _references(session, rows[~still], number, first_file), remarks


def _references(
    session: Session, rows: NDArray[np.int64], number: int, first_file: int
) -> list[TrialRef]:
    table = session.trials[rows]
    planned = np.rint(table["travel_mm"] / table["speed_mm_s"] * SAMPLE_RATE_HZ).astype(np.int64)
    named = ("trial_id", "texture", "speed_mm_s", "force_g")
    columns = (rows, *(table[name] for name in named), planned)
    places = session.sample_ranges(rows.tolist(), first_file)
    told = (column.tolist() for column in columns)
    return list(map(TrialRef, [number] * len(rows), *told, places))


def _provenance(session: Session) -> dict[str, Any]:
    header = session.header
    boards = {
        board.board: f"{board.firmware_version} {board.build_hash}" for board in header.boards
    }
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
        "firmware": boards,
        "operator": header.operator,
        "sensor": header.sensor,
        "n_taxels": header.n_taxels,
        "wiring": list(session.wiring),
        "sample_rate_hz": header.sample_rate_hz,
        "scaling": [list(pair) for pair in session.scaling],
        "trials_planned": header.trials_planned,
        "trials_committed": len(session.committed()),
        "parts": len(session.parts),
        "closed": session.finished,
    }


def _plural(n: int) -> str:
    return f"{n} trial" if n == 1 else f"{n} trials"


def _named(ids: Sequence[int]) -> str:
    return ", ".join(map(str, ids[:NAMED_IDS])) + (" …" if len(ids) > NAMED_IDS else "")
