"""Protocols of the moving finger: ``protocols/finger/*.toml`` to an ordered plan of scans."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product
from pathlib import Path
from random import Random

from rigctl.config.toml_reader import (
    FieldType,
    TomlField,
    TomlTable,
    TomlText,
    number,
    read_section,
    section_fields,
)
from rigctl.errors import ProtocolError
from rigctl.finger.values import FingerTrial, Stage, VelocityProfile
from rigctl.protocol.fields import (
    CATALOGUE_WORDS,
    ORDER_SEED,
    ORDERS,
    TEXTURES,
    FieldGroup,
    name_group,
)
from rigctl.protocol.plan import checked_seed, digest_of, shuffled

MAX_SCANS = 20_000

BYTES_PER_SECOND = 45_000
"""Samples, spikes, flags and track of a second, with the time between scans recorded too."""
SECONDS_PER_TRIAL = 5.0
"""A scan, the way back and a breath; people differ."""


@dataclass(frozen=True, slots=True)
class StageRepeats:
    """Scans of each plate and velocity profile in each stage; 0 leaves the stage out."""

    normalise: int = number(2, "", 0, 1000, "to find the range of each taxel")
    train: int = number(4, "", 0, 1000, "to train the classifiers")
    calibrate: int = number(2, "", 0, 1000, "to centre the classifiers in a new session")
    run: int = number(4, "", 0, 1000, "to be named while the finger moves")

    def of(self, stage: Stage) -> int:
        """Return the number of scans of a stage."""
        return int(getattr(self, stage.value))


@dataclass(frozen=True, slots=True)
class ScanQuality:
    """Limits that a scan must keep to be committed, and the number of attempts."""

    slowest_mm_s: float = number(15.0, "mm/s", 1, 1000, "lowest mean speed")
    slow_max_mm_s: float = number(
        82.0, "mm/s", 1, 1000, "a mean speed below it is slow, one above it medium or fast"
    )
    fast_min_mm_s: float = number(124.0, "mm/s", 1, 1000, "a mean speed above it is fast")
    fastest_mm_s: float = number(400.0, "mm/s", 1, 10_000, "highest mean speed")
    change_ratio: float = number(
        1.45, "", 1, 10, "mean speed over one half of the way to the other: above it speed changes"
    )
    max_lost_samples: int = number(0, "", 0, 1000, "samples that may be lost")
    max_held_velocities: int = number(
        0, "", 0, 1000, "batches whose velocity may be late, or unknown to the tracker"
    )
    max_tracker_gap_ms: float = number(100.0, "ms", 10, 10_000, "longest time without a position")
    min_contact_percent: float = number(98.0, "%", 0, 100, "part of the scan in contact")
    attempts: int = number(5, "", 1, 100, "highest number of attempts at a scan")


SCANS_GROUP = FieldGroup(
    "Scans",
    "",
    (
        replace(TEXTURES, doc=f"names of the plates, two or more: {CATALOGUE_WORDS}", default=None),
        TomlField(
            "profiles", FieldType.CHOICES,
            "velocity profiles of the scans: `slow`, `medium`, `fast`, `slow-to-fast`, "
            "`fast-to-slow`",
            tuple(profile.value for profile in VelocityProfile),
            choices=tuple(profile.value for profile in VelocityProfile),
        ),
        TomlField(
            "reference_mm_s", FieldType.NUMBER,
            "reference speed of scaled time: a window is 10 mm at any", 100.0,
            unit="mm/s", low=1, high=10_000,
        ),
    ),
)  # fmt: skip
ORDER_GROUP = FieldGroup(
    "Order",
    "order",
    (
        TomlField(
            "kind", FieldType.CHOICE,
            "`blocked`: plate by plate; `shuffled`: by the seed within each stage, plates too",
            "blocked", choices=ORDERS,
        ),
        replace(ORDER_SEED, doc="required if shuffled; the same seed always gives the same order"),
    ),
)  # fmt: skip
STAGES_GROUP = FieldGroup(
    "Stages", "stages", section_fields(StageRepeats), (StageRepeats.__doc__ or "").strip()
)
QUALITY_GROUP = FieldGroup("Quality", "quality", section_fields(ScanQuality))


def finger_groups() -> tuple[FieldGroup, ...]:
    """Return all keys of a protocol of the moving finger."""
    return name_group(), SCANS_GROUP, ORDER_GROUP, STAGES_GROUP, QUALITY_GROUP


@dataclass(frozen=True, slots=True)
class FingerProtocol:
    """A protocol of the moving finger as in its file; ``text`` is the source.

    ``order`` is ``blocked`` (plate by plate) or ``shuffled`` by ``order_seed``, in each stage.
    """

    name: str
    text: str
    textures: tuple[str, ...]
    profiles: tuple[VelocityProfile, ...]
    description: str = ""
    reference_mm_s: float = 100.0
    stages: StageRepeats = StageRepeats()
    quality: ScanQuality = ScanQuality()
    order: str = "blocked"
    order_seed: int = 0

    def plan(self, stages: Collection[Stage], seed: int | None = None) -> FingerPlan:
        """Return the plan of some stages, in their order; ``seed`` overrides that of the file.

        Raises WrongUse for a wrong seed.
        """
        used = self.order_seed if seed is None else checked_seed(seed)
        random = Random(used)
        trials = [trial for stage in Stage for trial in self._trials(stage, random)]
        chosen = [trial for trial in trials if trial.stage in stages]
        numbered = (replace(trial, trial_id=i) for i, trial in enumerate(chosen, start=1))
        return FingerPlan(self, used, tuple(numbered))

    def _trials(self, stage: Stage, random: Random) -> list[FingerTrial]:
        repeats = range(1, self.stages.of(stage) + 1)
        trials = [
            FingerTrial(0, stage, texture, profile, repeat)
            for texture, repeat, profile in product(self.textures, repeats, self.profiles)
        ]
        return shuffled(trials, random) if self.order == "shuffled" else trials


@dataclass(frozen=True)
class FingerPlan:
    """The ordered scans. Plans with the same ``hash`` have the same scans and limits."""

    protocol: FingerProtocol
    seed: int
    trials: tuple[FingerTrial, ...]

    @property
    def duration_s(self) -> float:
        """Estimate of the time that a person needs."""
        return SECONDS_PER_TRIAL * len(self.trials)

    @property
    def bytes_estimate(self) -> int:
        """Size on disk."""
        return round(BYTES_PER_SECOND * self.duration_s)

    @cached_property
    def hash(self) -> str:
        """Digest of scans, limits and reference speed, 32 hexadecimal digits."""
        return digest_of([self.protocol.quality, self.protocol.reference_mm_s, *self.trials])


def load_finger_protocol(path: Path) -> FingerProtocol:
    """Load a protocol of the moving finger. Raises ProtocolError."""
    return _parse(TomlText.read(path, ProtocolError), path.stem)


def parse_finger_protocol(text: str, name: str) -> FingerProtocol:
    """Parse a protocol of the moving finger from ``text``; ``name`` is for messages."""
    return _parse(TomlText(name, text, ProtocolError), Path(name).stem)


def _parse(text: TomlText, stem: str) -> FingerProtocol:
    root = text.root
    order = root.table("order")
    names, scans = name_group(stem).read(root), SCANS_GROUP.read(root)
    ordered = ORDER_GROUP.read(order)
    protocol = FingerProtocol(
        text=text.source,
        **names,
        textures=scans["textures"],
        profiles=tuple(map(VelocityProfile, scans["profiles"])),
        reference_mm_s=scans["reference_mm_s"],
        stages=read_section(root.table("stages"), StageRepeats),
        quality=_quality(root.table("quality")),
        order=ordered["kind"],
        order_seed=ordered["seed"],
    )
    for table in (order, root):
        table.finish()
    _validate(protocol, root, order)
    return protocol


def _quality(table: TomlTable) -> ScanQuality:
    quality = read_section(table, ScanQuality)
    speeds = ("slowest_mm_s", "slow_max_mm_s", "fast_min_mm_s", "fastest_mm_s")
    for lower, upper in pairwise(speeds):
        if getattr(quality, lower) >= getattr(quality, upper):
            table.fail(upper, f"must be above {lower}, which is {getattr(quality, lower):g} mm/s")
    return quality


def _validate(protocol: FingerProtocol, root: TomlTable, order: TomlTable) -> None:
    if len(protocol.textures) < 2:
        root.fail("textures", "a classifier needs at least two plates")
    if protocol.order == "shuffled" and "seed" not in order:
        order.fail("seed", "is missing: a shuffled order needs a written seed, such as seed = 1")
    repeats = sum(protocol.stages.of(stage) for stage in Stage)
    trials = repeats * len(protocol.textures) * len(protocol.profiles)
    if not 1 <= trials <= MAX_SCANS:
        root.fail("stages", f"make {trials:,} scans; a protocol has 1 to {MAX_SCANS:,}")
