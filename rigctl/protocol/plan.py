"""A protocol, the description of a data set, and its plan, the ordered steps."""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import groupby, product
from math import inf
from operator import attrgetter
from random import Random
from typing import Any, TypeVar

from rigctl.boards.drum_registers import BY_NAME
from rigctl.config.rig_config import RigConfig
from rigctl.config.toml_reader import number, text
from rigctl.errors import WrongUse
from rigctl.protocol.steps import (
    ChangePlate,
    RunTrial,
    Step,
    rig_seconds,
    run_in_range_mm,
    way_to_repeat_mm,
)
from rigctl.values import HELD_SAMPLES, SAMPLE_RATE_HZ, PlannedTrial

QUANTITY_NAMES = {"sa_rate": "mean SA rate", "ra_rate": "mean RA rate"}
"""Mean spike rate of the SA or of the RA neurons over a trial, Hz per neuron."""

Condition = tuple[str, float, float, float]
"""Plate, speed in mm/s, force in g, depth in mm."""


@dataclass(frozen=True, slots=True)
class EarlyEnd:
    """A condition ends when the interval of its mean is at most so wide."""

    of: str = text(
        "sa_rate",
        "the mean that is to be known: `sa_rate` or `ra_rate`, spikes of a neuron and second over "
        "a trial",
        tuple(QUANTITY_NAMES),
    )
    half_width_hz: float = number(
        2.0, "Hz", 0.01, 1000, "the widest half of its interval, which a table has to give"
    )
    confidence_percent: float = number(95.0, "%", 50, 99.9, "what the interval promises")
    least_trials: int = number(5, "", 5, 100_000, "trials of a condition before it may end")


def condition_of(trial: PlannedTrial) -> Condition:
    """Return plate, speed, force and depth of a trial."""
    return trial.texture, trial.speed_mm_s, trial.force_g, trial.depth_mm


def contact_of(trial: PlannedTrial) -> tuple[Condition, str, int]:
    """Return what the trials of one contact share: condition, force mode and mounting."""
    return condition_of(trial), trial.force_mode, trial.mount


_Trial = TypeVar("_Trial")

MAX_SEED = 2**63 - 1
EACH_TRIAL, EACH_CONDITION = LIFTS = ("trial", "condition")
"""When the drum lifts off."""
PLATE_BY_PLATE = "plate by plate"
UP_DOWN = "up-down"
ORDER_WORDS = {
    "blocked": f"{PLATE_BY_PLATE}, forces, speeds, repeats",
    "shuffled": "shuffled",
    UP_DOWN: f"{PLATE_BY_PLATE}, forces up and down by turns, speeds",
}
"""What people read for the order of the trials."""
DEFAULT_PROMPT = "Mount plate {texture}, then confirm."

BYTES_PER_TRIAL = 700
BYTES_PER_POLL = 102
BYTES_PER_LOADCELL_SAMPLE = 24
BYTES_PER_BLOCK = 16
POLL_RATE_HZ = 50
LOADCELL_RATE_HZ = 80
BLOCK_RATE_HZ = 100


def recorded_bytes_per_s(config: RigConfig) -> int:
    """Return how fast a session of this rig grows while it is recorded, bytes a second."""
    sample = 2 * config.taxels.count + 10
    rate = sample * SAMPLE_RATE_HZ + BYTES_PER_POLL * POLL_RATE_HZ
    return rate + BYTES_PER_LOADCELL_SAMPLE * LOADCELL_RATE_HZ + BYTES_PER_BLOCK * BLOCK_RATE_HZ


def checked_seed(seed: int) -> int:
    """Return the seed of an order. Raises WrongUse for one that a session cannot store."""
    if not 0 <= seed <= MAX_SEED:
        raise WrongUse(f"a seed is a whole number from 0 to {MAX_SEED}: choose another")
    return seed


def register_range(register: str, unit: float = 1.0) -> dict[str, Any]:
    """Return the range of a register of the drum, in its engineering unit times ``unit``."""
    entry = BY_NAME[register]
    return {"low": entry.low * entry.scale * unit, "high": entry.high * entry.scale * unit}


