"""Many sittings of one plan, killed at random instants; what they leave is checked each time.

The state of a campaign is a file beside the session, so that a later call continues it.
"""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from rigctl.session.part import existing_parts
from rigctl.session.recover import recover
from rigctl.session.session import open_session
from tests.endurance.sitting import SittingPlan, run_sitting

STATE_FILE = "state.json"
START_SHARE = 0.1
"""Share of the kills that come while a sitting starts."""
START_S = 3.0
AFTER_TRIAL_S = 0.2
"""A kill comes within this time after a trial was committed; a trial takes 0.06 s."""
LEAVE_BEHIND = ("given up", "disk")
"""Events after which a trial before the last one may be missing until the run comes back to it."""
HANGS_AFTER_S = 300.0
"""A sitting that says nothing for so long has hung."""


@dataclass(slots=True)
class State:
    """What a campaign has seen so far; the file beside the session has the same names."""

    sittings: int = 0
    kills: int = 0
    kills_at_start: int = 0
    committed: int = 0
    planned: int = 0
    wall_s: float = 0.0
    most_g: float = 0.0
    acknowledged: int = 0
    faults: dict[str, int] = field(default_factory=dict)
    fault_states: dict[str, int] = field(default_factory=dict)
    events: dict[str, int] = field(default_factory=dict)
    endings: dict[str, int] = field(default_factory=dict)
    resumed_s: list[float] = field(default_factory=list)
    holes: list[int] = field(default_factory=list)
    memory: list[tuple[int, int, float]] = field(default_factory=list)
    unsafe: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    @property
    def complete(self) -> bool:
        """Whether every planned trial is committed."""
        return 0 < self.planned <= self.committed


