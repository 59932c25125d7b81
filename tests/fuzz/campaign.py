"""A campaign: many mutated files of every kind in processes that may die, and what they found."""

from __future__ import annotations

import multiprocessing
import re
import shutil
import signal
import sys
import time
import warnings
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkProcess
from pathlib import Path

from tests.fuzz.guard import Finding
from tests.fuzz.kinds.every_kind import KINDS
from tests.fuzz.outcome import folder_name
from tests.fuzz.worker import DEATHS, Case, Worker

BATCH = 250
SILENT_S = 120.0
"""A process that says nothing for so long hangs where no signal reaches it."""
SHOWN_EVERY_S = 10.0
_FORK = multiprocessing.get_context("fork")


@dataclass(frozen=True)
class Batch:
    """Numbers of cases of one kind."""

    kind: str
    numbers: tuple[int, ...]


@dataclass
class Running:
    """A batch in its process."""

    batch: Batch
    process: ForkProcess
    pipe: Connection
    current: int | None = None
    heard_s: float = 0.0


@dataclass
class Cause:
    """All findings with the same failure at the same place; ``first``: the case kept of them."""

    kind: str
    finding: Finding
    first: Case
    kinds: set[str] = field(default_factory=set)
    count: int = 0

    @property
    def name(self) -> str:
        """A name for a folder."""
        return folder_name(self.finding.failure, self.finding.where)