@dataclass(frozen=True, slots=True)
class Settle:
    """When the force counts as settled, before the drum turns."""

    band_percent: float = number(
        2.0, "%", **register_range("settle_band", 0.1), doc="force band, of the set-point"
    )
    time_s: float = number(
        0.3,
        "s",
        **register_range("settle_time_ms", 1e-3),
        doc="time in the band before the drum turns",
    )
    timeout_s: float = number(
        10.0,
        "s",
        **register_range("approach_timeout_ms", 1e-3),
        doc="longest time to settle; more is a fault",
    )


# A plan's digest is of its repr: sessions from before these limits keep their plan.
unhashed = partial(number, repr=False)

MAX_LOST_SAMPLES = 40
"""Twice what a trial of 6 s loses at one damaged byte in 10,000 (decision 50)."""


@dataclass(frozen=True, slots=True)
class Quality:
    """Limits that a trial must keep to be committed, and the number of attempts."""

    max_lost_samples: int = number(
        MAX_LOST_SAMPLES, "", 0, 1000, "a trial that loses more is rejected"
    )
    max_gap_samples: int = unhashed(
        HELD_SAMPLES, "", 0, 1000, "a trial that loses more in a row is rejected"
    )
    force_tolerance_percent: float = number(
        5.0, "%", 0.1, 100, "mean force over the window, of the set-point"
    )
    speed_tolerance_percent: float = number(1.0, "%", 0.01, 100, "mean speed, of the set-point")
    attempts: int = number(3, "", 1, 100, "highest number of attempts at a trial")
    pause_after_failures: int = unhashed(
        6, "", 0, 1000, "attempts in a row that are not good before the run pauses; 0: never"
    )
    max_spike_percent: float = unhashed(
        25.0, "%", 1, 1000, "a load-cell reading off its neighbours, of the set force: repeated"
    )
    max_saturated_percent: float = unhashed(
        50.0, "%", 0, 100, "of a taxel's samples at the end of its range: quarantine"
    )
    max_drift_counts: float = unhashed(
        50.0, "counts", 1, 1023, "of a taxel's lifted reading since the start: quarantine"
    )
    false_alarms_percent: float = unhashed(
        0.1, "%", 0, 10, "of good trials that may seem unusual beside equal ones: quarantine"
    )


@dataclass(frozen=True, slots=True)
class FreeStep:
    """A step at a place: start, plate_start, between_plates, plate_end, end, or every n trials.

    At ``drift`` it is a tare, where the lifted load cell reads ``limit_g`` or more.
    """

    at: str
    step: Step
    every_trials: int = 0
    limit_g: float = 0.0


