"""Moving the drum by name: each method gives one command and waits until its work is done.

Settings are written only when they change, and what the board took is what counts. Every wait
calls ``check``, so that a pause or a stop ends it at the next turn of the poll loop.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Final

from rigctl.acquisition.drum.poller import DrumPoller, command_ended
from rigctl.acquisition.drum.settings import (
    FARTHEST_STEPS,
    GUARDED,
    jog_target,
    nearest,
    press_settings,
    rig_settings,
    settle_settings,
    start_steps,
    trial_settings,
)
from rigctl.config.rig_config import RigConfig
from rigctl.errors import CommandRefused, RigFault, WrongUse
from rigctl.protocol import Settle
from rigctl.values import DrumState, PlannedTrial
from rigctl.wire.drum.codes import Command
from rigctl.wire.drum.states import STATE_TEXT, State

SELF_TEST_LIMIT_S = 10.0
LIFT_LIMIT_S = 20.0
TARE_LIMIT_S = 10.0
HOME_LIMIT_S = 120.0
MOVE_LIMIT_S = 600.0
SLOW_LIMIT_S = 20.0
TRIM_STEP_PPM = 10

STARTING: Final = (State.BOOT, State.SELFTEST)
LIFTED: Final = (State.ARMED, State.IDLE)
SHOWN_SETTINGS: Final = ("speed_set", "force_set", "acceleration_set", "travel_set", "run_in_set")


class DrumMotion:
    """The drum's moves on this rig. ``check`` may raise to end whatever is being waited for.

    ``stops`` counts STOPs: a jog that was asked for before one is not begun after it.
    """

    def __init__(
        self, watch: DrumPoller, config: RigConfig, check: Callable[[], None] = lambda: None
    ) -> None:
        self.watch = watch
        self.config = config
        self.check = check
        self.settings: dict[str, float] = {}
        self.homed = False
        self.stops = 0
        self._commanded_s = -1.0

    def forget(self) -> None:
        """The board rebooted: nothing that was set or found holds any more."""
        self.settings = {}
        self.homed = False

    async def started(self) -> None:
        """Wait until the board's self-test is over: before that it refuses what matters.

        A latched fault ends it as well. Raises RigFault where it does not end.
        """
        end_s = self.watch.loop.time() + SELF_TEST_LIMIT_S
        await self.watch.turn()
        while self.watch.connected and self._state in (None, *STARTING):
            if self.watch.loop.time() > end_s:
                raise RigFault("the drum's self-test does not end: restart the board")
            await self.watch.turn()

    @property
    def _state(self) -> int | None:
        """State of the newest poll, None before the first."""
        return None if self.watch.state is None else self.watch.state.state

    async def configure(self) -> str:
        """Write what the rig's description says, and learn the other set-points.

        The answer says what the board did not take in its present state, empty where it took all:
        :meth:`arm` and :meth:`approach` see to that before anything is pressed.
        """
        await self.started()
        await self.apply(
            **{n: v for n, v in rig_settings(self.config).items() if n not in GUARDED},
            approach_timeout_ms=self.config.actuator.approach_timeout_s * 1000,
            clock_trim_ppm=self.config.clocks.drum_ppm,
        )
        self.settings.update(await self.watch.drum.get(*SHOWN_SETTINGS))
        try:
            await self._guard()
        except CommandRefused as refusal:
            return f"{refusal}; arming the drum tries again"
        return ""

    async def _guard(self) -> None:
        """Have the board hold what decides a force, as the description says it.

        Raises CommandRefused where its state does not allow that.
        """
        settings = rig_settings(self.config)
        await self.apply(**{name: settings[name] for name in GUARDED})

    async def apply(self, **values: float) -> None:
        """Write settings that differ from what the board has, in engineering units."""
        news = {name: v for name, v in values.items() if self.settings.get(name) != v}
        if news:
            await self.watch.drum.set(**news)
            self.settings.update(news)

    async def arm(self) -> None:
        """Power up and lift off; nothing to do where the drum is armed already.

        Raises CommandRefused where the lifted board does not take the rig's description.
        """
        with suppress(CommandRefused):  # lifted it may take what it does not take now
            await self._guard()
        if (await self._fresh()).state != State.ARMED:
            await self._do(Command.ARM, State.ARMED, LIFT_LIMIT_S, "lifting off")
        await self._guard()

    async def disarm(self) -> None:
        """Lift off if need be and switch the drivers off."""
        await self.lift()
        if (await self._fresh()).state == State.ARMED:
            self.homed = False  # a hand may turn the drum now
            await self._do(Command.DISARM, State.IDLE, LIFT_LIMIT_S, "disarming")

    async def tare(self, anyway: bool = False) -> None:
        """Take the load cell's reading, lifted and still, as no load.

        The board refuses one far from the zero before, but where it is asked for ``anyway``.
        """
        await self.command(Command.TARE_ANYWAY if anyway else Command.TARE)
        await self.watch.until(self.ended, TARE_LIMIT_S, "the tare", self.check)

    async def home(self) -> None:
        """Find the index mark and count steps from it."""
        if not self.config.signals.index:
            await self.command(Command.ZERO_STEPS)
        else:
            await self._do(Command.HOME, State.ARMED, HOME_LIMIT_S, "finding the index mark")
        self.homed = True

    async def approach(self) -> None:
        """Press until the force has settled. Raises CommandRefused where the board says no."""
        await self._guard()
        limit_s = SLOW_LIMIT_S + self.settings["approach_timeout_ms"] / 1000
        await self._do(Command.APPROACH, State.HOLD, limit_s, "reaching the force")

    async def run(self, limit_s: float) -> DrumState:
        """Turn through run-in, window and ramp; the state in which the drum holds again."""
        return await self._do(Command.RUN, State.HOLD, limit_s, "the travel")

    async def begin_lift(self) -> None:
        """Begin to lift off, from wherever the drum is; nothing to do where it is lifted."""
        state = (await self._fresh()).state
        if state == State.POSITION:
            await self.command(Command.STOP)
        elif state in (State.APPROACH, State.HOLD, State.RUN):
            await self.command(Command.RETRACT)

    async def lift(self) -> None:
        """Lift off from wherever the drum is; the way out of a trial that was called off."""
        await self.begin_lift()
        if (await self._fresh()).state not in LIFTED:
            await self.watch.until(
                lambda s: s.state in LIFTED, LIFT_LIMIT_S, "lifting off", self.check
            )

    async def move_to_start(self, trial: PlannedTrial) -> None:
        """Turn the lifted drum the short way to where the trial's run-in begins."""
        steps_now = (await self._fresh()).steps
        target = self._start(trial, steps_now)
        if abs(target) > FARTHEST_STEPS:
            await self.home()
            target = self._start(trial, self.watch.healthy().steps)
        await self._move_to(target)

    async def _move_to(self, target: int) -> None:
        await self.apply(move_target=target)
        if target != self.watch.healthy().steps:
            await self._do(Command.MOVE, State.ARMED, MOVE_LIMIT_S, "moving, lifted,")

    async def jog(self, travel_mm: float) -> float:
        """Turn the lifted drum by so much texture, at the speed of moves; the mm really turned.

        Positive turns as a forward trial does. The target is kept inside what the board takes.
        Raises WrongUse for more than a turn, CommandRefused where the drum is not armed.
        """
        turn, step_mm = self._detail("steps_per_turn"), self._detail("nm_per_step") / 1e6
        stops = self.stops
        if not abs(travel_mm) <= turn * step_mm:
            raise WrongUse(
                f"{travel_mm:g} mm is more than a turn of the drum ({turn * step_mm:g} mm): "
                "jog in smaller pieces"
            )
        here = await self._fresh()
        if here.state != State.ARMED:
            raise CommandRefused(
                f"the drum is {STATE_TEXT[State(here.state)]!r}: "
                "it can be jogged while it is armed and lifted only"
            )
        target = jog_target(here.steps, travel_mm, self.config.drum, step_mm)
        await self.apply(move_target=target)
        if self.stops != stops:
            raise CommandRefused("a stop came first: the drum was not moved")
        await self._move_to(target)
        sign = -1 if self.config.drum.backwards else 1
        return sign * (self.watch.healthy().steps - here.steps) * step_mm

    async def move_to_quarter(self) -> None:
        """Turn the lifted drum to a quarter of a turn behind the mark."""
        quarter = self._detail("steps_per_turn") // 4
        here = (await self._fresh()).steps
        await self._move_to(nearest(quarter, here, self._detail("steps_per_turn")))

    async def turn(self, speed_mm_s: float, turns: int) -> None:
        """Turn the lifted drum over whole turns at a speed, as its trials turn."""
        sign = -1 if self.config.drum.backwards else 1
        steps = (await self._fresh()).steps + sign * turns * self._detail("steps_per_turn")
        await self.apply(move_speed_set=speed_mm_s)
        await self._move_to(steps)
        await self.apply(move_speed_set=self.config.drum.rapid_mm_s)

    async def index_error_steps(self) -> int:
        """Steps counted at the last index mark less those expected."""
        return round((await self.watch.drum.get("index_error_steps"))["index_error_steps"])

    async def set_trial(self, trial: PlannedTrial) -> None:
        """Write the trial's set-points."""
        await self.apply(**trial_settings(trial, self.config.drum))

    async def set_press(self, force_g: float) -> None:
        """Write the force of an approach without travel."""
        await self.apply(**press_settings(force_g))

    async def set_settle(self, settle: Settle) -> None:
        """Write when the force counts as settled."""
        await self.apply(**settle_settings(settle))

    async def trim(self) -> None:
        """Tell the board how fast its clock runs, where that is known better than it was."""
        estimate = self.watch.clock.estimate
        if estimate is None:
            return
        known = self.settings.get("clock_trim_ppm", 0.0)
        if abs(estimate.ppm - known) > max(TRIM_STEP_PPM, estimate.error_ppm):
            await self.apply(clock_trim_ppm=float(round(estimate.ppm)))

    async def command(self, command: Command) -> None:
        """Give one command and do not wait for its work. Raises CommandRefused."""
        await self.watch.drum.command(command)
        self._commanded_s = self.watch.loop.time()

    def ended(self, state: DrumState) -> bool:
        """Whether the last command's work is over; a poll from before it cannot tell."""
        return state.at_s > self._commanded_s and command_ended(state)

    async def _fresh(self) -> DrumState:
        """A state that is newer than the last command."""
        while self.watch.healthy().at_s < self._commanded_s:
            await self.watch.turn()
            self.check()
        return self.watch.healthy()

    async def _do(self, command: Command, end: State, limit_s: float, what: str) -> DrumState:
        await self.command(command)
        return await self.watch.until(
            lambda s: s.state == end and self.ended(s), limit_s, what, self.check
        )

    def _start(self, trial: PlannedTrial, steps_now: int) -> int:
        within_turn = start_steps(trial, self.config.drum, self._detail("nm_per_step") / 1e6)
        return nearest(within_turn, steps_now, self._detail("steps_per_turn"))

    def _detail(self, name: str) -> int:
        identity = self.watch.identity
        if identity is None or not identity.details.get(name):
            raise RigFault(f"the drum board did not say its {name}: load its firmware anew")
        return identity.details[name]