class Campaign:
    """Runs batches on several processors and collects the causes of failures."""

    def __init__(self, workplace: Path, results: Path, seed: int, quiet: bool = False) -> None:
        self._workplace, self._results, self._seed = workplace, results, seed
        self._quiet = quiet
        self.causes: dict[tuple[str, str], Cause] = {}
        self.done: dict[str, int] = {}

    def run(self, files: int, kinds: Sequence[str], processes: int) -> None:
        """Judge ``files`` mutated files of each kind."""
        self._build(kinds)
        numbers = range(files)
        waiting = deque(
            Batch(kind, tuple(numbers[first : first + BATCH]))
            for first in range(0, files, BATCH)
            for kind in kinds
        )
        self._total = files * len(kinds)
        self._began_s = self._shown_s = time.monotonic()
        running: list[Running] = []
        while waiting or running:
            while waiting and len(running) < processes:
                running.append(self._start(waiting.popleft(), len(running)))
            self._listen(running)
            for one in [one for one in running if not one.process.is_alive()]:
                running.remove(one)
                waiting.extendleft(self._end(one))
            self._show()
        self._show(last=True)

    def report(self) -> str:
        """Return what was done and found, in lines."""
        counts = ", ".join(f"{kind} {count:,}" for kind, count in sorted(self.done.items()))
        lines = [f"{sum(self.done.values()):,} mutated files, seed {self._seed}: {counts}"]
        for cause in sorted(self.causes.values(), key=lambda c: (c.finding.failure, -c.count)):
            kinds = ", ".join(sorted(cause.kinds))
            lines.append(
                f"{cause.finding.failure}: {cause.count} × {cause.finding.where} ({kinds}): "
                f"{self._results / cause.name}"
            )
        return "\n".join(lines)

    def _build(self, kinds: Iterable[str]) -> None:
        for name in kinds:
            process = _FORK.Process(target=_build, args=(name, self._workplace / name, self._seed))
            process.start()
            process.join()
            if process.exitcode:
                raise RuntimeError(f"a whole {name} could not be made")

    def _start(self, batch: Batch, slot: int) -> Running:
        ours, theirs = _FORK.Pipe(duplex=False)
        folder = self._workplace / batch.kind
        process = _FORK.Process(target=_work, args=(batch, folder, self._seed, theirs))
        process.start()
        theirs.close()
        return Running(batch, process, ours, heard_s=time.monotonic())

    def _listen(self, running: Sequence[Running]) -> None:
        wait([*(one.pipe for one in running), *(one.process.sentinel for one in running)], 1.0)
        for one in running:
            while one.process.is_alive() and one.pipe.poll():
                self._take(one)
            if time.monotonic() - one.heard_s > SILENT_S:
                one.process.kill()
                one.process.join()

    def _take(self, one: Running) -> bool:
        try:
            message = one.pipe.recv()
        except EOFError:
            return False
        one.heard_s = time.monotonic()
        if isinstance(message, Case):
            one.current = None
            self._keep(one.batch.kind, message)
        else:
            one.current = message
        return True

    def _end(self, one: Running) -> list[Batch]:
        """Take what is left of an ended process; return the rest of a batch that it died of."""
        one.process.join()
        while one.pipe.poll() and self._take(one):
            pass
        one.pipe.close()
        folder = self._workplace / one.batch.kind / str(one.process.pid)
        code = one.process.exitcode or 0
        if not code:
            shutil.rmtree(folder)
            return []
        if one.current is None:
            raise RuntimeError(f"the process of {one.batch.kind} ended with {code}")
        self._keep(one.batch.kind, Case(one.current, "", (self._death(one, code),)))
        left = one.batch.numbers[one.batch.numbers.index(one.current) + 1 :]
        return [Batch(one.batch.kind, left)] if left else []

    def _death(self, one: Running, code: int) -> Finding:
        name = signal.Signals(-code).name if code < 0 else f"exit {code}"
        trace = (self._workplace / one.batch.kind / str(one.process.pid) / DEATHS).read_text()
        frames = [line for line in trace.splitlines() if "/rigctl/" in line]
        place = re.search(r'/(rigctl/[^"]*)".* in (\w+)', frames[0]) if frames else None
        where = f"{place[1]}:{place[2]}" if place else one.batch.kind
        silent = time.monotonic() - one.heard_s > SILENT_S
        return Finding("hang" if silent else "death", f"{name} {where}", trace)

    def _keep(self, kind: str, case: Case) -> None:
        self.done[kind] = self.done.get(kind, 0) + 1
        for finding in case.findings:
            key = (finding.failure, finding.where)
            cause = self.causes.get(key)
            if cause is None:
                cause = self.causes[key] = Cause(kind, finding, case)
                self._save(cause)
            cause.count += 1
            cause.kinds.add(kind)

    def _save(self, cause: Cause) -> None:
        """Keep the bytes of a case and what happened, so that it can be seen again."""
        folder = self._results / cause.name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        process = _FORK.Process(
            target=_rebuild,
            args=(cause.kind, self._workplace / cause.kind, self._seed, cause.first.number, folder),
        )
        process.start()
        process.join()
        (folder / "report.txt").write_text(
            f"kind {cause.kind}, case {cause.first.number}, seed {self._seed}\n"
            f"{cause.first.mutation}\n{cause.finding.failure}: {cause.finding.where}\n"
            f"{cause.finding.details}\n",
            encoding="utf-8",
            errors="backslashreplace",
        )

    def _show(self, last: bool = False) -> None:
        now_s = time.monotonic()
        if self._quiet or (now_s - self._shown_s < SHOWN_EVERY_S and not last):
            return
        self._shown_s = now_s
        done = sum(self.done.values())
        left_s = (now_s - self._began_s) * (self._total - done) / max(1, done)
        print(
            f"{done:,} of {self._total:,} files, {len(self.causes)} causes of failures, "
            f"{left_s / 60:.0f} min left",
            file=sys.stderr,
            flush=True,
        )


def _build(name: str, workplace: Path, seed: int) -> None:
    Worker(KINDS[name], workplace, seed)


def _work(batch: Batch, workplace: Path, seed: int, pipe: Connection) -> None:
    warnings.simplefilter("error")
    worker = Worker(KINDS[batch.kind], workplace, seed)
    worker.prepare()
    for case in worker.cases(batch.numbers, pipe.send):
        pipe.send(case)
    pipe.close()


def _rebuild(name: str, workplace: Path, seed: int, number: int, folder: Path) -> None:
    Worker(KINDS[name], workplace, seed).rebuild(number, folder / "case")
