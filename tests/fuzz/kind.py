"""A kind of file: how a small whole one is made, how it is damaged, and all that reads it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

Mutation = Callable[[Random, Path], str]
"""Damages a file or a folder in place and returns in words what it did."""
NEEDS_WHOLE_FILE = "change_whole_file"
"""Name of the mutations that come before others."""
Door = Callable[[Path], object]
"""A way to read a case's folder: returns or raises a RigctlError."""
Content = Callable[[Path, Any], object]
"""What an accepted case says, from its folder and what its first door returned; or None."""


class Place(NamedTuple):
    """Files of a case (a pattern, ``.`` for the folder itself) and what may happen to them."""

    pattern: str
    mutations: tuple[Mutation, ...]


@dataclass(frozen=True)
class Kind:
    """One kind of file.

    ``build`` fills an empty folder with a whole case. Of ``places`` one is chosen for each mutated
    file. ``doors`` read the folder. ``content``, where a kind proves itself, returns what the files
    say if the first door accepts them. ``guided``: a fuzzer
    that watches the program's branches works on it, too. ``most``: how many places of a case are
    damaged. ``settle`` adapts a copy to its place.
    """

    name: str
    build: Callable[[Path], None]
    places: tuple[Place, ...]
    doors: tuple[Door, ...]
    content: Content | None = None
    guided: bool = False
    most: int = 3
    settle: Callable[[Path], None] = lambda folder: None

    def choose_doors(self, random: Random) -> tuple[Door, ...]:
        """Return the first door, which judges, and one of the others."""
        return self.doors[:1] + tuple(random.sample(self.doors[1:], min(1, len(self.doors) - 1)))

    def mutate(self, random: Random, folder: Path) -> str:
        """Damage one place of a case, sometimes two or three times; return what was done."""
        place = random.choice(self.places)
        targets = [folder] if place.pattern == "." else sorted(folder.glob(place.pattern))
        if not targets:
            return "nothing"
        count = min(self.most, random.choice((1, 1, 1, 1, 2, 3)))
        chosen = [(random.choice(targets), random.choice(place.mutations)) for _ in range(count)]
        # A library that changes a file must find it whole, or its own memory is damaged.
        chosen.sort(key=lambda each: each[1].__name__ != NEEDS_WHOLE_FILE)
        return "; ".join(
            f"{target.name}: {mutation(random, target)}"
            for target, mutation in chosen
            if target.exists() and not target.is_symlink()
        )
