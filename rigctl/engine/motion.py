"""Drum motion: each method sends one command and waits until the board has finished it.

Every wait calls ``check``, so that a pause or a stop ends it at the next cycle of the poll loop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final, Self

from rigctl.boards.drum_codes import Command, CommandResult, Status
from rigctl.boards.drum_states import STATE_TEXT, State
from rigctl.config.rig_config import RigConfig
from rigctl.engine.contact import PRESSING_STATES, has_status
from rigctl.engine.poller import DrumPoller
from rigctl.engine.settings import (
    GUARDED_SETTINGS,
    MAX_TARGET_STEPS,
    jog_target_steps,
    nearest_steps,
    rig_settings,
    trial_start_steps,
    way_to_window_mm,
)
from rigctl.errors import CommandRefused, RigFault, WrongUse
from rigctl.values import DrumState, PlannedTrial

SELF_TEST_TIMEOUT_S = 10.0
LIFT_TIMEOUT_S = 40.0
TARE_TIMEOUT_S = 10.0
COMMISSION_TIMEOUT_S = 5.0
NUDGE_TIMEOUT_S = 10.0
HOME_TIMEOUT_S = 120.0
MOVE_TIMEOUT_S = 600.0
APPROACH_EXTRA_S = 20.0
"""Longest search for the contact at 80 samples a second; a slower load cell needs longer."""
TRAVEL_EXTRA_S, TRAVEL_FACTOR = 10.0, 1.5
TRAVEL = "the travel"
TRIM_STEP_PPM = 10

STARTING_STATES: Final = (State.BOOT, State.SELFTEST)
LIFTED_STATES: Final = (State.ARMED, State.IDLE)
SHOWN_SETTINGS: Final = ("speed_set", "force_set", "acceleration_set", "travel_set", "run_in_set")


class DrumMotion:
    """The drum's moves on this rig. ``check`` may raise to end any wait.

    ``commissions``: commission the board for the settings it gets, as for a simulated rig that is
    wired as drawn. ``stop_count`` counts STOPs: a jog that was requested before one does not start
    after it.
    """

    def __init__(self, poller: DrumPoller, config: RigConfig, commissions: bool = False) -> None:
        self.poller = poller
        self.config = config
        self.commissions = commissions
        self.check: Callable[[], None] = lambda: None
        self.settings: dict[str, float] = {}
        self.homed = False
        self.stop_count = 0
        self._by_hand_count = 0
        self._command_count = 0
        self._commanded_s = -1.0

    @property
    def is_moved_by_hand(self) -> bool:
        """Whether somebody waits for the end of a move by hand."""
        return self._by_hand_count > 0

    @contextmanager
    def by_hand(self) -> Iterator[Self]:
        """Move by hand: a stop or another command ends the wait for a move, as CommandRefused.

        No run begins meanwhile, so that a run alone decides what the drum does.
        """
        self._by_hand_count += 1
        try:
            yield self
        finally:
            self._by_hand_count -= 1

    def reset(self) -> None:
        """Forget settings and the index mark: the board rebooted or was away."""
        self.settings = {}
        self.homed = False

    async def wait_started(self) -> None:
        """Wait until the board's self-test is over; before that it refuses settings.

        A latched fault ends the wait too. Raises RigFault where the self-test does not end.
        """
        poller, end_s = self.poller, self.poller.loop.time() + SELF_TEST_TIMEOUT_S
        await poller.wait_cycle()
        while poller.connected and (poller.state is None or poller.state.state in STARTING_STATES):
            if poller.loop.time() > end_s:
                raise RigFault("the drum's self-test does not end: restart the board")
            await poller.wait_cycle()

    async def configure(self) -> str:
        """Write the settings of the rig's description and read the other set-points.

        Returns a sentence on settings that the board refuses in its present state, empty where it
        takes all: :meth:`arm` and :meth:`approach` write those before anything is pressed.
        """
        await self.wait_started()
        settings = rig_settings(self.config).items()
        await self.write_settings(
            **{name: value for name, value in settings if name not in GUARDED_SETTINGS},
            approach_timeout_ms=self.config.actuator.approach_timeout_s * 1000,
            clock_trim_ppm=self.config.clocks.drum_ppm,
        )
        self.settings.update(await self.poller.drum.get(*SHOWN_SETTINGS))
        try:
            await self._write_guarded_settings()
        except CommandRefused as refusal:
            return f"{refusal}; arming the drum tries again"
        return ""

    async def _write_guarded_settings(self) -> None:
        """Write the settings that determine a force. Raises CommandRefused if the board refuses."""
        settings = rig_settings(self.config)
        await self.write_settings(**{name: settings[name] for name in GUARDED_SETTINGS})
        if self.commissions:
            await self.commission()

    async def commission(self) -> None:
        """Let the board press with the settings that it has. Raises CommandRefused.

        It is at rest and lifted, or has not pressed since its boot.
        """
        if not await self.is_commissioned():
            await self.execute(Command.COMMISSION, COMMISSION_TIMEOUT_S, "keeping the settings")

    async def is_commissioned(self) -> bool:
        """Ask the board whether it presses with the settings that it has."""
        status_bits = round((await self.poller.drum.get("status_bits"))["status_bits"])
        return bool(status_bits >> Status.COMMISSIONED & 1)

    async def write_settings(self, **values: float) -> None:
        """Write the settings, in engineering units, that differ from those on the board."""
        changed = {name: v for name, v in values.items() if self.settings.get(name) != v}
        if changed:
            await self.poller.drum.set(**changed)
            self.settings.update(changed)

    async def require_no_travel(self) -> None:
        """Raise CommandRefused while the drum turns in contact: it reads the speed when it starts.

        The same holds for acceleration, travel and run-in. The board's force loop reads the force
        at every tick.
        """
        if (await self._fresh_state()).state == State.RUN:
            raise CommandRefused(
                "the drum turns, at the speed with which it began: set speed, acceleration, "
                "travel and run-in once it holds still or is lifted; the force can change now"
            )

    async def arm(self) -> None:
        """Power up and lift off, unless the drum is armed already.

        Raises CommandRefused where the lifted board refuses the rig's guarded settings.
        """
        with suppress(CommandRefused):  # lifted, it may take what it refuses now
            await self._write_guarded_settings()
        if (await self._fresh_state()).state != State.ARMED:
            await self.reach(Command.ARM, State.ARMED, LIFT_TIMEOUT_S, "lifting off")
        await self._write_guarded_settings()

    async def disarm(self) -> None:
        """Lift off if necessary and switch the drivers off."""
        await self.lift()
        if (await self._fresh_state()).state == State.ARMED:
            self.homed = False  # a hand may turn the drum now
            await self.reach(Command.DISARM, State.IDLE, LIFT_TIMEOUT_S, "disarming")

    async def tare(self, anyway: bool = False) -> None:
        """Take the load cell's reading, lifted and still, as no load.

        The board refuses a reading far from the previous zero unless ``anyway`` is set.
        """
        command = Command.TARE_ANYWAY if anyway else Command.TARE
        if not await self.execute(command, TARE_TIMEOUT_S, "the tare"):
            raise CommandRefused(
                "the tare failed, and the zero is as before: the reading moved by more than 10 g, "
                "or away from the last zero: let the drum come to rest, and tare again"
            )

    async def home(self) -> None:
        """Find the index mark and count steps from it."""
        if not self.config.signals.index:
            await self._send(Command.ZERO_STEPS)
        else:
            what = "finding the index mark"
            end = await self.reach(Command.HOME, State.ARMED, HOME_TIMEOUT_S, what)
            if end.values["command_result"] != CommandResult.DONE:
                raise RigFault(
                    "the drum turned without meeting its index mark: check the mark, its sensor "
                    "and its wire"
                )
        self.homed = True

    async def approach(self, by_setup: bool = False) -> None:
        """Press until the force has settled. Raises CommandRefused where the board refuses.

        ``by_setup``: as a board takes it that is not commissioned yet, with 100 g at most.
        """
        await self._write_guarded_settings()
        search_s = APPROACH_EXTRA_S * 80 / self.config.loadcell.rate_hz
        timeout_s = search_s + self.settings["approach_timeout_ms"] / 1000
        command = Command.APPROACH_SETUP if by_setup else Command.APPROACH
        action = "settling at the force, within settle.band_percent of the protocol,"
        await self.reach(command, State.HOLD, timeout_s, action)

    async def nudge(self, presses: bool) -> float:
        """Move the actuator of a drum that is off a little; return its travel in µm, + downwards.

        Raises BoardFault where the potentiometer does not follow as it should.
        """
        await self.write_settings(nudge_direction=float(presses))
        await self.execute(Command.NUDGE, NUDGE_TIMEOUT_S, "the nudge")
        return (await self.poller.drum.get("nudge_travel_um"))["nudge_travel_um"]

    async def run(self) -> DrumState:
        """Turn through run-in, window and ramp; return the state in which the drum holds again."""
        return await self.reach(Command.RUN, State.HOLD, self._travel_timeout_s, TRAVEL)

    async def pass_window(self) -> DrumState:
        """Turn through run-in and window; return the state in which the window has closed.

        The drum ramps down then, in contact.
        """
        rises = self.poller.healthy_state().sync_count
        await self._send(Command.RUN)

        def has_passed(state: DrumState) -> bool:
            is_closed = state.sync_count != rises and not has_status(state, Status.SYNC_HIGH)
            return is_closed or self._holds(state)

        timeout_s = self._travel_timeout_s
        return await self.poller.wait_until(
            has_passed, timeout_s, TRAVEL, self._check_of_move(TRAVEL)
        )

    @property
    def _travel_timeout_s(self) -> float:
        travel_mm = self.settings["run_in_set"] + self.settings["travel_set"]
        return TRAVEL_EXTRA_S + TRAVEL_FACTOR * travel_mm / self.settings["speed_set"]

    async def wait_holding(self) -> None:
        """Wait until the drum, in contact, stands again behind a window."""
        if not self._holds(self.poller.healthy_state()):
            await self.poller.wait_until(self._holds, TRAVEL_EXTRA_S, "stopping", self.check)

    def _holds(self, state: DrumState) -> bool:
        return state.state == State.HOLD and self._is_command_finished(state)

    async def begin_run_in_here(self, trial: PlannedTrial) -> None:
        """Let the run-in begin where the drum holds, and the window open where it always does."""
        steps, drum = self.poller.healthy_state().steps, self.config.drum
        way_mm = way_to_window_mm(trial, steps, drum, self._step_mm)
        await self.write_settings(run_in_set=round(way_mm, 1))

    async def begin_lift(self) -> None:
        """Begin to lift off from any state, unless the drum is lifted."""
        state = (await self._fresh_state()).state
        if state == State.POSITION:
            await self._send(Command.STOP)
        elif state in PRESSING_STATES:
            await self._send(Command.RETRACT)

    async def lift(self) -> None:
        """Lift off from any state, as after a cancelled trial."""
        await self.begin_lift()
        if (await self._fresh_state()).state not in LIFTED_STATES:
            await self.poller.wait_until(
                lambda s: s.state in LIFTED_STATES, LIFT_TIMEOUT_S, "lifting off", self.check
            )

    async def move_to_start(self, trial: PlannedTrial) -> None:
        """Turn the lifted drum the shortest way to the start of the trial's run-in."""
        current_steps = (await self._fresh_state()).steps
        target = self._start_steps(trial, current_steps)
        if abs(target) > MAX_TARGET_STEPS:
            await self.home()
            target = self._start_steps(trial, self.poller.healthy_state().steps)
        await self._move_to(target)

    async def _move_to(self, target: int) -> None:
        await self.write_settings(move_target=target)
        if target != self.poller.healthy_state().steps:
            await self.reach(Command.MOVE, State.ARMED, MOVE_TIMEOUT_S, "moving, lifted,")

    async def jog(self, travel_mm: float) -> float:
        """Turn the lifted drum at the speed of moves; return the true travel in mm.

        A positive travel turns as a forward trial does. The target stays within the board's limits.
        Raises WrongUse for more than a turn, CommandRefused where the drum is not armed.
        """
        step_mm, stop_count = self._step_mm, self.stop_count
        turn_mm = self._turn_steps * step_mm
        if not abs(travel_mm) <= turn_mm:
            raise WrongUse(
                f"{travel_mm:g} mm is more than a turn of the drum ({turn_mm:g} mm): "
                "jog in smaller pieces"
            )
        start = await self._fresh_state()
        if start.state != State.ARMED:
            raise CommandRefused(
                f"the drum is {STATE_TEXT[State(start.state)]!r}: "
                "it can jog only while it is armed and lifted"
            )
        target = jog_target_steps(start.steps, travel_mm, self.config.drum, step_mm)
        await self.write_settings(move_target=target)
        if self.stop_count != stop_count:
            raise CommandRefused("a stop came first: the drum did not move")
        await self._move_to(target)
        sign = -1 if self.config.drum.backwards else 1
        return sign * (self.poller.healthy_state().steps - start.steps) * step_mm

    async def move_to_quarter(self) -> None:
        """Turn the lifted drum to a quarter of a turn past the index mark."""
        current_steps = (await self._fresh_state()).steps
        await self._move_to(nearest_steps(self._turn_steps // 4, current_steps, self._turn_steps))

    async def turn(self, speed_mm_s: float, turns: int) -> None:
        """Turn the lifted drum by whole turns at this speed, in the direction of its trials."""
        sign = -1 if self.config.drum.backwards else 1
        target = (await self._fresh_state()).steps + sign * turns * self._turn_steps
        await self.write_settings(move_speed_set=speed_mm_s)
        await self._move_to(target)
        await self.write_settings(move_speed_set=self.config.drum.rapid_mm_s)

    async def index_error_steps(self) -> int:
        """Return the steps counted at the last index mark less those expected."""
        return round((await self.poller.drum.get("index_error_steps"))["index_error_steps"])

    async def trim_clock(self) -> None:
        """Write the board's clock error where the estimate is better than the value it has."""
        estimate = self.poller.clock_fit.estimate
        if estimate is None:
            return
        current_ppm = self.settings.get("clock_trim_ppm", 0.0)
        if abs(estimate.ppm - current_ppm) > max(TRIM_STEP_PPM, estimate.error_ppm):
            await self.write_settings(clock_trim_ppm=float(round(estimate.ppm)))

    async def execute(self, command: Command, timeout_s: float, action: str) -> bool:
        """Send a command, wait until it is finished, and return whether it succeeded.

        ``action`` begins the sentence of a RigFault after ``timeout_s``. Raises CommandRefused.
        """
        await self._send(command)
        state = await self.poller.wait_until(
            self._is_command_finished, timeout_s, action, self._check_of_move(action)
        )
        return bool(state.values["command_result"] == CommandResult.DONE)

    async def _send(self, command: Command) -> None:
        await self.poller.drum.command(command)
        self._command_count += 1
        self._commanded_s = self.poller.loop.time()

    def _check_of_move(self, action: str) -> Callable[[], None]:
        """Return the check for the wait after a command; by hand, a later one ends it."""
        if not self.is_moved_by_hand:
            return self.check
        counts = self._command_count, self.stop_count

        def check() -> None:
            self.check()
            if counts != (self._command_count, self.stop_count):
                raise CommandRefused(f"{action} was interrupted: a stop or another command came")

        return check

    def _is_command_finished(self, state: DrumState) -> bool:
        """Return whether the last command is finished; an older poll cannot tell."""
        running = state.values["command_result"] == CommandResult.RUNNING
        return state.at_s > self._commanded_s and not running

    async def _fresh_state(self) -> DrumState:
        """Return a state that is newer than the last command."""
        while self.poller.healthy_state().at_s < self._commanded_s:
            await self.poller.wait_cycle()
            self.check()
        return self.poller.healthy_state()

    async def reach(self, command: Command, end: State, timeout_s: float, what: str) -> DrumState:
        """Send a command and return the state in which the board has finished it in ``end``."""
        await self._send(command)
        return await self.poller.wait_until(
            lambda s: s.state == end and self._is_command_finished(s),
            timeout_s,
            what,
            self._check_of_move(what),
        )

    def _start_steps(self, trial: PlannedTrial, current_steps: int) -> int:
        within_turn = trial_start_steps(trial, self.config.drum, self._step_mm)
        return nearest_steps(within_turn, current_steps, self._turn_steps)

    @property
    def _turn_steps(self) -> int:
        return self._detail("steps_per_turn")

    @property
    def _step_mm(self) -> float:
        return self._detail("nm_per_step") / 1e6

    def _detail(self, name: str) -> int:
        identity = self.poller.identity
        if identity is None or not identity.details.get(name):
            raise RigFault(f"the drum board did not report its {name}: load its firmware again")
        return identity.details[name]
