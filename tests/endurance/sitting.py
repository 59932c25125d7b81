"""One sitting of a soak: an engine that runs a plan, faults that come by chance, and a person.

It runs in a process of its own, which may be killed at any instant. The person does what the
documents ask for: looks at a rig that stopped, cures what was wrong, clears the fault, resumes.
"""

from __future__ import annotations

import asyncio
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from typing import Any

from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import State
from rigctl.engine import served_engine
from rigctl.engine.engine import Engine
from rigctl.engine.live_file import LiveWriter
from rigctl.engine.rpc.messages import DISK, DISK_ERROR, FAULT, LINK, NOISE
from rigctl.engine.run_request import RunRequest
from rigctl.errors import RigctlError
from rigctl.rig import open_rig
from rigctl.session.part import existing_parts, part_paths
from rigctl.values import Event
from tests.endurance.faults import FAULTS, Fault
from tests.endurance.safety_watch import SafetyWatch
from tests.engine.engine_harness import EngineHarness

EPOCH = datetime(2026, 1, 1, tzinfo=UTC)
TURN_S = 0.5
"""How often the person looks, in the world's time."""
LOOKS_AFTER_S = 20.0
"""When the person is at a rig that stopped."""
WITHIN_S = 12.0
"""A fault comes within this time after a trial: in any state of the next one."""
MEMORY_EVERY_TRIALS = 100
STUCK_AFTER_S = 7200.0
"""Without a committed trial for so long, in the world's time, a sitting is given up."""
BY_ITSELF = frozenset({LINK, DISK, NOISE, DISK_ERROR})
"""Pauses that end by themselves."""
TOLD = ("recovery", "late", "fault", "pause", "disk", "failed", "unrecorded")
Say = Callable[..., None]


@dataclass(frozen=True, slots=True)
class SittingPlan:
    """What a sitting is to do. ``number``: of the sitting; ``mean_trials``: between two faults."""

    folder: Path
    protocol: Path
    kind: str
    number: int
    seed: int
    mean_trials: float
    faults: tuple[str, ...] = tuple(fault.name for fault in FAULTS)
    paced: bool = False

    @property
    def start_utc(self) -> str:
        """The date of the sitting: one a day."""
        return (EPOCH + timedelta(days=self.number)).isoformat()


def ring_path(plan: SittingPlan) -> Path:
    """Return the file of the newest samples, which outlives a sitting in real time."""
    return plan.folder.parent / f"live-{plan.number}.ring"


def run_sitting(plan: SittingPlan, pipe: Connection) -> None:
    """Run until every trial is committed or the engine ends; what happens goes into the pipe."""

    def say(kind: str, *values: Any) -> None:
        pipe.send((kind, *values))

    served_engine.IDLE_TIMEOUT_S = math.inf  # as with a window that is left open
    rig = open_rig(plan.kind, seed=plan.seed, paced=plan.paced)
    watch = SafetyWatch(rig)
    live = LiveWriter(ring_path(plan), rig.config.taxels.count)
    if not plan.paced:
        ring_path(plan).unlink()
    engine = Engine(rig, live, lambda: plan.start_utc, real_time=plan.paced)
    harness = EngineHarness(rig, engine, plan.folder.parent)
    person = _Person(plan, harness, watch, say)
    try:
        harness.run(person.work, person.request(), engine_ends=True)
    except AssertionError:  # the person went first: all is done
        say("left")
    finally:
        live.close()
        rig.close()
        pipe.close()


