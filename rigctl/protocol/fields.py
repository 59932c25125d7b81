"""The keys of a protocol, declared once: the loader, the form and the reference page read them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

from rigctl.config.rig_config import RigConfig
from rigctl.config.toml_edit import Item, Value
from rigctl.config.toml_reader import INTEGER_BITS, FieldType, TomlField, TomlTable, section_fields
from rigctl.config.typed_number import typed_number
from rigctl.errors import WrongUse
from rigctl.protocol.plan import (
    DEFAULT_PROMPT,
    EACH_TRIAL,
    LIFTS,
    MAX_SEED,
    UP_DOWN,
    EarlyEnd,
    Quality,
    Settle,
    register_range,
)

_NUMBERS = (FieldType.INTEGER, FieldType.NUMBER, FieldType.INTEGERS, FieldType.NUMBERS)


def value_of(item: TomlField, typed: str) -> Value:
    """Return the value for what is typed; a list is typed as ``40, 60, 80`` or ``40; 60; 80``.

    A comma between two digits of a list of numbers may be its decimal mark or not: ``40,60`` stays
    a text unless semicolons separate the numbers.
    """
    if not item.type.is_list:
        return _item(item, typed)
    parts = [part.strip() for part in _separated(item, typed)]
    while parts and not parts[-1]:
        parts.pop()
    is_clear = ";" in typed
    return [part if "," in part and not is_clear else _item(item, part) for part in parts]


def typed_of(value: Any) -> str:
    """Return what a person would type for a value; empty for None."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return ", ".join(map(typed_of, value))
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def help_of(item: TomlField) -> str:
    """Return a sentence of help for a key: its meaning, its range and its default."""
    meaning = item.doc.replace("`", "")
    reach = f"{_short(item.low)} to {_short(item.high)}" if item.high else ""
    unit = f" {item.unit}" if item.unit and reach else ""
    has_default = item.default not in (None, (), "") and item.type is not FieldType.CHOICES
    default = f"default {typed_of(item.default)}" if has_default else ""
    return "; ".join(part for part in (meaning, f"{reach}{unit}", default) if part)


def default_of(item: TomlField) -> str:
    """Return the default of a key in a word or two; a long one stands in the help."""
    if item.default is None:
        return "needed"
    if item.default in ((), ""):
        return "none"
    if item.type is FieldType.CHOICES:
        return "all"
    return "the default" if item.type is FieldType.TEXT else typed_of(item.default)


def _short(number: float) -> str:
    whole = f"{int(number):,}".replace(",", "\u202f")  # a comma would be a decimal mark
    return whole if number == int(number) else f"{number:g}"


def _separated(item: TomlField, typed: str) -> list[str]:
    if item.type not in _NUMBERS:
        return typed.split(",")
    return typed.split(";") if ";" in typed else re.split(r",(?![0-9])", typed)


def _item(item: TomlField, typed: str) -> Item:
    return _number(typed) if item.type in _NUMBERS else typed


def _number(typed: str) -> Item:
    try:
        number = typed_number(typed)
    except WrongUse:
        return typed.strip()
    is_whole = number.as_tuple().exponent == 0 and int(number).bit_length() <= INTEGER_BITS
    value = int(number) if is_whole else float(number)
    return value if isfinite(value) else typed.strip()


PLACES = ("start", "plate_start", "between_plates", "plate_end", "end", "every", "drift")
DIRECTIONS = ("forward", "backward", "alternate")
FORCE_MODES = ("hold", "lock", "position")
ORDERS = ("blocked", "shuffled")
TRIAL_ORDERS = (*ORDERS, UP_DOWN)
MAX_TRIALS = 100_000
MAX_TEXTURES = 1000
MAX_MOUNTS = 100
MAX_PROMPT_LETTERS = 300
MAX_DESCRIPTION_LETTERS = 10_000
MAX_SECONDS = 86_400.0
MAX_TURNS = 100
MAX_DRIFT_G = 10.0
"""The board takes no tare that is further from the last one."""
TEXTURE_BYTES = 16
"""Length of a texture's name in a session's trial row."""