@dataclass(frozen=True, slots=True)
class Campaign:
    """A soak of one plan in a folder.

    ``kill_every``: mean number of trials between two kills, up to trial ``kill_until``; after that
    a sitting is long, which shows its memory. ``start``: how processes start (``spawn`` a new
    interpreter each time, ``forkserver`` a copy of one that has loaded the program).
    ``most_sittings``: more are a hang.
    """

    folder: Path
    protocol: Path
    kind: str = "virtual"
    seed: int = 1
    mean_trials: float = 50.0
    kill_every: float = 75.0
    kill_until: int = 18_000
    start: str = "spawn"
    most_sittings: int = 5_000
    faults: tuple[str, ...] | None = None

    @property
    def session(self) -> Path:
        """The session's folder."""
        return self.folder / "session"

    def run(self, report: Callable[[State], None] = lambda state: None) -> State:
        """Run sittings until the plan is complete; return what was seen.

        A kill between the last trial and the session's end leaves a part to be closed, as `rigctl
        verify` then says.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        state = self.load()
        while not state.complete and state.sittings < self.most_sittings:
            began_s = time.perf_counter()
            self._sit(state)
            state.wall_s += time.perf_counter() - began_s
            self._save(state)
            report(state)
        if state.complete:
            recover(self.session)
        return state

    def load(self) -> State:
        """Return the state of the calls before."""
        path = self.folder / STATE_FILE
        return State(**json.loads(path.read_text())) if path.is_file() else State()

    def _save(self, state: State) -> None:
        path = self.folder / STATE_FILE
        path.with_suffix(".new").write_text(json.dumps(asdict(state)))
        path.with_suffix(".new").replace(path)

    def _sit(self, state: State) -> None:
        state.sittings += 1
        plan = SittingPlan(
            self.session, self.protocol, self.kind, state.sittings, self.seed, self.mean_trials
        )
        if self.faults is not None:
            plan = SittingPlan(**{**asdict(plan), "faults": self.faults})
        context: Any = multiprocessing.get_context(self.start)
        if self.start == "forkserver":
            context.set_forkserver_preload(["tests.endurance.warm"])
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=run_sitting, args=(plan, theirs))
        process.start()
        theirs.close()
        watched = _Watched(ours, state, self._killing(state))
        try:
            watched.watch(process)
        finally:
            process.kill()
            process.join()
            process.close()
            ours.close()
        self._check(state, watched)

    def _killing(self, state: State) -> _Killing:
        random = Random(f"kill {self.seed} {state.sittings}")
        if state.committed >= self.kill_until:
            return _Killing()
        if random.random() < START_SHARE:
            return _Killing(after_start_s=random.uniform(0.0, START_S))
        trials = max(1, round(random.expovariate(1 / self.kill_every)))
        return _Killing(trials, random.uniform(0.0, AFTER_TRIAL_S))

    def _check(self, state: State, watched: _Watched) -> None:
        """Read what the sitting left."""
        if not existing_parts(self.session):
            return
        number = state.sittings
        with open_session(self.session) as session:
            ids = session.trials["trial_id"][session.committed()]
            state.planned = session.header.trials_planned
            state.problems += [f"sitting {number}: {line}" for line in session.describe_missing()]
            for part, samples in watched.on_disk.items():
                held = sum(p.n_samples for p in session.parts if p.number >= part)
                state.acknowledged += samples
                if held < samples:
                    state.problems.append(
                        f"sitting {number}: {samples} samples were on disk from part {part} on, "
                        f"{held} are there"
                    )
        if len(np.unique(ids)) < len(ids):
            state.problems.append(f"sitting {number}: a trial is committed twice")
        if len(ids) < state.committed:
            state.problems.append(f"sitting {number}: committed trials are gone")
        holes = set(range(1, int(max(ids, default=0)) + 1)) - set(ids.tolist())
        if len(holes - set(state.holes)) > watched.left_behind:
            state.problems.append(f"sitting {number}: trials {sorted(holes)} are left behind")
        state.holes = sorted(holes)
        state.committed = len(ids)


@dataclass(slots=True)
class _Killing:
    """When a sitting is killed: ``trials`` and then ``after_s``, or ``after_start_s``; or never."""

    trials: int = 0
    after_s: float = 0.0
    after_start_s: float | None = None


class _Watched:
    """What one sitting says, until it ends or is killed. ``on_disk``: samples from a part on.

    ``left_behind``: how many trials the run says that it will come back to.
    """

    def __init__(self, pipe: Connection, state: State, killing: _Killing) -> None:
        self.on_disk: dict[int, int] = {}
        self.left_behind = 0
        self._pipe = pipe
        self._state = state
        self._killing = killing
        self._committed = 0
        self._began_s = time.perf_counter()
        self._is_running = False

    def watch(self, process: Any) -> None:
        """Take what the process says and kill it when that is due."""
        killing, state = self._killing, self._state
        if killing.after_start_s is not None:
            time.sleep(killing.after_start_s)
            process.kill()
            state.kills += 1
            state.kills_at_start += 1
            self._take_rest()
            return
        while self._take():
            if killing.trials and self._committed >= killing.trials:
                time.sleep(killing.after_s)
                process.kill()
                state.kills += 1
                killing.trials = 0
        if process.is_alive() and not self._pipe.closed:
            process.join(5.0)
        if process.is_alive():
            state.problems.append(f"sitting {state.sittings} hangs")
            process.kill()

    def _take_rest(self) -> None:
        while self._take():
            pass

    def _take(self) -> bool:
        """Take one message; return False at the end."""
        try:
            if not self._pipe.poll(HANGS_AFTER_S):
                return False
            kind, *values = self._pipe.recv()
        except (EOFError, OSError):
            return False
        self._note(kind, values)
        return True

    def _note(self, kind: str, values: list[Any]) -> None:
        state = self._state
        match kind:
            case "committed":
                self._committed += 1
            case "running":
                state.resumed_s.append(round(time.perf_counter() - self._began_s, 3))
            case "on disk":
                part, samples, most_g = values
                self.on_disk[part] = max(samples, self.on_disk.get(part, 0))
                state.most_g = max(state.most_g, most_g)
            case "memory":
                state.memory.append((state.sittings, *values))
            case "fault":
                _count(state.faults, values[0])
                _count(state.fault_states, values[1])
            case "event" if values[0] == "unsafe":
                state.unsafe.append(f"sitting {state.sittings}, {values[1]}")
            case "event" if values[0] == "stuck":
                state.problems.append(f"sitting {state.sittings}: {values[1]}")
            case "event":
                self.left_behind += values[0] in LEAVE_BEHIND
                _count(state.events, values[0])
            case "ended":
                _count(state.endings, ": ".join(values))


def _count(counts: dict[str, int], name: str) -> None:
    counts[name] = counts.get(name, 0) + 1
