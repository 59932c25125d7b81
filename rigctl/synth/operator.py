"""Moves of the virtual drum as a run commands them, without a wire or a wait between."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.acquisition.drum.settings import (
    FARTHEST_STEPS,
    nearest,
    press_settings,
    rig_settings,
    settle_settings,
    start_steps,
    trial_settings,
)
from rigctl.config.rig_config import RigConfig
from rigctl.errors import BoardFault
from rigctl.protocol import Settle
from rigctl.simulation.direct_rig import POLL_MS, DirectRig
from rigctl.values import DrumState, PlannedTrial
from rigctl.wire.drum.codes import Command, CommandResult
from rigctl.wire.drum.states import Fault, State

TURN_US = 700_000
"""The longest time between two looks at the polls; the board's ring of conversions holds 0.8 s."""

QUIET_US = 10_000_000
"""The same where nobody looks at polls."""

LIMIT_US = 300_000_000
OnPolls = Callable[[list[DrumState]], None]


class Operator:
    """Drives one drum. Every method ends when its move has. Raises BoardFault on a fault."""

    def __init__(self, rig: DirectRig, config: RigConfig, settle: Settle) -> None:
        self.rig = rig
        self._config = config
        self._homed = False
        self._wait_for(lambda: rig.state is State.IDLE, "booting")
        rig.set(
            **rig_settings(config),
            **settle_settings(settle),
            clock_trim_ppm=round(rig.parameters.drum_clock_ppm),
        )
        self._do(Command.ARM, State.ARMED)

    @property
    def now_us(self) -> int:
        """World time."""
        return self.rig.time_us

    def wait(self, seconds: float, on_polls: OnPolls = lambda polls: None) -> None:
        """Let time pass; ``on_polls`` as in :meth:`turn`."""
        end_us = self.now_us + round(seconds * 1e6)
        self.rig.watch()
        while self.now_us < end_us:
            self._pass_time(min(end_us, self.now_us + TURN_US))
            on_polls(self.rig.polls())
        self.rig.unwatch()

    def tare(self) -> None:
        """Zero the load cell, lifted and still."""
        self._give(Command.TARE)
        self._wait_for(lambda: self.rig.result is not CommandResult.RUNNING, "the tare")

    def prepare(self, trial: PlannedTrial) -> None:
        """Set-points of a trial, and the lifted move to where its run-in begins."""
        self.rig.set(**trial_settings(trial, self._config.drum))
        steps, target = self._start(trial)
        if not self._homed or abs(target) > FARTHEST_STEPS:
            self._do(Command.HOME, State.ARMED)
            self._homed = True
            steps, target = self._start(trial)
        self.rig.set(move_target=target)
        if target != steps:
            self._do(Command.MOVE, State.ARMED)

    def approach(self) -> None:
        """Press until the force has settled."""
        self._do(Command.APPROACH, State.HOLD)

    def press(self, force_g: float) -> None:
        """Approach with this force, whatever the trials ask for."""
        self.rig.set(**press_settings(force_g))
        self.approach()

    def turn(self, on_polls: OnPolls) -> None:
        """Run-in, window, ramp down; ``on_polls`` gets the polls since the last call, in time."""
        self._give(Command.RUN)
        # At its speed a drum needs so long for the run-in, or longer: until then nothing is polled.
        run_in_us = self.rig.get("run_in_set") / self.rig.get("speed_set") * 1e6
        self._pass_time(self.now_us + round(run_in_us) - TURN_US, stop_on_change=False)
        self.rig.watch()
        self._wait_for(self._ended(State.HOLD), "the travel", lambda: on_polls(self.rig.polls()))
        # The last poll shows the window closed, however short the ramp down was.
        self._pass_time(self.now_us + 1000 * POLL_MS)
        on_polls(self.rig.polls())
        self.rig.unwatch()

    def lift(self) -> None:
        """Lift off."""
        self._do(Command.RETRACT, State.ARMED)

    def _start(self, trial: PlannedTrial) -> tuple[int, int]:
        """Where the drum stands and where the run-in begins, steps."""
        p, steps_now = self.rig.parameters, int(self.rig.get("steps"))
        within_turn = start_steps(trial, self._config.drum, p.mm_per_step)
        return steps_now, nearest(within_turn, steps_now, round(p.steps_per_turn))

    def _give(self, command: Command) -> None:
        if not self.rig.command(command):
            raise BoardFault(f"the simulated drum refused {command.name} in {self.rig.state.name}")

    def _do(self, command: Command, end: State) -> None:
        self._give(command)
        self._wait_for(self._ended(end), command.name)

    def _ended(self, end: State) -> Callable[[], bool]:
        return lambda: self.rig.state is end and self.rig.result is not CommandResult.RUNNING

    def _wait_for(
        self,
        ended: Callable[[], bool],
        what: str,
        on_step: Callable[[], None] | None = None,
    ) -> None:
        late_us = self.now_us + LIMIT_US
        while not ended():
            if self.now_us > late_us:
                raise BoardFault(f"the simulated drum did not end {what}")
            self._pass_time(self.now_us + (TURN_US if on_step else QUIET_US))
            if on_step is not None:
                on_step()

    def _pass_time(self, until_us: int, stop_on_change: bool = True) -> None:
        """Let time pass until then, or until a move ends."""
        self.rig.pass_time(until_us, stop_on_change)
        if self.rig.fault is not Fault.NONE:
            raise BoardFault(f"the simulated drum stopped with {self.rig.fault.name}")
