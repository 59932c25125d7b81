"""The commands that set a drum rig up, refused during a run; a STOP ends a check."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from rigctl.acquisition.rpc.arguments import Number, Word
from rigctl.acquisition.rpc.calibration_commands import CalibrationCommands
from rigctl.acquisition.rpc.declared_commands import Result
from rigctl.acquisition.setup.desk import SetupDesk
from rigctl.errors import WrongUse

AnswerText = Annotated[str, Meta(max_length=40)]


class SetupCommands(CalibrationCommands):
    """Executes the requests of the setup; a drum's commands add the others."""

    async def on_setup_open(self) -> Result:
        """Read how far the setup has come; return a remark for each part to check again."""
        return {"remarks": self._desk().open()}

    async def on_setup_check(self, part: Word) -> Result:
        """Check a part of the rig; meanwhile its questions are answered by ``setup_answer``."""
        verdict = await self._desk().check(part)
        return {"part": part, "passed": verdict.passed, "problem": verdict.problem}

    async def on_setup_answer(self, question_id: Number, text: AnswerText = "") -> None:
        """Answer a question of the check; an empty text takes the one of a simulated bench."""
        self._engine.setup.answer(question_id, text)

    async def on_setup_keep(self, part: Word) -> Result:
        """Let ``rig.toml`` describe a part as it is wired, where the check offers that."""
        return {"part": part, "says": await self._desk().keep(part)}

    async def on_setup_begin_again(self) -> None:
        """Forget which parts have passed."""
        self._desk().begin_again()

    async def on_setup_commission(self) -> Result:
        """Commission the board without checks; return the parts that nobody has checked."""
        return {"not_checked": await self._desk().commission()}

    def _desk(self) -> SetupDesk:
        """Return the setup. Raises WrongUse during a run and during a move by hand."""
        self._refuse_during_run()
        if self._engine.manual.is_recording:
            raise WrongUse("a recording by hand goes on: end it first, then set the rig up")
        self._calibration()
        return self._engine.setup
