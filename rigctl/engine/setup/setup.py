"""The steps of the setup in their order, and the one setup of a rig that takes them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from rigctl.boards.drum_codes import Status
from rigctl.boards.drum_states import FAULT_TEXT, Fault
from rigctl.engine.contact import has_status
from rigctl.engine.setup.actuator import check_actuator
from rigctl.engine.setup.boards import check_drum, check_firmware, check_fitted, check_ports
from rigctl.engine.setup.check_result import CheckResult
from rigctl.engine.setup.context import SetupContext
from rigctl.engine.setup.drum_turn import check_turn
from rigctl.engine.setup.first_contact import (
    check_first_press,
    check_first_trial,
    commission,
)
from rigctl.engine.setup.load_cell import check_at_rest, check_scale, check_under_finger
from rigctl.engine.setup.progress import COMMISSION, PassedStep, Progress, renew_kept
from rigctl.engine.setup.sensor import check_order, check_sensor
from rigctl.engine.setup.setup_status import FORCE, STOP, SUPPLY
from rigctl.engine.setup.switches import check_ends, check_stop, check_supply_cut, tripped
from rigctl.errors import LinkLost, RigFault, WrongUse

CELL = "mega#load-cell-amplifier-hx711"


@dataclass(frozen=True, slots=True)
class SetupStep:
    """One part that is checked alone.

    ``picture``: what it is about, the page of the wiring drawing and the id of a part in it, or
    FORCE for the plot of the load cell. ``needs``: the optional wire without which
    there is nothing to check. ``moves``: it drives a motor, so all steps before it pass first.
    """

    name: str
    title: str
    check: Callable[[SetupContext], Awaitable[CheckResult]]
    picture: str
    needs: str = ""
    moves: bool = False


STEPS = (
    SetupStep("ports", "Boards and ports", check_ports, "mega#arduino-uno"),
    SetupStep("firmware", "Firmware", check_firmware, "mega#arduino-uno"),
    SetupStep("drum", "Drum and microsteps", check_drum, "mega#stepper-driver"),
    SetupStep("wires", "Wires that are fitted", check_fitted, "mega#actuator-position-and-ends"),
    SetupStep(STOP, "Emergency stop", check_stop, "mega#emergency-stop", "estop"),
    SetupStep(
        SUPPLY,
        "Second contact of the stop",
        check_supply_cut,
        "mega#h-bridge-of-the-actuator",
        "estop",
    ),
    SetupStep(
        "ends", "End switches", check_ends, "mega#actuator-position-and-ends", "end_switches"
    ),
    SetupStep("cell", "Load cell at rest", check_at_rest, CELL),
    SetupStep("finger", "Load cell under a finger", check_under_finger, CELL),
    SetupStep("scale", "Load cell with known masses", check_scale, CELL),
    SetupStep(
        "actuator",
        "Actuator and potentiometer",
        check_actuator,
        "mega#h-bridge-of-the-actuator",
        moves=True,
    ),
    SetupStep(
        "turn", "Drum, mark and steps", check_turn, "mega#index-sensor-at-the-drum", moves=True
    ),
    SetupStep("sensor", "Sensor at rest", check_sensor, "uno#sensor-read-lines"),
    SetupStep("order", "Order of the taxels", check_order, "uno#sensor-driven-lines"),
    SetupStep("press", "First press, 100 g", check_first_press, FORCE, moves=True),
    SetupStep(COMMISSION, "Commission the board", commission, FORCE, moves=True),
    SetupStep("trial", "First trial", check_first_trial, "uno#arduino-mega", "sync", moves=True),
)

FAULT_CAUSES: dict[Fault, tuple[str, ...]] = {
    Fault.ESTOP: ("E-stop unplugged", "E-stop normally open"),
    Fault.LOADCELL_SILENT: ("cell data unplugged",),
    Fault.LOADCELL_FROZEN: ("cell clock unplugged",),
    Fault.LOADCELL_DESYNC: ("cell clock unplugged",),
    Fault.LOADCELL_RATE: ("cell at 10 samples a second",),
    Fault.LOADCELL_NOISE: ("cell unplugged", "E− not connected to ground"),
    Fault.ACTUATOR_REVERSED: ("actuator swapped", "potentiometer reversed"),
    Fault.ACTUATOR_STUCK: ("actuator unplugged", "actuator supply missing"),
    Fault.POSITION_WIRE: (
        "potentiometer wiper open",
        "potentiometer shorted to ground",
        "upper end switch unplugged",
    ),
    Fault.FORCE_MISSING: ("cell excitation open", "cell on channel B"),
}
"""Wrong wirings behind a fault that the board latches by itself, in whatever step."""


class TooEarly(WrongUse):
    """A part that moves the drum was asked for before all parts before it have passed."""


class Setup:
    """The setup of one rig: which steps there are, which have passed, what each has found."""

    def __init__(self, context: SetupContext, progress: Progress) -> None:
        self.context, self.progress = context, progress
        self.results: dict[str, CheckResult] = {}

    @property
    def steps(self) -> tuple[SetupStep, ...]:
        """The steps of this rig: those of the parts that it has."""
        signals = self.context.rig.config.signals
        return tuple(step for step in STEPS if not step.needs or getattr(signals, step.needs))

    @property
    def next(self) -> SetupStep | None:
        """The first step that has not passed, None where all have."""
        passed = self.progress.passed
        return next((step for step in self.steps if step.name not in passed), None)

    def step(self, name: str) -> SetupStep:
        """Return a step. Raises WrongUse for a name that is none, or whose part is not fitted."""
        for step in self.steps:
            if step.name == name:
                return step
        names = ", ".join(step.name for step in self.steps)
        raise WrongUse(f"this rig's setup has no part {name!r}: it has {names}")

    async def check(self, name: str) -> CheckResult:
        """Take a step and return what it found; a step that fails loses the pass it had.

        Raises TooEarly for a step that moves before the others have passed, LinkLost.
        """
        step = self.step(name)
        self._require_earlier(step)
        self.context.kept.clear()
        try:
            result = await step.check(self.context)
        except LinkLost:
            raise
        except RigFault as fault:
            result = self._failed(step, fault)
        await self._note(step, result)
        return result

    async def keep(self, name: str) -> str:
        """Let ``rig.toml`` describe a part as it is wired; return what it says now.

        Raises WrongUse where the last check of the part offers nothing.
        """
        step, result = self.step(name), self.results.get(name)
        if result is None or result.remedy is None:
            raise WrongUse(f"{step.title}: nothing in rig.toml mends this: change the wiring")
        remedy = result.remedy
        self.context.kept.clear()
        self.context.keep(remedy.table, remedy.keys)
        await self.context.configure()
        kept = CheckResult(result.expected, f"{result.found}; rig.toml says {remedy.text}")
        await self._note(step, kept)
        return remedy.text

    def begin_again(self) -> None:
        """Forget which steps have passed."""
        self.progress.passed.clear()
        self.progress.remarks.clear()
        self.results.clear()
        self.progress.save(self.context.rig.drum.identity)

    async def commission_without(self) -> tuple[str, ...]:
        """Commission the board at once; return the titles of the parts that nobody checked."""
        skipped = tuple(
            step.title
            for step in self.steps
            if step.name not in self.progress.passed and step.name != COMMISSION
        )
        await self.context.clear()
        await commission(self.context)
        return skipped

    def _require_earlier(self, step: SetupStep) -> None:
        if not step.moves:
            return
        for earlier in self.steps:
            if earlier is step:
                return
            if earlier.name not in self.progress.passed:
                raise TooEarly(f"{step.title} moves the drum: first check {earlier.title}")

    async def _note(self, step: SetupStep, result: CheckResult) -> None:
        self.results[step.name] = result
        if result.passed:
            kept = {table: dict(keys) for table, keys in self.context.kept.items()}
            renew_kept(self.progress.passed, kept)
            self.progress.passed[step.name] = PassedStep(self.context.today(), result.found, kept)
        else:
            self.progress.passed.pop(step.name, None)
        passed = self.progress.passed
        if COMMISSION in passed and not await self.context.motion.is_commissioned():
            del passed[COMMISSION]  # the part has changed what the board is commissioned for
        self.progress.save(self.context.rig.drum.identity)

    def _failed(self, step: SetupStep, fault: RigFault) -> CheckResult:
        """Return the result of a step that the board ended, by the causes that it reports."""
        state = self.context.motion.poller.state
        present = [] if state is None else _causes(state.fault, state.fault_bits)
        expected = f"{step.title} without a fault of the board"
        if state is None or not present:
            return CheckResult(expected, "an end before its time", str(fault))
        if present[0] is Fault.ESTOP and has_status(state, Status.ESTOP_CLOSED):
            return tripped(expected, "the stop's contact is closed")
        texts = " ".join(FAULT_TEXT[cause] for cause in present[:1])
        names = (name for cause in present for name in FAULT_CAUSES.get(cause, ()))
        causes = tuple(dict.fromkeys(names))
        found = f"the fault {', '.join(cause.name for cause in present)}"
        return CheckResult(expected, found, texts, causes)


def _causes(latched: int, bits: int) -> list[Fault]:
    """Return the faults that say something: the latched one first, without the self-test's."""
    listed = [fault for fault in Fault if fault and bits >> fault & 1]
    ordered = [Fault(latched), *listed] if latched else listed
    return [f for f in dict.fromkeys(ordered) if f is not Fault.SELFTEST]
