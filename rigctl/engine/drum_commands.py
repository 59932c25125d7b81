"""The commands of a drum's clients: moves, settings, records, calibrations, and the guided setup.

Commands that move the rig are refused during a run, and a run is refused during a move by hand;
stop never is. A STOP ends a calibration and a check of the setup, too.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import STATE_TEXT, State
from rigctl.config.rig_config import RigLimits
from rigctl.engine.calibration import Calibration
from rigctl.engine.contact import PRESSING_STATES, RESTING_STATES, is_left_in_contact
from rigctl.engine.engine import Engine
from rigctl.engine.engine_commands import EngineCommands
from rigctl.engine.motion import DrumMotion
from rigctl.engine.rpc.commands import (
    Amount,
    EngineCommand,
    NoteText,
    Number,
    PathText,
    Result,
    TextureName,
    Word,
    summary_of,
)
from rigctl.engine.run_queue import QueuedRun, Shift
from rigctl.engine.run_request import RunRequest
from rigctl.engine.setup.served_setup import ServedSetup
from rigctl.errors import WrongUse
from rigctl.session.session import ConditionEnd
from rigctl.values import DrumState

OPERATOR_SETTINGS = {
    "speed_mm_s": "speed_set",
    "force_g": "force_set",
    "acceleration_mm_s2": "acceleration_set",
    "travel_mm": "travel_set",
    "run_in_mm": "run_in_set",
}
"""Settings of an operator, with their registers. All others decide what a force means, what stops
the drum or how it is built; they come from ``rig.toml``, a protocol or a calibration."""


MOVES: dict[str, Callable[[DrumMotion], Awaitable[object]]] = {
    "arm": DrumMotion.arm,
    "disarm": DrumMotion.disarm,
    "tare": DrumMotion.tare,
    "home": DrumMotion.home,
    "approach": DrumMotion.approach,
    "run": DrumMotion.run,
    "retract": DrumMotion.lift,
}
"""Commands that move the rig without an argument."""


class NoArguments(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The arguments of a command without any."""


Magnitude = Annotated[float, Meta(ge=0, le=100_000)] | None
"""An operator's setting; the rig's limits are narrower."""
Note = Annotated[str, Meta(max_length=500, pattern=r"\A[^\x00-\x1f\x7f]*\Z")]
MAX_LOAD_G = 1e6
Mass = Annotated[float, Meta(ge=0, le=MAX_LOAD_G)]
Part = Literal["loadcell", "force", "imbalance", "wiring"]
SavedPart = Literal["loadcell", "force", "imbalance", "wiring", "range"]
AnswerText = Annotated[str, Meta(max_length=40)]


