"""The setup of an engine: a client checks one part at a time and answers its questions."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace

from rigctl.boards.drum_codes import Status
from rigctl.engine.calibration import Measurement
from rigctl.engine.calibrator import Calibrator
from rigctl.engine.contact import PRESSING_STATES, has_status
from rigctl.engine.motion import DrumMotion
from rigctl.engine.rig import Rig
from rigctl.engine.setup.check_result import CheckResult, Question
from rigctl.engine.setup.context import SetupContext
from rigctl.engine.setup.progress import COMMISSION
from rigctl.engine.setup.setup import Setup, SetupStep
from rigctl.engine.setup.setup_status import PartStatus, SetupStatus
from rigctl.errors import CommandRefused, WrongUse

SETUP = "setup"
NOT_OPEN = "the setup is not open: open it first"


class ServedSetup:
    """Checks with the boards of one engine. ``today`` returns the date."""

    def __init__(
        self, rig: Rig, motion: DrumMotion, measurement: Measurement, today: Callable[[], str]
    ) -> None:
        self._rig, self._motion, self._measurement = rig, motion, measurement
        self._bench = SetupContext(rig, Calibrator(rig, motion), self._ask, today)
        self._setup: Setup | None = None
        self._checking = ""
        self._question: Question | None = None
        self._question_id, self._known = 0, ""
        self._answer: asyncio.Future[str] | None = None

    def open(self) -> tuple[str, ...]:
        """Read how far the setup has come; return a sentence for each part to check again.

        Raises WrongUse where the progress is another board's.
        """
        self._measurement.require_none()
        progress = self._bench.progress()
        self._setup = Setup(self._bench, progress)
        return tuple(progress.remarks)

    async def check(self, part: str) -> CheckResult:
        """Check a part; a client answers the questions meanwhile."""
        setup = self._ready()
        self._checking = setup.step(part).name
        try:
            return await self._measurement.run(SETUP, setup.check(part))
        finally:
            self._checking, self._question, self._answer = "", None, None

    def answer(self, question_id: int, text: str) -> None:
        """Answer the present question. Raises WrongUse for another and for an impossible answer."""
        question, answer = self._question, self._answer
        if question is None or answer is None or question_id != self._question_id:
            raise WrongUse(f"question {question_id} is not asked now")
        checked = question.checked(text or self._known)
        if not answer.done():
            answer.set_result(checked)

    async def keep(self, part: str) -> str:
        """Let ``rig.toml`` describe a part as it is wired; return what it says."""
        return await self._measurement.run(SETUP, self._ready().keep(part))

    def begin_again(self) -> None:
        """Forget which parts have passed."""
        self._ready().begin_again()

    async def commission(self) -> tuple[str, ...]:
        """Commission the board at once; return the titles of the parts that nobody checked."""
        return await self._measurement.run(SETUP, self._ready().commission_without())

    def status(self) -> SetupStatus:
        """Return what clients see."""
        setup, question = self._setup, self._question
        if setup is None:
            return SetupStatus()
        parts = (_part(setup, step) for step in setup.steps)
        state = self._motion.poller.state
        if state is not None and not has_status(state, Status.COMMISSIONED):
            parts = (_not_commissioned(part) for part in parts)
        return SetupStatus(
            tuple(parts),
            self._checking,
            self._question_id,
            question.text if question else "",
            question.choices if question else (),
            question.unit if question else "",
            self._known if question else "",
            tuple(setup.progress.remarks),
            question.picture if question else "",
        )

    def _ready(self) -> Setup:
        """Return the setup. Raises WrongUse before it is open and while something is measured."""
        if self._setup is None:
            raise WrongUse(NOT_OPEN)
        self._measurement.require_none()
        state = self._motion.poller.state
        if state is not None and state.state in PRESSING_STATES:
            raise CommandRefused("the drum presses on the sensor: retract it, then check")
        return self._setup

    async def _ask(self, question: Question) -> str:
        """Wait for a client's answer; a simulated bench does by itself what is asked."""
        self._known = self._rig.answer(question.key, question.low)
        self._answer = self._rig.loop.create_future()
        self._question, self._question_id = question, self._question_id + 1
        try:
            return await self._answer
        finally:
            self._question = None


def _not_commissioned(part: PartStatus) -> PartStatus:
    """Return the part as it stands since something else has changed what the board is bound to."""
    is_lost = part.name == COMMISSION and part.state == "right"
    return replace(part, state="open") if is_lost else part


def _part(setup: Setup, step: SetupStep) -> PartStatus:
    result, passed = setup.results.get(step.name), setup.progress.passed.get(step.name)
    state = "right" if passed else "open" if result is None else "wrong"
    if result is None:
        found = f"{passed.found} ({passed.day})" if passed else ""
        return PartStatus(step.name, step.title, step.picture, state, found=found)
    remedy = result.remedy.text if result.remedy else ""
    words = result.expected, result.found, result.problem, remedy
    return PartStatus(step.name, step.title, step.picture, state, *words)
