"""Moves of the virtual drum as a run commands them, without a wire or a wait between."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.config import RigConfig
from rigctl.errors import BoardFault
from rigctl.protocol import Settle
from rigctl.run.motion import FARTHEST_STEPS
from rigctl.values import PlannedTrial
from rigctl.wire.drum_map import Command, CommandResult, ForceMode
from rigctl.wire.drum_states import Fault, State
from rigctl.world.direct import DirectRig
from rigctl.world.glances import Glance

STEP_US = 50_000
"""Commands are given, and ends of moves seen, at these steps of world time."""

TURN_STEP_US = 100_000
"""The step while the drum is polled: 10 times a second."""

TURN_STEPS = 7
"""So many polls are looked at together; the board's ring of conversions holds 0.8 s."""

QUIET_STEPS = 40
"""So many are passed at once where nobody looks at each."""

LIMIT_US = 300_000_000
_FORCE_MODES = {
    "hold": ForceMode.HOLD,
    "lock": ForceMode.LOCK,
    "position": ForceMode.POSITION,
}


OnPolls = Callable[[list[Glance]], None]


class Operator:
    """Drives one drum. Every method ends when its move has. Raises BoardFault on a fault."""

    def __init__(self, rig: DirectRig, config: RigConfig, settle: Settle) -> None:
        self.rig = rig
        self._config = config
        self._homed = False
        self._wait_for(lambda: rig.state is State.IDLE, "booting")
        self._configure(settle)
        self._do(Command.ARM, State.ARMED)

    @property
    def now_us(self) -> int:
        """World time."""
        return self.rig.time_us

    def step(self, length_us: int = STEP_US, most: int = 1) -> None:
        """Let one step of world time pass, or up to so many in which nothing happens."""
        self.rig.pass_steps(length_us, most)
        fault = self.rig.board.controller.fault
        if fault is not Fault.NONE:
            raise BoardFault(f"the simulated drum stopped with {Fault(fault).name}")

    def wait(self, seconds: float, on_polls: OnPolls = lambda polls: None) -> None:
        """Let time pass; ``on_polls`` as in :meth:`turn`."""
        end_us = self.now_us + round(seconds * 1e6)
        self.rig.watch()
        while self.now_us < end_us:
            steps = -(-(end_us - self.now_us) // TURN_STEP_US)
            self.step(TURN_STEP_US, min(TURN_STEPS, steps))
            on_polls(self.rig.polls())
        self.rig.unwatch()

    def tare(self) -> None:
        """Zero the load cell, lifted and still."""
        self._give(Command.TARE)
        self._wait_for(lambda: self.rig.result is not CommandResult.RUNNING, "the tare")

    def prepare(self, trial: PlannedTrial) -> None:
        """Set-points of a trial, and the lifted move to where its run-in begins."""
        self._set_trial(trial)
        steps = self.rig.board.controller.turner.steps(self.now_us)
        target = self._nearest(self._start_steps(trial), steps)
        if not self._homed or abs(target) > FARTHEST_STEPS:
            self._do(Command.HOME, State.ARMED)
            self._homed = True
            steps = self.rig.board.controller.turner.steps(self.now_us)
            target = self._nearest(self._start_steps(trial), steps)
        self.rig.set(move_target=target)
        if target != steps:
            self._do(Command.MOVE, State.ARMED)

    def approach(self) -> None:
        """Press until the force has settled."""
        self._do(Command.APPROACH, State.HOLD)

    def press(self, force_g: float) -> None:
        """Approach with this force, whatever the trials ask for."""
        self.rig.set(force_set=force_g, force_mode=float(ForceMode.HOLD))
        self.approach()

    def turn(self, on_polls: OnPolls) -> None:
        """Run-in, window, ramp down; ``on_polls`` gets the polls since the last call, in time."""
        self._give(Command.RUN)
        self.rig.watch()
        self._wait_for(self._ended(State.HOLD), "the travel", lambda: on_polls(self.rig.polls()))
        self.rig.unwatch()

    def lift(self) -> None:
        """Lift off."""
        self._do(Command.RETRACT, State.ARMED)

    def _configure(self, settle: Settle) -> None:
        actuator, drum = self._config.actuator, self._config.drum
        self.rig.set(
            acceleration_set=drum.acceleration_mm_s2,
            run_in_set=drum.run_in_mm,
            move_speed_set=drum.rapid_mm_s,
            over_force=self._config.limits.over_force_g,
            lift_clearance_um=actuator.lift_clearance_mm * 1000,
            approach_limit_um=actuator.approach_limit_mm * 1000,
            approach_timeout_ms=settle.timeout_s * 1000,
            stiffness_g_per_mm=actuator.stiffness_g_per_mm,
            dead_band_permille=actuator.dead_band_permille,
            scale_ug_per_count=self._config.loadcell.scale_ug_per_count,
            clock_trim_ppm=round(self.rig.parameters.drum_clock_ppm),
            settle_band=settle.band_percent * 10,
            settle_time_ms=settle.time_s * 1000,
        )

    def _set_trial(self, trial: PlannedTrial) -> None:
        backward = (trial.direction == "backward") != self._config.drum.backwards
        mode = _FORCE_MODES[trial.force_mode]
        deep = mode is ForceMode.POSITION
        press = {"depth_set_um": trial.depth_mm * 1000} if deep else {"force_set": trial.force_g}
        self.rig.set(
            speed_set=trial.speed_mm_s,
            travel_set=trial.travel_mm + self._config.drum.sync_margin_mm,
            direction_set=float(backward),
            force_mode=float(mode),
            **press,
        )

    def _start_steps(self, trial: PlannedTrial) -> int:
        drum = self._config.drum
        start_mm = drum.plate_start_mm
        if trial.direction == "backward":
            start_mm += drum.plate_length_mm
        sign = -1 if drum.backwards else 1
        return sign * round(start_mm / self.rig.parameters.mm_per_step)

    def _nearest(self, within_turn: int, steps_now: int) -> int:
        turn = round(self.rig.parameters.steps_per_turn)
        return within_turn + turn * round((steps_now - within_turn) / turn)

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
            if on_step is None:
                self.step(most=QUIET_STEPS)
            else:
                self.step(TURN_STEP_US, TURN_STEPS)
                on_step()
