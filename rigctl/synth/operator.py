"""Drive the simulated drum through a run's moves, without a cable and without waiting."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.acquisition.drum.settings import (
    MAX_TARGET_STEPS,
    nearest_steps,
    press_settings,
    rig_settings,
    settle_settings,
    trial_settings,
    trial_start_steps,
)
from rigctl.config.rig_config import RigConfig
from rigctl.errors import BoardFault
from rigctl.protocol.plan import Settle
from rigctl.simulation.direct_rig import POLL_MS, DirectRig
from rigctl.values import DrumState, PlannedTrial
from rigctl.wire.drum.codes import Command, CommandResult
from rigctl.wire.drum.states import Fault, State

MAX_STEP_US = 700_000
"""Longest time between two reads of the polls; the board's ring of conversions holds 0.8 s."""

UNPOLLED_STEP_US = 10_000_000
"""Longest simulated step without polling."""

TIMEOUT_US = 300_000_000
OnPolls = Callable[[list[DrumState]], None]


class DrumOperator:
    """Drives one drum. Every method returns when its move has ended. Raises BoardFault."""

    def __init__(self, rig: DirectRig, config: RigConfig, settle: Settle) -> None:
        self.rig = rig
        self._config = config
        self._homed = False
        self._wait_until(lambda: rig.state is State.IDLE, "booting")
        rig.write_settings(
            **rig_settings(config),
            **settle_settings(settle),
            clock_trim_ppm=round(rig.parameters.drum_clock_ppm),
        )
        self._send(Command.COMMISSION)
        self._wait_until(lambda: rig.result is not CommandResult.RUNNING, "keeping the settings")
        self._run_command(Command.ARM, State.ARMED)

    def wait(self, seconds: float, on_polls: OnPolls = lambda polls: None) -> None:
        """Let time pass; ``on_polls`` as in :meth:`run_window`."""
        end_us = self.rig.time_us + round(seconds * 1e6)
        self.rig.start_polling()
        while self.rig.time_us < end_us:
            self._advance(min(end_us, self.rig.time_us + MAX_STEP_US))
            on_polls(self.rig.take_polls())
        self.rig.stop_polling()

    def tare(self) -> None:
        """Tare the load cell, lifted and at rest."""
        self._send(Command.TARE)
        self._wait_until(lambda: self.rig.result is not CommandResult.RUNNING, "the tare")

    def prepare(self, trial: PlannedTrial) -> None:
        """Write a trial's set-points and move, lifted, to the start of its run-in."""
        self.rig.write_settings(**trial_settings(trial, self._config.drum))
        steps, target = self._start(trial)
        if not self._homed or abs(target) > MAX_TARGET_STEPS:
            self._run_command(Command.HOME, State.ARMED)
            self._homed = True
            steps, target = self._start(trial)
        self.rig.write_settings(move_target=target)
        if target != steps:
            self._run_command(Command.MOVE, State.ARMED)

    def approach(self) -> None:
        """Press until the force has settled."""
        self._run_command(Command.APPROACH, State.HOLD)

    def press(self, force_g: float) -> None:
        """Approach with this force instead of a trial's."""
        self.rig.write_settings(**press_settings(force_g))
        self.approach()

    def run_window(self, on_polls: OnPolls) -> None:
        """Run in, pass the window and ramp down; ``on_polls`` gets the polls at intervals."""
        self._send(Command.RUN)
        # The run-in takes at least its length over the speed; until then nothing needs polling.
        run_in_us = self.rig.read("run_in_set") / self.rig.read("speed_set") * 1e6
        self._advance(self.rig.time_us + round(run_in_us) - MAX_STEP_US, stop_on_change=False)
        self.rig.start_polling()
        self._wait_until(
            self._has_ended(State.HOLD), "the travel", lambda: on_polls(self.rig.take_polls())
        )
        # The last poll shows the closed window, however short the ramp down was.
        self._advance(self.rig.time_us + 1000 * POLL_MS)
        on_polls(self.rig.take_polls())
        self.rig.stop_polling()

    def lift(self) -> None:
        """Lift off."""
        self._run_command(Command.RETRACT, State.ARMED)

    def _start(self, trial: PlannedTrial) -> tuple[int, int]:
        """Return the drum's present position and the start of the run-in, steps."""
        p, steps_now = self.rig.parameters, int(self.rig.read("steps"))
        within_turn = trial_start_steps(trial, self._config.drum, p.mm_per_step)
        return steps_now, nearest_steps(within_turn, steps_now, round(p.steps_per_turn))

    def _send(self, command: Command) -> None:
        if not self.rig.command(command):
            raise BoardFault(f"the simulated drum refused {command.name} in {self.rig.state.name}")

    def _run_command(self, command: Command, end: State) -> None:
        self._send(command)
        self._wait_until(self._has_ended(end), command.name)

    def _has_ended(self, end: State) -> Callable[[], bool]:
        return lambda: self.rig.state is end and self.rig.result is not CommandResult.RUNNING

    def _wait_until(
        self, ended: Callable[[], bool], what: str, on_step: Callable[[], None] | None = None
    ) -> None:
        deadline_us = self.rig.time_us + TIMEOUT_US
        while not ended():
            if self.rig.time_us > deadline_us:
                raise BoardFault(f"the simulated drum did not end {what}")
            self._advance(self.rig.time_us + (MAX_STEP_US if on_step else UNPOLLED_STEP_US))
            if on_step is not None:
                on_step()

    def _advance(self, until_us: int, stop_on_change: bool = True) -> None:
        """Advance to a time, or until a move ends. Raises BoardFault on a fault."""
        self.rig.advance(until_us, stop_on_change)
        if self.rig.fault is not Fault.NONE:
            raise BoardFault(f"the simulated drum stopped with {self.rig.fault.name}")
