"""What a file's name says of the trial in it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

from rigctl.errors import WrongUse
from rigctl.exchange.column_map import ImportMap
from rigctl.values import SAMPLE_RATE_HZ, PlannedTrial

LONGEST_TEXTURE_BYTES = 16
HIGHEST_REPEAT = 2**31 - 1


@dataclass(frozen=True, slots=True)
class Label:
    """One file's condition; ``repeat`` is 0 where the name does not number it."""

    texture: str
    speed_mm_s: float
    direction: str
    force_g: float
    repeat: int

    def trial(self, trial_id: int, count: int) -> PlannedTrial:
        """The trial that ``count`` samples of 1 ms make."""
        return PlannedTrial(
            trial_id,
            self.texture,
            self.speed_mm_s,
            self.force_g,
            self.repeat,
            self.speed_mm_s * count / SAMPLE_RATE_HZ,
            direction=self.direction,
        )


def label_of(path: Path, mapping: ImportMap) -> Label:
    """The label in a file's name. Raises WrongUse where the pattern does not match."""
    match = mapping.pattern.search(path.name)
    if match is None:
        raise WrongUse(
            f"{path}: its name does not match the pattern {mapping.pattern.pattern!r}: "
            "correct [files] pattern, or leave the file out"
        )
    said = {name: text for name, text in match.groupdict().items() if text is not None}
    texture = said.get("texture", mapping.texture)
    if not texture or len(texture.encode()) > LONGEST_TEXTURE_BYTES:
        raise WrongUse(
            f"{path}: its texture is {texture!r}: a texture has 1 to {LONGEST_TEXTURE_BYTES} "
            "letters, so choose another group in the pattern"
        )
    speed = _number(path, "speed", said, mapping.speed_factor, mapping.speed_mm_s)
    force_g = _number(path, "force", said, mapping.force_factor, mapping.force_g)
    repeat = _number(path, "repeat", said, 1.0, 0.0)
    if speed == 0 or force_g < 0 or not 0 <= repeat <= HIGHEST_REPEAT or repeat % 1:
        raise WrongUse(
            f"{path}: speed {speed:g} mm/s, force {force_g:g} g, repeat {repeat:g}: a trial "
            "moves, is not pulled, and is numbered by a whole number"
        )
    direction = "backward" if speed < 0 else "forward"
    return Label(texture, abs(speed), direction, force_g, int(repeat))


def numbered(labels: list[Label]) -> list[Label]:
    """The same labels, those without a repeat numbered from 1 within their condition."""
    seen: Counter[Label] = Counter()
    found = []
    for label in labels:
        seen[label] += 1
        found.append(label if label.repeat else replace(label, repeat=seen[label]))
    return found


def _number(path: Path, name: str, said: dict[str, str], factor: float, otherwise: float) -> float:
    if name not in said:
        return otherwise
    try:
        return float(said[name].replace(",", ".")) * factor
    except ValueError:
        raise WrongUse(
            f"{path}: the pattern's group {name} found {said[name]!r}, which is no number"
        ) from None
