"""Several sessions joined into one set of labelled trials, and what was left out of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.reader import Session
from rigctl.values import SAMPLE_RATE_HZ, Verdict

NAMED_IDS = 5


class TrialRef(NamedTuple):
    """One trial: which session and row it is, and what was under the sensor, as planned."""

    session: int
    row: int
    trial_id: int
    texture: str
    speed_mm_s: float
    force_g: float
    n_planned: int


@dataclass(frozen=True, slots=True)
class TrialSet:
    """Committed trials with motion, out of one session or several of one layout.

    ``provenance``: a plain mapping for each session; ``remarks``: sentences on what was left out.
    """

    paths: tuple[Path, ...]
    trials: tuple[TrialRef, ...]
    n_taxels: int
    provenance: tuple[dict[str, Any], ...]
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
        return TrialSet(self.paths, kept, self.n_taxels, self.provenance, tuple(remarks))


class Samples:
    """Reads the samples of a set's trials while its sessions are open."""

    def __init__(self, sessions: Sequence[Session]) -> None:
        self._sessions = sessions

    def of(self, trial: TrialRef) -> NDArray[np.uint16]:
        """Readings uint16 (n, n_taxels), contiguous. Raises SessionError naming the trial."""
        session = self._sessions[trial.session]
        try:
            return np.ascontiguousarray(session.samples(trial.row))
        except OSError as error:
            raise SessionError(
                f"{session.path}: trial {trial.trial_id} cannot be read ({error}); "
                "rigctl verify says what is left of the session"
            ) from error

    def complete(self, trial: TrialRef, samples: NDArray[np.uint16]) -> bool:
        """Whether no sample of the trial's window is missing."""
        return len(samples) == int(self._sessions[trial.session].trials[trial.row]["count"])


@contextmanager
def opened(paths: Sequence[Path]) -> Iterator[Samples]:
    """The sessions of a set for reading."""
    with ExitStack() as stack:
        yield Samples([stack.enter_context(Session.open(path)) for path in paths])


def join_sessions(paths: Sequence[Path]) -> TrialSet:
    """One set out of session folders. Raises SessionError for mixed layouts or no trial at all."""
    trials: list[TrialRef] = []
    remarks: list[str] = []
    sources: list[dict[str, Any]] = []
    for number, path in enumerate(paths):
        if path.resolve() in {p.resolve() for p in paths[:number]}:
            raise SessionError(f"{path} is named twice: its trials would be both learnt and tested")
        with Session.open(path) as session:
            sources.append(_provenance(session))
            _same_layout(sources)
            found, said = _trials_of(session, number)
        trials += found
        remarks += said
    if not trials:
        told = "; ".join(remarks) or ", ".join(map(str, paths))
        raise SessionError(f"there is no committed trial with motion: {told}")
    n_taxels = int(sources[0]["n_taxels"])
    return TrialSet(tuple(paths), tuple(trials), n_taxels, tuple(sources), tuple(remarks))


def _same_layout(sources: Sequence[dict[str, Any]]) -> None:
    first, last = sources[0], sources[-1]
    for key, what in (("n_taxels", "taxels"), ("sample_rate_hz", "samples a second")):
        if first[key] != last[key]:
            raise SessionError(
                f"{last['path']} has {last[key]} {what}, {first['path']} has {first[key]}: "
                "sessions of different layout cannot be analysed together"
            )
    if last["sample_rate_hz"] != SAMPLE_RATE_HZ:
        raise SessionError(
            f"{last['path']} has {last['sample_rate_hz']} samples a second, not {SAMPLE_RATE_HZ}: "
            "resample it first"
        )


def _trials_of(session: Session, number: int) -> tuple[list[TrialRef], list[str]]:
    table = session.trials
    remarks = []
    verdicts = Counter(str(verdict) for verdict in table["verdict"])
    ill = {v: n for v, n in verdicts.items() if v != Verdict.COMMITTED.value}
    if ill:
        told = ", ".join(f"{n} {verdict}" for verdict, n in sorted(ill.items()))
        remarks.append(f"{session.path}: attempts left out: {told}")
    if not session.finished:
        remarks.append(
            f"{session.path} is still being written or was not closed: trials committed so far"
        )
    rows = [int(row) for row in session.committed()]
    still = [i for i in rows if table[i]["speed_mm_s"] <= 0 or table[i]["travel_mm"] <= 0]
    if still:
        ids = [int(table[i]["trial_id"]) for i in still]
        remarks.append(f"{session.path}: {_plural(len(ids))} left out for no motion: {_named(ids)}")
    moving = [row for row in rows if row not in set(still)]
    return [_reference(table[row], row, number) for row in moving], remarks


def _reference(row: Any, index: int, session: int) -> TrialRef:
    speed = float(row["speed_mm_s"])
    planned = round(float(row["travel_mm"]) / speed * SAMPLE_RATE_HZ)
    return TrialRef(
        session,
        index,
        int(row["trial_id"]),
        str(row["texture"]),
        speed,
        float(row["force_g"]),
        planned,
    )


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
        "sample_rate_hz": header.sample_rate_hz,
        "trials_planned": header.trials_planned,
        "trials_committed": len(session.committed()),
        "parts": len(session.parts),
        "closed": session.finished,
    }


def _plural(n: int) -> str:
    return f"{n} trial" if n == 1 else f"{n} trials"


def _named(ids: Sequence[int]) -> str:
    return ", ".join(map(str, ids[:NAMED_IDS])) + (" …" if len(ids) > NAMED_IDS else "")