class DrumCommands(EngineCommands[Engine]):
    """Executes requests to the engine of a drum rig."""

    request_type = RunRequest

    def __init__(self, engine: Engine) -> None:
        super().__init__(engine, lambda: engine.rig.faults)

    @classmethod
    def declared_commands(cls) -> dict[str, EngineCommand]:
        """Return all commands by name."""
        moves = {
            name: EngineCommand(summary_of(move), NoArguments, _move(move))
            for name, move in MOVES.items()
        }
        enqueue = EngineCommand(summary_of(cls._enqueue), QueuedRun, cls._enqueue)
        return super().declared_commands() | moves | {"enqueue": enqueue}

    async def on_jog(self, mm: Annotated[float, Meta(ge=-10_000, le=10_000)]) -> Result:
        """Turn the lifted drum, forwards where ``mm`` is positive; return the true travel."""
        with self._by_hand() as motion:
            return {"moved_mm": await motion.jog(mm)}

    async def on_axis(self, height_mm: Annotated[float, Meta(ge=-1000, le=1000)]) -> Result:
        """Move the further axis to a height, with the drum off and lifted; return the height."""
        with self._by_hand():
            return {"height_mm": await self._engine.move_axis(height_mm)}

    async def on_set(
        self,
        speed_mm_s: Magnitude = None,
        force_g: Magnitude = None,
        acceleration_mm_s2: Magnitude = None,
        travel_mm: Magnitude = None,
        run_in_mm: Magnitude = None,
    ) -> Result:
        """Write an operator's settings; return the values that the board took.

        While the drum turns in contact, only the force can change: the travel keeps what it began
        with. Raises CommandRefused for the others.
        """
        given = (speed_mm_s, force_g, acceleration_mm_s2, travel_mm, run_in_mm)
        pairs = zip(OPERATOR_SETTINGS, given, strict=True)
        values = {name: value for name, value in pairs if value is not None}
        for name, value in values.items():
            _require_limits(name, value, self._engine.rig.config.limits)
        registers = {OPERATOR_SETTINGS[name]: value for name, value in values.items()}
        with self._by_hand() as motion:
            if registers.keys() - {"force_set"}:
                await motion.require_no_travel()
            written = await motion.poller.drum.set(**registers)
            motion.settings.update(written)
        return {name: written[OPERATOR_SETTINGS[name]] for name in values}

    async def on_note(self, text: NoteText) -> None:
        """Write a note with a time stamp on the session of the run."""
        self._engine.add_note(text)

    async def on_repeat(self, trial_id: Number, text: NoteText = "repeated") -> None:
        """Run a trial again while its plate is on; the attempt that counted is marked bad."""
        self._engine.repeat(trial_id, text)

    async def on_skip(self, trial_id: Number = 0) -> None:
        """Leave out a trial that is to come, or 0: the present one, whose attempt ends."""
        self._engine.skip(trial_id)

    async def on_end_condition(
        self,
        texture: TextureName,
        speed_mm_s: Amount,
        force_g: Amount,
        trials: Number,
        mean_hz: Amount,
        half_width_hz: Amount,
        depth_mm: Amount = 0.0,
    ) -> None:
        """End a condition of the run early, as the protocol's rule allows it."""
        values = (texture, speed_mm_s, force_g, depth_mm, trials, mean_hz, half_width_hz)
        self._engine.end_condition(ConditionEnd(*values))

    async def _enqueue(self, run: QueuedRun) -> Result:
        """Let a run wait in the queue; return its number."""
        return {"queued": self._engine.queue.add(run)}

    async def on_dequeue(self, number: Number) -> None:
        """Remove a run from the queue."""
        self._engine.queue.remove(number)

    async def on_move_queued(self, number: Number, places: Shift) -> None:
        """Move a run of the queue by places, backwards for a positive number."""
        self._engine.queue.move(number, places)

    async def on_start_queued(self) -> Result:
        """Start the first run of the queue."""
        return self._begin(self._engine.start_queued)

    async def on_stop(self, by: str) -> None:
        """Stop and lift immediately; a run ends."""
        await self._engine.send_stop(f"stopped by {by}")

    async def on_clear_fault(self) -> None:
        """Clear the latched fault, where its cause is gone."""
        await self._engine.rig.drum.command(Command.CLEAR)

    async def on_plate(self, texture: TextureName) -> Result:
        """Store which plate is mounted; a simulated rig mounts it itself."""
        self._refuse_during_run()
        _require_room(self._engine.boards.drum_poller.state)
        return {"changed": self._engine.set_plate(texture), "texture": texture}

    async def on_record(self, out: PathText, note: Note = "") -> Result:
        """Record operation by hand into the new folder ``out``, without trials."""
        self._refuse_during_run()
        try:
            return {"session": str(self._engine.record_by_hand(Path(out), note))}
        except OSError as error:  # a name that the file system does not take, a folder not ours
            raise WrongUse(
                f"{error.filename}: {error.strerror}: choose another folder to record into"
            ) from error

    async def on_end_record(self) -> Result:
        """End the recording by hand."""
        return {"session": str(self._engine.manual.end())}

    async def on_calibrate_range(self, force_g: Mass = 500.0) -> Result:
        """Press, turn over the plate once, lift, and encode with the range that each taxel had."""
        return dict((await self._calibration().measure_range(force_g))._asdict())

    async def on_test_taxels(self) -> Result:
        """Start the taxel board's self-test; return one sentence per finding."""
        self._refuse_during_run()
        taxels = self._engine.boards.taxels
        await taxels.test()
        return {"found": taxels.findings}

    async def on_calibrate_loadcell(self, mass_g: Mass) -> Result:
        """Read the lifted load cell with a known mass, 0 g first; return counts and spread."""
        return dict((await self._calibration().read_mass(mass_g))._asdict())

    async def on_forget_mass(self, mass_g: Mass) -> None:
        """Remove a reading of the load cell from the calibration."""
        self._calibration().forget_mass(mass_g)

    async def on_calibrate_force(self, force_g: Mass = 500.0) -> Result:
        """Press, make a small step, lift, and return the gains of the force loop that fit."""
        return dict((await self._calibration().tune_gains(force_g))._asdict())

    async def on_calibrate_imbalance(self) -> Result:
        """Turn the lifted drum once; return the load cell's error of each sixteenth of a turn."""
        return {"table_g": await self._calibration().measure_imbalance()}

    async def on_calibrate_wiring(self) -> Result:
        """Measure what the present step of the identification of the taxels asks for."""
        return {"found": await self._calibration().take_wiring_step()}

    async def on_repeat_press(self) -> None:
        """Ask for the last place of the identification again."""
        self._calibration().undo_press()

    async def on_save_calibration(self, part: SavedPart) -> Result:
        """Save what was measured on the board and in ``rig.toml``; return where."""
        calibration = self._calibration()
        if self._engine.manual.is_recording:
            raise WrongUse("a recording by hand goes on: end it first, then save the calibration")
        places, remark = await calibration.save(part)
        return {"part": part, "kept_in": places, "remark": remark}

    async def on_discard_calibration(self, part: Part) -> None:
        """Forget what was measured; the board uses its imbalance table from before."""
        await self._calibration().discard(part)

    async def on_cancel_calibration(self) -> None:
        """End the measurement; the drum is lifted and switched off."""
        self._engine.calibration.measurement.cancel()

    async def on_setup_open(self) -> Result:
        """Read how far the setup has come; return a remark for each part to check again."""
        return {"remarks": self._opened_setup().open()}

    async def on_setup_check(self, part: Word) -> Result:
        """Check a part of the rig; meanwhile its questions are answered by ``setup_answer``."""
        verdict = await self._opened_setup().check(part)
        return {"part": part, "passed": verdict.passed, "problem": verdict.problem}

    async def on_setup_answer(self, question_id: Number, text: AnswerText = "") -> None:
        """Answer a question of the check; an empty text takes the one of a simulated bench."""
        self._engine.setup.answer(question_id, text)

    async def on_setup_keep(self, part: Word) -> Result:
        """Let ``rig.toml`` describe a part as it is wired, where the check offers that."""
        return {"part": part, "says": await self._opened_setup().keep(part)}

    async def on_setup_begin_again(self) -> None:
        """Forget which parts have passed."""
        self._opened_setup().begin_again()

    async def on_setup_commission(self) -> Result:
        """Commission the board without checks; return the parts that nobody has checked."""
        return {"not_checked": await self._opened_setup().commission()}

    def _calibration(self) -> Calibration:
        """Return the calibrations. Raises WrongUse during a run and during a move by hand."""
        self._refuse_during_run()
        self._engine.calibration.measurement.require_none()
        if self._engine.boards.motion.is_moved_by_hand:
            raise WrongUse("the drum is moved by hand: wait until that has ended, then calibrate")
        return self._engine.calibration

    def _opened_setup(self) -> ServedSetup:
        """Return the setup. Raises WrongUse during a run and during a move by hand."""
        self._refuse_during_run()
        if self._engine.manual.is_recording:
            raise WrongUse("a recording by hand goes on: end it first, then set the rig up")
        self._calibration()
        return self._engine.setup

    def _by_hand(self) -> AbstractContextManager[DrumMotion]:
        """Hold the drum's motion against a run that would begin. Raises WrongUse during a run.

        A calibration moves the drum itself, so it is refused meanwhile, too.
        """
        self._refuse_during_run()
        self._engine.calibration.measurement.require_none()
        if self._engine.rig.axis is not None and self._engine.rig.axis.is_moving:
            raise WrongUse("the further axis moves: wait until it stands, or stop it")
        return self._engine.boards.motion.by_hand()