class _Person:
    """Works at the rig, and is the chance by which faults come."""

    def __init__(
        self, plan: SittingPlan, harness: EngineHarness, watch: SafetyWatch, say: Say
    ) -> None:
        self._plan = plan
        self._harness = harness
        self._watch = watch
        self._say = say
        self._random = Random(f"{plan.seed} {plan.number}")
        self._committed = 0
        self._faults = {fault.name: fault for fault in FAULTS}
        self._first_part = 0
        self._unsafe_told = 0
        self._stopped_s = self._committed_s = 0.0
        self._present: Fault | None = None
        harness.engine.event_bus.subscribe(self._hear)

    def request(self) -> RunRequest:
        """Return the request that begins or continues the session."""
        folder = self._plan.folder
        paths = part_paths(folder) if existing_parts(folder) else []
        self._first_part = len(paths) + 1
        if paths:
            return RunRequest(resume=str(folder), yes=True)
        return RunRequest(protocol=str(self._plan.protocol), out=str(folder), yes=True)

    async def work(self, harness: EngineHarness) -> None:
        """Bring faults about and resume the run until it is complete."""
        self._say("running", harness.rig.loop.time())
        chance = asyncio.create_task(self._bring_faults())
        try:
            while not await self._look():
                await asyncio.sleep(TURN_S)
        finally:
            chance.cancel()

    def _hear(self, event: Event) -> None:
        if event.kind == "trial" and event.text.endswith("committed"):
            self._committed += 1
            self._committed_s = event.at_s
            self._say("committed")
            if self._committed % MEMORY_EVERY_TRIALS == 0:
                self._say("memory", self._committed, _memory_mib())
        elif event.kind == "trial" and "is given up" in event.text:
            self._say("event", "given up", event.text)
        elif event.kind in TOLD:
            self._say("event", event.kind, event.text)

    async def _look(self) -> bool:
        """Do what is to be done now; return whether the plan is complete."""
        harness, run = self._harness, self._harness.engine.run
        del harness.events[:-100]
        if run is None:
            return False
        on_disk = run._recorder.status.samples_on_disk
        self._say("on disk", self._first_part, on_disk, self._watch.most_g)
        for sentence in self._watch.unsafe[self._unsafe_told :]:
            self._say("event", "unsafe", sentence)
        self._unsafe_told = len(self._watch.unsafe)
        if run.ended and run.complete:
            self._say("ended", run.outcome, run.text)
            return True
        if harness.rig.loop.time() - self._committed_s > STUCK_AFTER_S:
            self._say("event", "stuck", f"no trial was committed for {STUCK_AFTER_S:g} s")
            return True
        waits = set(run.control.reasons) - BY_ITSELF
        is_stopped = (run.ended or bool(waits)) and self._present is None
        self._stopped_s = self._stopped_s + TURN_S if is_stopped else 0.0
        if self._stopped_s > LOOKS_AFTER_S:
            self._stopped_s = 0.0
            await (self._resume() if run.ended else self._clear(waits))
        return False

    async def _resume(self) -> None:
        run = self._harness.engine.run
        assert run is not None
        self._say("ended", run.outcome, run.text)
        try:
            self._harness.engine.start(self.request())
        except (RigctlError, OSError) as error:
            self._say("event", "refused", str(error))

    async def _clear(self, waits: set[str]) -> None:
        self._say("event", "attended", ", ".join(sorted(waits)))
        run, poller = self._harness.engine.run, self._harness.engine.boards.drum_poller
        assert run is not None
        if FAULT in waits and poller.connected:
            await poller.drum.command(Command.CLEAR)
        run.control.resume()

    async def _bring_faults(self) -> None:
        """Bring a fault about each so many trials, at any moment of the next one."""
        mean = self._plan.mean_trials
        while mean:
            due = self._committed + self._random.expovariate(1 / mean)
            while self._committed < due:
                await asyncio.sleep(TURN_S)
            await asyncio.sleep(self._random.uniform(0.0, WITHIN_S))
            fault = self._faults[self._random.choice(self._plan.faults)]
            self._say("fault", fault.name, self._state())
            self._present = fault
            fault.begin(self._harness)
            await asyncio.sleep(fault.lasts_s)
            fault.end(self._harness)
            self._present = None

    def _state(self) -> str:
        state = self._harness.engine.boards.drum_poller.state
        return State(state.state).name if state is not None else "-"


def _memory_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