NAME = TomlField(
    "name", FieldType.NAME, "name of the protocol in the session; else that of the file", ""
)
DESCRIPTION = TomlField(
    "description", FieldType.TEXT, "for people", "", most=MAX_DESCRIPTION_LETTERS, has_lines=True
)
CATALOGUE_WORDS = "A smooth, B–F circular ridges, G–K rectangular ridges, L–P waves"
TEXTURES = TomlField(
    "textures", FieldType.NAMES, f"names of the plates, up to 16 bytes each: {CATALOGUE_WORDS}", (),
    most=MAX_TEXTURES, longest_bytes=TEXTURE_BYTES, title="Plates",
)  # fmt: skip
ORDER_SEED = TomlField(
    "seed", FieldType.INTEGER,
    "required if shuffled; the same seed always gives the same order. "
    "`rigctl run --seed` replaces it",
    0, low=0, high=MAX_SEED,
)  # fmt: skip
FORCE_MODE = TomlField(
    "force_mode", FieldType.CHOICE,
    "`hold`: the force loop stays closed while the drum turns; `lock`: reach the force, then "
    "keep the position; `position`: press to a depth below contact",
    "hold", choices=FORCE_MODES,
)  # fmt: skip
PLACE = TomlField("at", FieldType.CHOICE, "when the step runs", choices=PLACES)
STEP_KINDS = {
    "tare": "sets the reading of the lifted, still load cell as zero",
    "rest": "waits, lifted",
    "approach_only": "presses without motion, holds, lifts",
    "baseline": "records without contact",
    "turn": "turns the lifted drum at constant speed, so that the index mark times whole turns; "
    "a virtual data set leaves it out",
    "message": "shows a text; with `wait`, the run continues when a person acknowledges it",
}
"""The kinds of free steps, and what each does."""
KIND = TomlField("kind", FieldType.CHOICE, "what the step does", choices=tuple(STEP_KINDS))
EVERY = TomlField(
    "trials", FieldType.INTEGER, "trials between two such steps", low=1, high=MAX_TRIALS
)
DRIFT_LIMIT = TomlField(
    "limit_g", FieldType.NUMBER, "lifted reading that asks for the tare", unit="g",
    low=0.5, high=MAX_DRIFT_G,
)  # fmt: skip
OF_PLACE = {"every": EVERY, "drift": DRIFT_LIMIT}
"""The key that a place needs besides those of the kind."""


@dataclass(frozen=True, slots=True)
class FieldGroup:
    """Keys of one table that belong together; ``table`` is empty for the root."""

    title: str
    table: str
    fields: tuple[TomlField, ...]
    doc: str = ""

    def read(self, table: TomlTable) -> dict[str, Any]:
        """Return the checked values by key."""
        return {item.key: item.read(table) for item in self.fields}


def name_group(stem: str = "") -> FieldGroup:
    """Return what a protocol is called; ``stem`` is the name of its file."""
    return FieldGroup("Protocol", "", (replace(NAME, default=stem), DESCRIPTION))


def trials_group(config: RigConfig) -> FieldGroup:
    """Return the conditions, within the limits of a rig."""
    return FieldGroup(
        "Trials",
        "",
        (
            TEXTURES,
            TomlField(
                "speeds_mm_s", FieldType.NUMBERS, "surface speeds", (), **speed_range(config)
            ),
            TomlField(
                "forces_g", FieldType.NUMBERS, "forces, in the modes `hold` and `lock`", (),
                **force_range(config),
            ),
            TomlField(
                "depths_mm", FieldType.NUMBERS,
                "depths below contact instead of forces, in the mode `position`", (),
                unit="mm", **register_range("depth_set_um", 1e-3),
            ),
            TomlField(
                "repeats", FieldType.INTEGER, "of each plate, speed and force", 1,
                low=1, high=MAX_TRIALS,
            ),
            TomlField(
                "mounts", FieldType.INTEGER,
                "how often each plate is mounted, with `repeats` of each speed and force every "
                "time",
                1, low=1, high=MAX_MOUNTS,
            ),
        ),
        "Every plate with every speed and every force, as often as repeats says.",
    )  # fmt: skip