def _move(
    move: Callable[[DrumMotion], Awaitable[object]],
) -> Callable[[DrumCommands, Any], Awaitable[None]]:
    """Return what executes a move of the drum."""

    async def execute(handler: DrumCommands, _: Any) -> None:
        with handler._by_hand() as motion:
            await move(motion)

    return execute


def _require_room(drum: DrumState | None) -> None:
    """Raise WrongUse where the drum moves or presses, so that nobody can change its plate."""
    if drum is None:
        return
    if drum.state in PRESSING_STATES or is_left_in_contact(drum):
        raise WrongUse("the plate cannot change while the drum is in contact: lift the drum first")
    if drum.state not in RESTING_STATES:
        raise WrongUse(
            f"the plate cannot change now ({STATE_TEXT[State(drum.state)]}): "
            "wait until the drum stands still"
        )


def _require_limits(name: str, value: float, limits: RigLimits) -> None:
    """Raise WrongUse for a setting outside this rig's limits."""
    bounds = {
        "speed_mm_s": (limits.speed_min_mm_s, limits.speed_max_mm_s),
        "force_g": (limits.force_min_g, limits.force_max_g),
    }
    low, high = bounds.get(name, (0.0, math.inf))
    if not low <= value <= high:
        raise WrongUse(
            f"{name} {value:g} is outside this rig's limits, {low:g} to {high:g}: choose one "
            "within them, or change [limits] in rig.toml"
        )
