"""Every fault in every state of the drum: what the user saw, what was lost, whether it was safe.

``python -m tests.endurance.matrix PAGE`` tries all and writes the table into the page.
"""

from __future__ import annotations

import asyncio
import math
import re
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.boards.drum_states import State
from rigctl.engine import served_engine
from rigctl.rig import open_rig
from rigctl.session.verify import verify
from tests.endurance.faults import FAULTS, Fault, heal_disk
from tests.endurance.page import fill_page
from tests.endurance.safety_watch import SafetyWatch
from tests.engine.engine_harness import EngineHarness, engine_on, open_session

STATES = (
    State.IDLE,
    State.ARMED,
    State.POSITION,
    State.APPROACH,
    State.HOLD,
    State.RUN,
    State.RETRACT,
    State.FAULT_LIFT,
    State.FAULT_OFF,
)
"""All that a run passes; the drum is switched off in a pause. BOOT and SELFTEST last 0.3 s after a
reset, and NUDGE is a state of the set-up."""
AFTER_FAULT = (State.FAULT_LIFT, State.FAULT_OFF)
UNCLOSED = "was not closed properly"
"""What a part lacks until the session is resumed, where the recorder failed."""
STALL_S = 0.4
LOOKS_S = 150.0
"""By then a run has gone on by itself, or waits for somebody."""
SEEN = ("fault", "link", "disk", "late", "pause", "board", "check")
PROTOCOL = """
name = "faults"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 2

[trial]
travel_mm = 120
"""


@dataclass(frozen=True, slots=True)
class Cell:
    """``saw``: the first thing that the user was told; ``attempts``: how many were lost.

    ``end``: ``-`` the run went on to its end by itself, ``E`` it ended for somebody to look, ``X``
    the engine ended, ``W`` it waits. ``problems``: unsafe states and what the session lacks.
    """

    saw: str
    attempts: int
    end: str
    problems: tuple[str, ...]

    @property
    def code(self) -> str:
        """The cell of the table."""
        lost = str(self.attempts) if self.attempts else ""
        return f"{lost}{'' if self.end == '-' else self.end}" or "·"


def try_fault(fault: Fault, state: State, folder: Path) -> Cell:
    """Bring a fault about in a state of the first trial; return what came of it."""
    folder.mkdir(parents=True)
    with engine_on(open_rig("virtual", seed=3, paced=False), folder) as harness:
        watch = SafetyWatch(harness.rig)
        scene = _Scene(fault, state)
        idle_s, served_engine.IDLE_TIMEOUT_S = served_engine.IDLE_TIMEOUT_S, math.inf
        try:
            stays = harness.engine.loop.run_until_complete(
                harness._run(scene.play, harness.request(PROTOCOL))
            )
        finally:
            served_engine.IDLE_TIMEOUT_S = idle_s
            heal_disk()
        run = harness.engine.run
        assert run is not None
        with open_session(harness.session) as session:
            ids = session.trials["trial_id"][session.committed()].tolist()
            attempts = len(session.trials) - len(ids)
        end = scene.end if stays else "X"
        lacks = [line for line in verify(harness.session).problems if UNCLOSED not in line]
        twice = [f"trial {one} is committed twice" for one in set(ids) if ids.count(one) > 1]
        problems = (*watch.unsafe, *lacks, *twice)
        saw = scene.saw(harness) or "nothing"
    return Cell(saw, attempts, end, problems)


class _Scene:
    """What a person does and sees while a fault comes and goes."""

    def __init__(self, fault: Fault, state: State) -> None:
        self._fault = fault
        self._state = state
        self._first_event = 0
        self.end = "-"

    async def play(self, harness: EngineHarness) -> None:
        """Wait for the state, bring the fault about, and look what comes of it."""
        run = harness.engine.run
        assert run is not None
        await self._reach(harness)
        self._first_event = len(harness.events)
        self._fault.begin(harness)
        await asyncio.sleep(self._fault.lasts_s)
        self._fault.end(harness)
        if self._state is State.IDLE:
            await asyncio.sleep(5.0)
            run.control.resume()
        end_s = harness.rig.loop.time() + LOOKS_S
        while not run.ended and harness.rig.loop.time() < end_s:
            await asyncio.sleep(0.5)
        self.end = "W" if not run.ended else "-" if run.complete else "E"

    async def _reach(self, harness: EngineHarness) -> None:
        run, poller = harness.engine.run, harness.engine.boards.drum_poller
        assert run is not None

        async def until(state: State) -> None:
            await harness.until(lambda: poller.state is not None and poller.state.state == state)

        if self._state is State.IDLE:
            await until(State.RUN)
            run.control.pause()
        if self._state in AFTER_FAULT:
            await until(State.RUN)
            harness.rig.faults.stall_computer(STALL_S)
        await until(self._state)

    def saw(self, harness: EngineHarness) -> str:
        """Return the first sentence that the user read."""
        told = (e.text for e in harness.events[self._first_event :] if e.kind in SEEN)
        sentence = re.sub(r"^(drum|taxels): |/\S*/", "", next(told, ""))
        return re.split(r"[:;(]", sentence, maxsplit=1)[0].strip()


def described(fault: Fault, cells: Sequence[Cell]) -> str:
    """Return the row of a fault."""
    saw = list(dict.fromkeys(cell.saw for cell in cells if cell.saw != "nothing")) or ["nothing"]
    safe = "yes" if not any(cell.problems for cell in cells) else "**no**"
    codes = " | ".join(cell.code for cell in cells)
    return f"| {fault.name} | {codes} | {'; '.join(saw[:3])} | {safe} |"


def heading() -> str:
    """Return the head of the table."""
    states = " | ".join(state.name for state in STATES)
    return f"| fault | {states} | the user saw | safe, whole |\n|---{'|---' * (len(STATES) + 2)}|"


def main(arguments: Sequence[str]) -> int:
    """Try all, print the table, write it into the page; return 1 where something was unsafe."""
    rows, problems = [heading()], []
    print(rows[0], flush=True)
    for number, fault in enumerate(FAULTS):
        with tempfile.TemporaryDirectory() as folder:
            places = [Path(folder) / state.name for state in STATES]
            pairs = zip(STATES, places, strict=True)
            cells = [try_fault(fault, state, place) for state, place in pairs]
        rows.append(described(fault, cells))
        print(rows[-1], flush=True)
        problems += [f"{number}: {fault.name}: {p}" for cell in cells for p in cell.problems]
    print("\n".join(problems))
    if arguments:
        fill_page(Path(arguments[0]), "faults", "\n".join(rows))
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