@dataclass(frozen=True, slots=True)
class Protocol:
    """A trial protocol as in its file, validated against a rig.

    ``order`` is ``blocked`` (plate by plate, force by force, speed by speed, repeats last),
    ``shuffled`` by ``order_seed``, within the plates unless ``across_plates``, or ``up-down``:
    repeat by repeat, the forces rising and falling by turns. ``mounts``: how often each plate is
    mounted, with ``repeats`` each time; all plates come before one comes again.
    ``early_end``: when a condition ends before its repeats, None for never.
    ``lift``: after each ``trial``, or by ``condition``: between repeats the drum stays in contact.
    Forces are in grams; force mode ``position`` has depths in mm instead. ``text`` is the source.
    """

    name: str
    text: str
    config: RigConfig
    description: str = ""
    textures: tuple[str, ...] = ()
    speeds_mm_s: tuple[float, ...] = ()
    forces_g: tuple[float, ...] = ()
    depths_mm: tuple[float, ...] = ()
    repeats: int = 0
    mounts: int = 1
    order: str = "blocked"
    order_seed: int = 0
    across_plates: bool = False
    travel_mm: float = 240.0
    force_mode: str = "hold"
    direction: str = "forward"
    lift: str = EACH_TRIAL
    plate_prompt: str = DEFAULT_PROMPT
    settle: Settle = Settle()
    quality: Quality = Quality()
    steps: tuple[FreeStep, ...] = ()
    early_end: EarlyEnd | None = None

    @property
    def n_trials(self) -> int:
        """Number of trials of the plan."""
        presses = len(self.forces_g or self.depths_mm)
        each = len(self.textures) * len(self.speeds_mm_s) * presses * self.repeats
        return each * self.mounts

    @property
    def drift_limit_g(self) -> float:
        """The lifted reading that asks for a tare, infinite where none does."""
        return min((free.limit_g for free in self.steps if free.limit_g), default=inf)

    def way_between_mm(self, before: Step | None, step: Step) -> float | None:
        """Return the way to a trial's window in contact, None where the drum lifts before it.

        After a trial that was left out, repeats may have the same direction in an alternate order.
        """
        if not (isinstance(before, RunTrial) and isinstance(step, RunTrial)):
            return None
        trial = step.trial
        if self.lift != EACH_CONDITION or contact_of(before.trial) != contact_of(trial):
            return None
        back = before.trial.direction != trial.direction
        if not (back or self.config.drum.level_joint):
            return None
        way_mm = way_to_repeat_mm(trial.travel_mm, trial.speed_mm_s, self.config, back=back)
        least_mm, most_mm = run_in_range_mm(trial.speed_mm_s, self.config)
        return way_mm if least_mm <= way_mm <= most_mm else None

    def plan(self, seed: int | None = None) -> Plan:
        """Return the plan; ``seed`` overrides that of the file. Raises WrongUse for a wrong one."""
        used = self.order_seed if seed is None else checked_seed(seed)
        return Plan(self, used, tuple(_steps(self, used)))


@dataclass(frozen=True)
class Plan:
    """The ordered steps. Plans with the same ``hash`` have the same steps and limits."""

    protocol: Protocol
    seed: int
    steps: tuple[Step, ...]

    @cached_property
    def trials(self) -> tuple[PlannedTrial, ...]:
        """The planned trials; ``trials[i].trial_id`` is ``i + 1``."""
        return tuple(step.trial for step in self.steps if isinstance(step, RunTrial))

    @property
    def fewest_trials(self) -> int:
        """The number of trials if every condition ends as early as it may."""
        protocol = self.protocol
        if protocol.early_end is None:
            return len(self.trials)
        return len(self.trials) // protocol.repeats * protocol.early_end.least_trials

    @property
    def plate_changes(self) -> int:
        """How often a person mounts a plate, including the first."""
        return sum(isinstance(step, ChangePlate) for step in self.steps)

    @property
    def duration_s(self) -> float:
        """Rig time of all steps, by the overheads in :mod:`rigctl.protocol.steps`."""
        protocol = self.protocol
        config, settle_s = protocol.config, protocol.settle.time_s
        before: tuple[Step | None, ...] = (None, *self.steps)
        return sum(
            rig_seconds(step, config, settle_s, protocol.way_between_mm(last, step))
            for last, step in zip(before, self.steps, strict=False)
        )

    @property
    def bytes_estimate(self) -> int:
        """Size on disk: everything between and in trials is recorded, except plate changes."""
        rate = recorded_bytes_per_s(self.protocol.config)
        return round(self.duration_s * rate) + BYTES_PER_TRIAL * len(self.trials)

    @cached_property
    def hash(self) -> str:
        """Digest of the steps and the limits for settling and quality, 32 hexadecimal digits."""
        quality = self.protocol.quality
        if quality.max_lost_samples == MAX_LOST_SAMPLES:
            quality = replace(quality, max_lost_samples=0)  # the default of earlier sessions
        gap = () if quality.max_gap_samples == HELD_SAMPLES else (quality.max_gap_samples,)
        rule = () if self.protocol.early_end is None else (self.protocol.early_end,)
        lift = () if self.protocol.lift == EACH_TRIAL else (self.protocol.lift,)
        drift = tuple(free for free in self.protocol.steps if free.limit_g)
        parts: list[Any] = [self.protocol.settle, quality, *gap, *rule, *lift, *drift, *self.steps]
        return digest_of(parts)