TRIAL_GROUP = FieldGroup(
    "Trial",
    "trial",
    (
        TomlField(
            "travel_mm", FieldType.NUMBER,
            "texture travel of the recorded window; its duration is travel over speed", 240.0,
            unit="mm", **register_range("travel_set"),
        ),
        FORCE_MODE,
        TomlField(
            "direction", FieldType.CHOICE, "`forward`, `backward`, or `alternate` by repeat",
            "forward", choices=DIRECTIONS,
        ),
        TomlField(
            "lift", FieldType.CHOICE,
            "`trial`: the drum lifts after each trial; `condition`: it stays in contact between "
            "the repeats of a plate, speed and force",
            EACH_TRIAL, choices=LIFTS,
        ),
    ),
)  # fmt: skip
ORDER_GROUP = FieldGroup(
    "Order",
    "order",
    (
        TomlField(
            "kind", FieldType.CHOICE,
            "`blocked`: plate by plate, then force by force, speed by speed, repeats last; "
            "`shuffled`: by the seed, within each plate; `up-down`: plate by plate, the forces "
            "rise in the first repeat, fall in the second, and so on; all speeds at each force",
            "blocked", choices=TRIAL_ORDERS,
        ),
        ORDER_SEED,
        TomlField(
            "across_plates", FieldType.FLAG,
            "shuffle the plates too, with a plate change before nearly every trial", False,
        ),
    ),
)  # fmt: skip
SETTLE_GROUP = FieldGroup("Settling", "settle", section_fields(Settle))
QUALITY_GROUP = FieldGroup("Quality", "quality", section_fields(Quality))
EARLY_END_GROUP = FieldGroup("Early end", "early_end", section_fields(EarlyEnd))
PLATES_GROUP = FieldGroup(
    "Plates",
    "plates",
    (
        TomlField(
            "prompt", FieldType.TEXT,
            "what a person reads at a plate change; `{texture}` becomes the plate's name",
            DEFAULT_PROMPT, most=MAX_PROMPT_LETTERS,
        ),
    ),
)  # fmt: skip


def field_groups(config: RigConfig) -> tuple[FieldGroup, ...]:
    """Return all keys of a protocol but those of its free steps."""
    return (
        name_group(),
        trials_group(config),
        TRIAL_GROUP,
        ORDER_GROUP,
        SETTLE_GROUP,
        QUALITY_GROUP,
        EARLY_END_GROUP,
        PLATES_GROUP,
    )


def step_fields(config: RigConfig) -> Mapping[str, tuple[TomlField, ...]]:
    """Return the keys of each kind of free step."""
    seconds = TomlField("seconds", FieldType.NUMBER, unit="s", low=0.01, high=MAX_SECONDS)
    force = TomlField("force_g", FieldType.NUMBER, "force of the press", **force_range(config))
    speed = TomlField(
        "speed_mm_s", FieldType.NUMBER, "surface speed of the drum", **speed_range(config)
    )
    turns = TomlField("turns", FieldType.INTEGER, "whole turns", low=1, high=MAX_TURNS)
    wait = "wait until a person acknowledges it"
    return {
        "tare": (),
        "rest": (replace(seconds, doc="wait with the drum lifted"),),
        "approach_only": (force, replace(seconds, doc="hold of the force")),
        "baseline": (replace(seconds, doc="record without contact"),),
        "turn": (speed, turns),
        "message": (
            TomlField("text", FieldType.TEXT, "what a person reads"),
            TomlField("wait", FieldType.FLAG, wait, False),
        ),
    }


def speed_range(config: RigConfig) -> dict[str, Any]:
    """Return unit and range of a speed in contact."""
    limits = config.limits
    return {"unit": "mm/s", "low": limits.speed_min_mm_s, "high": limits.speed_max_mm_s}


def force_range(config: RigConfig) -> dict[str, Any]:
    """Return unit and range of a force."""
    limits = config.limits
    return {"unit": "g", "low": limits.force_min_g, "high": limits.force_max_g}
