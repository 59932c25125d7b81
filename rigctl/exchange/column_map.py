"""The column map ``MAP.toml``: the columns of a recording, and the labels in its file name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import re2

from rigctl.config.names import name_problem
from rigctl.config.toml_reader import TomlTable, TomlText
from rigctl.errors import ConfigError, WrongUse
from rigctl.protocol.loader import TEXTURE_BYTES
from rigctl.values import SAMPLE_RATE_HZ, PlannedTrial

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
MM_PER_S = {"mm/s": 1.0, "cm/s": 10.0, "m/s": 1000.0}
GRAMS = {"g": 1.0, "kg": 1000.0, "N": 101.971621, "mN": 0.101971621, "level": 1.0}
LABELS = ("texture", "speed", "force", "repeat")
MAX_RATE_HZ = 1e7
MAX_VALUE = 1e300
LOW_PASS_HZ, LOW_PASS_MAX_HZ = 400.0, 499.0
MAX_REPEAT = 2**31 - 1
MAX_SPEED_MM_S, MAX_FORCE_G = 1e5, 1e6


@dataclass(frozen=True, slots=True)
class ImportMap:
    """A validated map. Columns are names, numbers from 1, or ranges ``first..last`` of these.

    ``time_column`` is empty where ``rate_hz`` is given. Factors convert the values of the file
    to s, mm/s and g. ``texture``, ``speed_mm_s``, ``force_g`` apply where the pattern, compiled by
    RE2, has no such group. ``max_gap_s``: 0 for three times the median interval of rows.
    ``taxel_low``, ``taxel_high``: values that are stored as 0 and 65535; equal for each taxel's
    own lowest and highest. ``low_pass_hz``: cutoff of the filter before rows faster than 1 kHz
    are decimated, 0 for none.
    """

    name: str
    text: str
    sensor: str
    pattern: Any
    variable: str
    delimiter: str
    transpose: bool
    taxels: tuple[str, ...]
    unit: str
    taxel_low: float
    taxel_high: float
    time_column: str
    time_s: float
    rate_hz: float
    texture: str
    speed_mm_s: float
    speed_factor: float
    force_g: float
    force_factor: float
    force_unit: str
    loadcell: str
    loadcell_factor: float
    extra: tuple[str, ...]
    max_gap_s: float
    outlier_sigma: float
    finest_mm: float
    low_pass_hz: float


@dataclass(frozen=True, slots=True)
class FileLabel:
    """The condition of one file; ``repeat`` is 0 where the name has no number."""

    texture: str
    speed_mm_s: float
    direction: str
    force_g: float
    repeat: int

    def trial(self, trial_id: int, count: int) -> PlannedTrial:
        """Return the trial of ``count`` samples of 1 ms."""
        return PlannedTrial(
            trial_id,
            self.texture,
            self.speed_mm_s,
            self.force_g,
            self.repeat,
            self.speed_mm_s * count / SAMPLE_RATE_HZ,
            direction=self.direction,
        )


def load_map(path: Path) -> ImportMap:
    """Load and validate a map. Raises ConfigError naming file, line and key."""
    text = TomlText.read(path, ConfigError)
    root = text.root
    name, sensor = root.text("name", path.stem), root.text("sensor", "")
    files, time, taxels = root.table("files"), root.table("time"), root.table("taxels")
    labels, loadcell, quality = root.table("labels"), root.table("loadcell"), root.table("quality")
    root.allow("extra")
    extra = root.table("extra").texts("columns") if "extra" in root else ()
    root.finish()
    mapping = ImportMap(
        name=name,
        text=text.source,
        sensor=sensor,
        pattern=_read_pattern(files),
        variable=files.text("variable", ""),
        delimiter=_read_delimiter(files),
        transpose=files.flag("transpose", False),
        taxels=taxels.texts("columns"),
        unit=taxels.text("unit", ""),
        taxel_low=taxels.number("low", 0.0, low=-MAX_VALUE, high=MAX_VALUE),
        taxel_high=taxels.number("high", 0.0, low=-MAX_VALUE, high=MAX_VALUE),
        time_column=time.text("column", ""),
        time_s=SECONDS[time.choice("unit", SECONDS, "s")],
        rate_hz=time.number("rate_hz", 0.0, unit="Hz", low=0, high=MAX_RATE_HZ),
        texture=labels.text("texture", ""),
        speed_mm_s=labels.number("speed_mm_s", 0.0, unit="mm/s", low=0, high=MAX_SPEED_MM_S),
        speed_factor=MM_PER_S[labels.choice("speed_unit", MM_PER_S, "mm/s")],
        force_g=labels.number("force_g", 0.0, unit="g", low=0, high=MAX_FORCE_G),
        force_factor=GRAMS[labels.choice("force_unit", GRAMS, "g")],
        force_unit=labels.text("force_unit", "g"),
        loadcell=loadcell.text("column", ""),
        loadcell_factor=GRAMS[loadcell.choice("unit", GRAMS, "g")],
        extra=extra,
        max_gap_s=quality.number("max_gap_s", 0.0, unit="s", low=0, high=1e6),
        outlier_sigma=quality.number("outlier_sigma", 12.0, low=3, high=1e6),
        finest_mm=quality.number("finest_mm", 1.0, unit="mm", low=1e-3, high=1e4),
        low_pass_hz=quality.number(
            "low_pass_hz", LOW_PASS_HZ, unit="Hz", low=0, high=LOW_PASS_MAX_HZ
        ),
    )
    for table in (files, time, taxels, labels, loadcell, quality):
        table.finish()
    _check_labels(mapping, files)
    if bool(mapping.time_column) == bool(mapping.rate_hz):
        time.fail("column", "give either a time column, or rate_hz of rows without gaps")
    if mapping.taxel_low > mapping.taxel_high:
        taxels.fail("high", "is below low")
    return mapping


def parse_label(path: Path, mapping: ImportMap) -> FileLabel:
    """Parse the name of a file. Raises WrongUse where the pattern does not match."""
    match = mapping.pattern.search(path.name)
    if match is None:
        raise WrongUse(
            f"{path}: its name does not match the pattern {mapping.pattern.pattern!r}: "
            "correct [files] pattern, or leave the file out"
        )
    groups = {name: text for name, text in match.groupdict().items() if text is not None}
    texture = groups.get("texture", mapping.texture)
    if problem := name_problem(texture, TEXTURE_BYTES):
        raise WrongUse(f"{path}: its texture {problem}; choose another group in the pattern")
    speed = _parse_number(path, "speed", groups, mapping.speed_factor, mapping.speed_mm_s)
    force_g = _parse_number(path, "force", groups, mapping.force_factor, mapping.force_g)
    repeat = _parse_number(path, "repeat", groups, 1.0, 0.0)
    possible = abs(speed) <= MAX_SPEED_MM_S and force_g <= MAX_FORCE_G
    if not possible or speed == 0 or force_g < 0 or not 0 <= repeat <= MAX_REPEAT or repeat % 1:
        raise WrongUse(
            f"{path}: speed {speed:g} mm/s, force {force_g:g} g, repeat {repeat:g}: the speed must "
            "not be 0, the force not negative, the repeat a whole number, and none huge"
        )
    direction = "backward" if speed < 0 else "forward"
    return FileLabel(texture, abs(speed), direction, force_g, int(repeat))


def number_repeats(labels: Iterable[FileLabel]) -> list[FileLabel]:
    """Return the labels, those without a repeat numbered from 1 within their condition."""
    counts: Counter[FileLabel] = Counter()
    numbered = []
    for label in labels:
        counts[label] += 1
        numbered.append(label if label.repeat else replace(label, repeat=counts[label]))
    return numbered


def _read_delimiter(table: TomlTable) -> str:
    delimiter = table.text("delimiter", "")
    if len(delimiter) > 1 or delimiter in ("\n", "\r", '"'):
        table.fail("delimiter", "must be one letter between two cells, such as ';'")
    return delimiter


def _read_pattern(table: TomlTable) -> Any:
    """Return the compiled pattern; RE2 matches any in linear time, a stranger's too."""
    source = table.text("pattern", "")
    options = re2.Options()
    options.log_errors = False
    try:
        pattern = re2.compile(source, options)
    except re2.error as error:
        reason = error.args[0].decode("utf-8", "replace")
        table.fail("pattern", f"is not a regular expression: {reason}")
    for group in pattern.groupindex:
        if group not in LABELS:
            table.fail("pattern", f"has a group {group!r}: groups are {', '.join(LABELS)}")
    return pattern


def _check_labels(mapping: ImportMap, files: TomlTable) -> None:
    groups = mapping.pattern.groupindex
    if "texture" not in groups and not mapping.texture:
        files.fail("pattern", "has no group texture, and [labels] names none for all files")
    if "speed" not in groups and not mapping.speed_mm_s:
        files.fail("pattern", "has no group speed, and [labels] has no speed_mm_s for all files")


def _parse_number(
    path: Path, name: str, groups: Mapping[str, str], factor: float, default: float
) -> float:
    if name not in groups:
        return default
    try:
        return float(groups[name].replace(",", ".")) * factor
    except ValueError:
        raise WrongUse(
            f"{path}: the pattern's group {name} matches {groups[name]!r}, which is not a number"
        ) from None