def digest_of(parts: Iterable[Any]) -> str:
    """Return the digest of frozen values, 32 hexadecimal digits; their order counts."""
    digest = hashlib.sha256()
    for index, part in enumerate(parts):
        # A frozen value's repr shows each field by name.
        digest.update(f"\n{part!r}".encode() if index else repr(part).encode())
    return digest.hexdigest()[:32]


def _steps(protocol: Protocol, seed: int) -> Iterator[Step]:
    steps_at: dict[str, list[Step]] = defaultdict(list)
    for free in protocol.steps:
        steps_at[free.at].append(free.step)
    periodic = [free for free in protocol.steps if free.every_trials]
    yield from steps_at["start"]
    done = 0
    mounted: Counter[str] = Counter()
    for block, (texture, trials) in enumerate(_plate_blocks(protocol, seed)):
        if block:
            yield from steps_at["between_plates"]
        mounted[texture] += 1
        yield ChangePlate(texture, _prompt(protocol, texture, mounted[texture]))
        yield from steps_at["plate_start"]
        for trial in trials:
            yield from _periodic_steps(periodic, done)
            done += 1
            yield RunTrial(replace(trial, trial_id=done, mount=mounted[texture]))
        yield from steps_at["plate_end"]
    yield from steps_at["end"]


def _prompt(protocol: Protocol, texture: str, mount: int) -> str:
    """Return what a person reads at a change of plates."""
    prompt = protocol.plate_prompt.replace("{texture}", texture)
    if protocol.mounts == 1:
        return prompt
    again = f" (mounting {mount} of {protocol.mounts}" + (
        "; take the plate off first if it is on)" if mount > 1 else ")"
    )
    return prompt + again


def _periodic_steps(periodic: Sequence[FreeStep], done: int) -> Iterator[Step]:
    """Yield the steps after every n-th trial, when another trial follows."""
    for free in periodic:
        if done and done % free.every_trials == 0:
            yield free.step


def _plate_blocks(protocol: Protocol, seed: int) -> list[tuple[str, list[PlannedTrial]]]:
    """Return the runs of trials that share a plate, in order."""
    random = Random(seed)  # its random() is the same in every Python version
    plates = protocol.textures * protocol.mounts
    blocks = [(texture, _conditions(protocol, texture)) for texture in plates]
    if protocol.order == "blocked":
        return blocks
    if protocol.order == UP_DOWN:
        return [(texture, sorted(trials, key=_up_and_down)) for texture, trials in blocks]
    if not protocol.across_plates:
        return [(texture, shuffled(trials, random)) for texture, trials in blocks]
    mixed = shuffled([trial for _, trials in blocks for trial in trials], random)
    return [(plate, list(run)) for plate, run in groupby(mixed, attrgetter("texture"))]


def _up_and_down(trial: PlannedTrial) -> tuple[int, float]:
    """Return the key by which forces or depths rise in odd repeats and fall in even ones."""
    press = trial.force_g or trial.depth_mm
    return trial.repeat, press if trial.repeat % 2 else -press


def shuffled(trials: list[_Trial], random: Random) -> list[_Trial]:
    """Return the trials in an order that depends on ``random`` alone."""
    keys = [random.random() for _ in trials]
    return [trials[place] for place in sorted(range(len(trials)), key=keys.__getitem__)]


def _conditions(protocol: Protocol, texture: str) -> list[PlannedTrial]:
    """Return the unnumbered trials of one texture, repeats of a speed and force together."""
    in_position = protocol.force_mode == "position"
    presses = protocol.depths_mm if in_position else protocol.forces_g
    repeats = range(1, protocol.repeats + 1)
    return [
        PlannedTrial(
            trial_id=0,
            texture=texture,
            speed_mm_s=speed,
            force_g=0.0 if in_position else press,
            repeat=repeat,
            travel_mm=protocol.travel_mm,
            force_mode=protocol.force_mode,
            direction=_direction(protocol, repeat),
            depth_mm=press if in_position else 0.0,
        )
        for press, speed, repeat in product(presses, protocol.speeds_mm_s, repeats)
    ]


def _direction(protocol: Protocol, repeat: int) -> str:
    if protocol.direction == "alternate":
        return "forward" if repeat % 2 else "backward"
    return protocol.direction
