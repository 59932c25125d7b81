"""Labels of trials, parsed from file names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from rigctl.errors import WrongUse
from rigctl.exchange.column_map import ImportMap
from rigctl.values import SAMPLE_RATE_HZ, PlannedTrial

MAX_TEXTURE_BYTES = 16
MAX_REPEAT = 2**31 - 1


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
    if not texture or len(texture.encode()) > MAX_TEXTURE_BYTES:
        raise WrongUse(
            f"{path}: its texture is {texture!r}: a texture has 1 to {MAX_TEXTURE_BYTES} "
            "letters, so choose another group in the pattern"
        )
    speed = _parse_number(path, "speed", groups, mapping.speed_factor, mapping.speed_mm_s)
    force_g = _parse_number(path, "force", groups, mapping.force_factor, mapping.force_g)
    repeat = _parse_number(path, "repeat", groups, 1.0, 0.0)
    if speed == 0 or force_g < 0 or not 0 <= repeat <= MAX_REPEAT or repeat % 1:
        raise WrongUse(
            f"{path}: speed {speed:g} mm/s, force {force_g:g} g, repeat {repeat:g}: the speed must "
            "not be 0, the force not negative, and the repeat a whole number"
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
