"""Labels of trials: texture, speed, force, repeat, mount, from names and columns; their units."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import pi
from pathlib import Path
from unicodedata import normalize

from rigctl.config.text_file import name_problem, shorten
from rigctl.config.toml_reader import TomlTable
from rigctl.errors import WrongUse
from rigctl.protocol.fields import TEXTURE_BYTES
from rigctl.values import SAMPLE_RATE_HZ, PlannedTrial

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "d": 86_400.0}
RPM, KPA = "rpm", "kPa"
LEVEL, DEPTH = "level", "mm"
"""Units of a force label that is no force: a number without unit, and a depth of pressing."""
MM_PER_S = {
    "mm/s": 1.0,
    "cm/s": 10.0,
    "m/s": 1000.0,
    "mm/min": 1 / 60,
    "m/min": 1000 / 60,
    "inch/s": 25.4,
    "inch/min": 25.4 / 60,
    RPM: 2 * pi / 60,
}
"""Factors to mm/s; that of ``rpm`` for a radius of 1 mm."""
GRAMS = {"g": 1.0, "kg": 1000.0, "N": 101.971621, "mN": 0.101971621, KPA: 0.101971621}
"""Factors to g; that of ``kPa`` for an area of 1 mm²."""
LABEL_GRAMS = {**GRAMS, LEVEL: 1.0, DEPTH: 1.0}
MAX_FACTOR = 1e9
SIZE_UNITS = {"radius_mm": "mm", "area_mm2": "mm²"}


@dataclass(frozen=True, slots=True)
class Conversion:
    """The factor from a value of the files to mm/s or g, and the unit that the map names."""

    factor: float = 1.0
    unit: str = ""


def read_unit(
    table: TomlTable,
    key: str,
    factors: Mapping[str, float],
    default: str,
    sized: str,
    size_key: str,
) -> Conversion:
    """Return the factor of the unit, or the map's own; the unit ``sized`` needs a length or area.

    Raises ConfigError.
    """
    unit, factor_key = table.choice(key, factors, default), key.replace("unit", "factor")
    table.allow(size_key, factor_key)
    if factor_key in table:
        if key in table or size_key in table:
            table.fail(factor_key, f"stands in place of {key}: give one of them")
        return Conversion(table.number(factor_key, low=1 / MAX_FACTOR, high=MAX_FACTOR), default)
    if unit != sized:
        if size_key in table:
            table.fail(size_key, f"belongs to {key} = {sized!r}, not to {unit!r}")
        return Conversion(factors[unit], unit)
    size_unit = SIZE_UNITS[size_key]
    if size_key not in table:
        table.fail(key, f"{unit} needs {size_key}, in {size_unit}")
    size = table.number(size_key, unit=size_unit, low=1e-3, high=1e6)
    return Conversion(factors[unit] * size, unit)


LABELS = ("texture", "speed", "force", "repeat", "mount")
MAX_NUMBER = 2**31 - 2
UNNUMBERED = -1
MAX_SPEED_MM_S, MAX_FORCE_G = 1e5, 1e6
MAX_MOUNT = 1_000_000


@dataclass(frozen=True, slots=True)
class LabelRules:
    """Where each label comes from: a group of ``pattern``, a column, or one value for all.

    ``pattern`` is searched in a file's name, and in its whole path where it contains ``/``.
    ``columns``: column or field by label. ``renamed``: texture by label text.
    """

    pattern: re.Pattern[str]
    columns: Mapping[str, str] = field(default_factory=dict)
    renamed: Mapping[str, str] = field(default_factory=dict)
    texture: str = ""
    speed_mm_s: float = 0.0
    force_g: float = 0.0
    mount: int = 1
    speed: Conversion = field(default_factory=Conversion)
    force: Conversion = field(default_factory=Conversion)

    @property
    def names_force(self) -> bool:
        """Whether each trial has a force label of its own."""
        return "force" in self.pattern.groupindex or "force" in self.columns


@dataclass(frozen=True, slots=True)
class TrialLabel:
    """The condition of one trial; ``repeat`` is -1 where nothing numbers it.

    ``depth``: ``force_g`` is a depth in mm.
    """

    texture: str
    speed_mm_s: float
    direction: str
    force_g: float
    repeat: int
    mount: int = 1
    depth: bool = False

    def trial(self, trial_id: int, count: int) -> PlannedTrial:
        """Return the trial of ``count`` samples of 1 ms."""
        return PlannedTrial(
            trial_id,
            self.texture,
            self.speed_mm_s,
            self.force_g,
            self.repeat,
            self.speed_mm_s * count / SAMPLE_RATE_HZ,
            force_mode="position" if self.depth else "hold",
            direction=self.direction,
            depth_mm=self.force_g if self.depth else 0.0,
            mount=self.mount,
        )


def read_label_rules(files: TomlTable, labels: TomlTable, textures: TomlTable) -> LabelRules:
    """Return the rules of ``[files] pattern``, ``[labels]`` and ``[textures]``.

    Raises ConfigError for a texture or a speed from nowhere, and for one from two places.
    """
    rules = LabelRules(
        pattern=_read_pattern(files),
        columns=_read_columns(labels),
        renamed={normalize("NFC", key): textures.text(key) for key in textures},
        texture=labels.text("texture", ""),
        speed_mm_s=labels.number("speed_mm_s", 0.0, unit="mm/s", low=0, high=MAX_SPEED_MM_S),
        force_g=labels.number("force_g", 0.0, unit="g", low=0, high=MAX_FORCE_G),
        mount=labels.integer("mount", 1, low=1, high=MAX_MOUNT),
        speed=read_unit(labels, "speed_unit", MM_PER_S, "mm/s", RPM, "radius_mm"),
        force=read_unit(labels, "force_unit", LABEL_GRAMS, "g", KPA, "area_mm2"),
    )
    _check_sources(rules, files, labels)
    for key, name in rules.renamed.items():
        if problem := name_problem(name, TEXTURE_BYTES):
            textures.fail(key, problem)
    return rules


def parse_label(path: Path, rules: LabelRules, texts: Mapping[str, str], place: str) -> TrialLabel:
    """Return the label of a trial from its file's name and the ``texts`` of its label columns.

    ``place`` names the trial in messages. Raises WrongUse where the pattern does not match, and
    for labels that no trial can have.
    """
    found = {**_match(path, rules.pattern), **texts}
    # macOS writes an umlaut as two letters, other systems as one: both are one texture.
    texture = normalize("NFC", found.get("texture", rules.texture))
    texture = rules.renamed.get(texture, texture)
    if problem := name_problem(texture, TEXTURE_BYTES):
        raise WrongUse(
            f"{place}: its texture {problem}; choose another label, or name it in [textures]"
        )
    speed = _parse_number(place, "speed", found, rules.speed.factor, rules.speed_mm_s)
    force_g = _parse_number(place, "force", found, rules.force.factor, rules.force_g)
    repeat = _parse_number(place, "repeat", found, 1.0, UNNUMBERED)
    first = 0 if "repeat" in found else UNNUMBERED
    mount = _parse_number(place, "mount", found, 1.0, rules.mount)
    possible = abs(speed) <= MAX_SPEED_MM_S and force_g <= MAX_FORCE_G
    if not possible or speed == 0 or force_g < 0 or not first <= repeat <= MAX_NUMBER or repeat % 1:
        raise WrongUse(
            f"{place}: speed {speed:g} mm/s, force {force_g:g} g, repeat {repeat:g}: the speed "
            "must not be 0, the force not negative, the repeat a whole number, and none huge"
        )
    if not 1 <= mount <= MAX_MOUNT or mount % 1:
        raise WrongUse(f"{place}: its mount is {mount:g}: give a whole number from 1")
    direction = "backward" if speed < 0 else "forward"
    is_depth = rules.force.unit == DEPTH and rules.names_force
    return TrialLabel(texture, abs(speed), direction, force_g, int(repeat), int(mount), is_depth)


def number_repeats(labels: Iterable[TrialLabel]) -> list[TrialLabel]:
    """Return the labels, those without a repeat numbered from 1 within their condition.

    A session counts repeats from 1: all are one higher where those of the files begin at 0.
    """
    labels = list(labels)
    shift = int(any(label.repeat == 0 for label in labels))
    counts: Counter[TrialLabel] = Counter()
    numbered = []
    for label in labels:
        counts[label] += 1
        repeat = counts[label] if label.repeat == UNNUMBERED else label.repeat + shift
        numbered.append(replace(label, repeat=repeat))
    return numbered


def refuse_collisions(labels: Sequence[TrialLabel], places: Sequence[str]) -> None:
    """Raise WrongUse for two trials of one label."""
    first: dict[TrialLabel, str] = {}
    for label, place in zip(labels, places, strict=True):
        if label in first:
            sign = "-" if label.direction == "backward" else ""
            raise WrongUse(
                f"{first[label]} and {place} are both {label.texture} at {sign}"
                f"{label.speed_mm_s:g} mm/s, {label.force_g:g} g, repeat {label.repeat}, mount "
                f"{label.mount}: correct the map's labels, or leave out repeat to number them"
            )
        first[label] = place


def _match(path: Path, pattern: re.Pattern[str]) -> dict[str, str]:
    """Return the pattern's groups in a file's name, or in its path if the pattern has a ``/``."""
    by_path = "/" in pattern.pattern
    name = path.absolute().as_posix() if by_path else path.name
    match = pattern.search(normalize("NFC", name))
    if match is None:
        raise WrongUse(
            f"{path}: its {'path' if by_path else 'name'} does not match the pattern "
            f"{shorten(pattern.pattern, 300)!r}: correct [files] pattern, or leave the file out"
        )
    return {name: text for name, text in match.groupdict().items() if text is not None}


def _read_pattern(table: TomlTable) -> re.Pattern[str]:
    """Return the compiled pattern."""
    try:
        pattern = re.compile(normalize("NFC", table.text("pattern", "")))
    except (re.error, OverflowError, RecursionError) as error:
        table.fail("pattern", f"is not a regular expression: {error}")
    for group in pattern.groupindex:
        if group not in LABELS:
            table.fail("pattern", f"has a group {group!r}: groups are {', '.join(LABELS)}")
    return pattern


def _read_columns(labels: TomlTable) -> dict[str, str]:
    columns = {label: labels.text(f"{label}_column", "") for label in LABELS}
    return {label: column for label, column in columns.items() if column}


def _check_sources(rules: LabelRules, files: TomlTable, labels: TomlTable) -> None:
    """Fail where a label has two sources, or texture or speed has none."""
    groups = rules.pattern.groupindex
    for label, column in rules.columns.items():
        if label in groups:
            labels.fail(
                f"{label}_column",
                f"{column!r} and the pattern's group {label} both give the {label}: leave out one",
            )
    if "texture" not in (*groups, *rules.columns) and not rules.texture:
        files.fail("pattern", "has no group texture, and [labels] names none for all files")
    if "speed" not in (*groups, *rules.columns) and not rules.speed_mm_s:
        files.fail("pattern", "has no group speed, and [labels] has no speed_mm_s for all files")


def _parse_number(
    place: str, name: str, found: Mapping[str, str], factor: float, default: float
) -> float:
    if name not in found:
        return default
    try:
        return float(found[name].replace(",", ".")) * factor
    except ValueError:
        raise WrongUse(
            f"{place}: its {name} is {shorten(found[name])!r}, which is not a number"
        ) from None
