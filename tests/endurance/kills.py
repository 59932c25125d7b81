"""SIGKILL at random instants of a run in real time: what is lost, and how soon it goes on."""

from __future__ import annotations

import json
import multiprocessing
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from rigctl.engine.live_file import LiveReader
from rigctl.session.layout import COUNTER
from rigctl.session.part import existing_parts
from rigctl.session.session import open_session
from tests.endurance.page import fill_page
from tests.endurance.sitting import SittingPlan, ring_path, run_sitting

KILLS = 300
WITHIN_S = 10.0
"""A kill comes within this time after a run has begun: in any state of a trial."""
STATE_FILE = "kills.json"
PROTOCOL = """
name = "kills"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 1000

[trial]
travel_mm = 60
"""


@dataclass(slots=True)
class Kills:
    """What was seen so far. ``lost_ms``: samples that had arrived and are not in the session."""

    lost_ms: list[int] = field(default_factory=list)
    resumed_s: list[float] = field(default_factory=list)
    committed: int = 0
    problems: list[str] = field(default_factory=list)


def kill_often(
    folder: Path, count: int = KILLS, report: Callable[[Kills], None] = lambda kills: None
) -> Kills:
    """Kill a run ``count`` times in all, those of earlier calls included; return what was seen."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "kills.toml").write_text(PROTOCOL)
    path = folder / STATE_FILE
    kills = Kills(**json.loads(path.read_text())) if path.is_file() else Kills()
    while len(kills.lost_ms) < count:
        _kill_once(folder, kills)
        path.write_text(json.dumps(asdict(kills)))
        report(kills)
    return kills


def _kill_once(folder: Path, kills: Kills) -> None:
    number = len(kills.lost_ms) + 1
    plan = SittingPlan(
        folder / "session", folder / "kills.toml", "virtual", number, 1, 0.0, (), paced=True
    )
    context: Any = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    began_s = time.perf_counter()
    process = context.Process(target=run_sitting, args=(plan, theirs))
    process.start()
    theirs.close()
    while ours.recv()[0] != "running":
        pass
    kills.resumed_s.append(round(time.perf_counter() - began_s, 3))
    time.sleep(Random(number).uniform(0.0, WITHIN_S))
    process.kill()
    process.join()
    ours.close()
    _check(plan, kills, len(existing_parts(plan.folder)))


def _check(plan: SittingPlan, kills: Kills, n_parts: int) -> None:
    """Read what the kill left; a sitting without a part had recorded nothing."""
    ring = ring_path(plan)
    reader = LiveReader(ring)
    arrived = reader.taxels(1).counters.tolist()
    reader.close()
    ring.unlink()
    lost = 0
    if n_parts:
        with open_session(plan.folder) as session:
            kills.problems += session.describe_missing()
            ids = session.trials["trial_id"][session.committed()].tolist()
            last = session.parts[-1]
            if last.header.start_utc == plan.start_utc and last.n_samples and arrived:
                newest = last.read(COUNTER, last.n_samples - 1, last.n_samples)[0]
                lost = arrived[0] - int(newest)
        if ids != list(range(1, len(ids) + 1)) or len(ids) < kills.committed:
            kills.problems.append(f"kill {plan.number}: the committed trials are {ids[-5:]}")
        kills.committed = len(ids)
    kills.lost_ms.append(lost)


MOST_LOST_MS = 100
MOST_RESUMED_S = 3.0


def describe(kills: Kills) -> tuple[list[str], bool]:
    """Return a table, and whether every promise holds."""
    lost, resumed = np.array(kills.lost_ms), np.array(kills.resumed_s)
    rows = {
        "SIGKILLs": f"{len(lost)}",
        "committed trials, always the first of the plan": f"{kills.committed}",
        "lost": (
            f"median {np.median(lost):.0f} ms, 99 % within {np.percentile(lost, 99):.0f} ms, "
            f"at most {lost.max()} ms"
        ),
        "from the start of a process to its run": (
            f"median {np.median(resumed):.1f} s, at most {resumed.max():.1f} s"
        ),
        "problems": f"{len(kills.problems)}",
    }
    lines = ["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())]
    within = lost.max() <= MOST_LOST_MS and resumed.max() <= MOST_RESUMED_S
    return lines + [f"- {line}" for line in kills.problems], bool(within and not kills.problems)


def main(arguments: Sequence[str]) -> int:
    """Kill in the folder, print the table and write it into the page; return 1 where one fails."""
    folder, page = map(Path, arguments)
    lines, holds = describe(kill_often(folder))
    print("\n".join(lines))
    fill_page(page, "kills", "\n".join(lines))
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
