"""Setups of simulated rigs, wired as drawn or wrongly, with the bench's own hands."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from rigctl.config.rig_config import RigConfig
from rigctl.engine.calibrator import Calibrator, calibrate_alone
from rigctl.engine.rig import Rig
from rigctl.engine.setup.boards import find_boards
from rigctl.engine.setup.check_result import CheckResult, Question
from rigctl.engine.setup.context import SetupContext
from rigctl.engine.setup.progress import PassedStep
from rigctl.engine.setup.setup import Setup, SetupStep
from rigctl.errors import RigFault
from rigctl.rig import open_rig

SEED = 5
DAY = "2026-01-02"


@dataclass
class SimulatedSetup:
    """One setup with what it asked, and the first part that was wrong.

    ``answers`` replaces answers of the bench's hands by the question's key.
    """

    rig: Rig
    answers: dict[str, str] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)
    step: SetupStep | None = None
    wrong: CheckResult | None = None
    peak_g: float = 0.0
    """Largest true contact force before the setup had passed."""

    def run(self, work: Callable[[Setup], Awaitable[None]]) -> None:
        """Connect the boards and do the work with the setup of the rig."""

        async def connected(calibrator: Calibrator) -> None:
            await self.rig.taxels.connect()
            context = SetupContext(self.rig, calibrator, self.ask, lambda: DAY)
            await work(Setup(context, context.progress()))

        self.rig.loop.run_until_complete(calibrate_alone(self.rig, connected))
        self.note_force()

    def run_through(self) -> None:
        """Take all steps until one is wrong or the boards cannot be reached."""

        async def steps(setup: Setup) -> None:
            while (step := setup.next) is not None and self.wrong is None:
                self.step = step
                result = await setup.check(step.name)
                if not result.passed:
                    self.wrong = result

        try:
            self.run(steps)
        except RigFault:
            if self.step is not None:
                raise
            self.wrong = self.rig.loop.run_until_complete(find_boards(self.rig))
        self.note_force()

    def run_part(self, name: str) -> CheckResult:
        """Return the result of one part, as if all before it had passed."""
        results: list[CheckResult] = []

        async def step(setup: Setup) -> None:
            for earlier in setup.steps:
                setup.progress.passed[earlier.name] = PassedStep(DAY, "")
            results.append(await setup.check(name))

        self.run(step)
        return results[0]

    async def ask(self, question: Question) -> str:
        """Answer as the bench's hands do."""
        self.asked.append(question.key)
        self.note_force()
        known = self.rig.answer(question.key, question.low)
        return question.checked(self.answers.get(question.key, known))

    def note_force(self) -> None:
        """Take the bench's record of the contact force so far."""
        rows = self.rig.simulation.truth.take()
        self.peak_g = max(self.peak_g, float(rows.force_g.max(initial=0.0)))


@contextmanager
def simulated_setup(
    wiring: str = "", kind: str = "virtual", config: RigConfig | None = None
) -> Iterator[SimulatedSetup]:
    """Open a rig that is wired as the catalogue says, and not commissioned."""
    rig = open_rig(kind, seed=SEED, paced=False, config=config)
    rig.commissions = False
    if wiring:
        rig.faults.wire(wiring)
    asyncio.set_event_loop(rig.loop)
    try:
        yield SimulatedSetup(rig)
    finally:
        asyncio.set_event_loop(None)
        rig.close()
