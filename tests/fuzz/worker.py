"""One kind's mutated files in a process of its own, which may die."""

from __future__ import annotations

import faulthandler
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from tests.fuzz.guard import Finding, Guard
from tests.fuzz.kind import Kind

PRISTINE = "pristine"
DEATHS = "death.txt"


@dataclass(frozen=True)
class Case:
    """One mutated case: its number, what was done to it, and what went wrong."""

    number: int
    mutation: str
    findings: tuple[Finding, ...]


class Worker:
    """Makes and judges the cases of one kind below a workplace, each from its own seed."""

    def __init__(self, kind: Kind, workplace: Path, seed: int) -> None:
        self._kind, self._seed = kind, seed
        self._pristine = workplace / PRISTINE
        if not self._pristine.exists():
            draft = workplace / "draft"
            draft.mkdir(parents=True)
            kind.build(draft)
            draft.rename(self._pristine)
        self._workplace = workplace / str(os.getpid())
        self._workplace.mkdir(exist_ok=True)
        self._guard = Guard(self._workplace)
        self._guided_file: Path | None = None

    def prepare(self, limited: bool = True) -> None:
        """Read the whole case, as the measure of time, memory and content; limit the memory."""
        folder = self._copy(-1)
        self._guard.measure(self._kind, folder)
        first = self._kind.doors[0](folder)
        self._content = self._kind.content(folder, first) if self._kind.content else None
        largest = max(p.stat().st_size for p in self._pristine.rglob("*") if p.is_file())
        shutil.rmtree(folder)
        if limited:
            self._guard.limit_memory(largest)

    def cases(self, numbers: Sequence[int], begins: Callable[[int], None]) -> Iterator[Case]:
        """Yield the cases with these numbers; ``begins`` hears of each before it is read."""
        with (self._workplace / DEATHS).open("w") as deaths:
            faulthandler.enable(deaths)
            for number in numbers:
                begins(number)
                yield self.case(number)
            faulthandler.disable()

    def case(self, number: int) -> Case:
        """Make and judge one case."""
        folder = self._copy(number)
        mutation = self.mutate(folder, number)
        doors = self._kind.choose_doors(Random(number))
        findings = self._guard.judge(self._kind, folder, self._content, doors)
        remove(folder)
        return Case(number, mutation, tuple(findings))

    def again(self, kept: Path) -> Case:
        """Judge a case that was kept, through every door."""
        folder = self._workplace / "again"
        shutil.copytree(kept, folder, symlinks=True)
        findings = self._guard.judge(self._kind, folder, self._content, self._kind.doors)
        return Case(-1, str(kept), tuple(findings))

    def seed_bytes(self, number: int) -> bytes:
        """Return the bytes of the kind's first file: whole at number 0, else damaged."""
        folder = self._copy(number)
        target = min(folder.glob(self._kind.places[0].pattern))
        if number:
            self._kind.places[0].mutations[number % len(self._kind.places[0].mutations)](
                Random(number), target
            )
        data = target.read_bytes()
        remove(folder)
        return data

    def judge_bytes(self, data: bytes) -> list[Finding]:
        """Judge a case whose first file has these bytes."""
        folder = self._workplace / "guided"
        if self._guided_file is None:
            self._copy(-2).rename(folder)
            self._guided_file = min(folder.glob(self._kind.places[0].pattern))
        self._guided_file.write_bytes(data)  # a reading may have removed it, as a dead engine's
        return self._guard.judge(self._kind, folder, self._content, self._kind.doors)

    def rebuild(self, number: int, kept: Path) -> None:
        """Make a case once more, without reading it, and keep it as evidence."""
        folder = self._copy(number)
        mutation = self.mutate(folder, number)
        (kept.parent / "mutation.txt").write_text(mutation, encoding="utf-8", errors="replace")
        for path in folder.rglob("*"):
            if path.is_fifo():
                path.unlink()
                path.with_name(f"{path.name}.was-a-pipe").touch()
        shutil.copytree(folder, kept, symlinks=True)
        remove(folder)

    def mutate(self, folder: Path, number: int) -> str:
        """Damage a copy as the case's number says."""
        return self._kind.mutate(Random(f"{self._seed} {self._kind.name} {number}"), folder)

    def _copy(self, number: int) -> Path:
        folder = self._workplace / f"case{number}"
        remove(folder)
        shutil.copytree(self._pristine, folder)
        folder.chmod(0o700)
        self._kind.settle(folder)
        return folder


def remove(folder: Path) -> None:
    """Remove a case's folder, also one with files that may not be read."""
    shutil.rmtree(folder, ignore_errors=True)
