"""What a soak has found, in words: printed, and kept as a page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigctl.session.verify import verify
from tests.endurance.campaign import Campaign, State

MOST_GROWTH_MIB = 20.0
"""Of a long sitting, after its first 500 trials."""
SETTLED_TRIALS = 500


@dataclass(frozen=True, slots=True)
class Found:
    """Lines of a table, and whether every promise holds for what was run."""

    lines: tuple[str, ...]
    holds: bool

    @property
    def text(self) -> str:
        """The table."""
        return "\n".join(self.lines)


def growth_mib(state: State) -> float | None:
    """Return the growth of the longest sitting after its first trials; None without a long one."""
    sittings: dict[int, list[float]] = {}
    for sitting, trials, mib in state.memory:
        if trials >= SETTLED_TRIALS:
            sittings.setdefault(sitting, []).append(mib)
    longest = max(sittings.values(), key=len, default=[])
    if len(longest) < 4:
        return None
    quarter = len(longest) // 4
    return min(longest[-quarter:]) - min(longest[:quarter])


def describe(campaign: Campaign) -> Found:
    """Return what a campaign has seen, and verify its session."""
    state = campaign.load()
    report = verify(campaign.session)
    growth = growth_mib(state)
    resumed = np.array(state.resumed_s or [0.0])
    # The last part of a campaign that was interrupted is not closed.
    found = report.problems if state.complete else []
    problems = [*state.problems, *found, *(f"unsafe: {line}" for line in state.unsafe)]
    if growth is not None and growth > MOST_GROWTH_MIB:
        problems.append(f"memory grew by {growth:.0f} MiB")
    memory = "no sitting was long enough" if growth is None else f"{growth:+.1f} MiB"
    rows = {
        "trials committed exactly once": f"{state.committed:,} of {state.planned:,}",
        "sittings": f"{state.sittings:,}",
        "SIGKILLs": f"{state.kills:,}, {state.kills_at_start:,} of them at a start",
        "faults": f"{sum(state.faults.values()):,} of {len(state.faults)} kinds",
        "runs that ended before all trials, and were resumed": f"{sum(state.endings.values()):,}",
        "recoveries by the run itself": f"{state.events.get('recovery', 0):,}",
        "samples reported as on disk, all found": f"{state.acknowledged:,}",
        "samples in the session, every row of its digests verified": f"{report.samples:,}",
        "unsafe states in the bench's own log": f"{len(state.unsafe):,}",
        "highest true force": f"{state.most_g:.0f} g",
        "growth of memory in the longest sitting": memory,
        "from the start of a process to its run": (
            f"median {np.median(resumed):.1f} s, 99 % within {np.percentile(resumed, 99):.1f} s"
        ),
        "time": f"{state.wall_s / 60:.0f} min",
        "problems": f"{len(problems)}",
    }
    lines = ["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())]
    lines += ["", *(f"- {problem}" for problem in problems)] if problems else []
    return Found(tuple(lines), state.complete and not problems)


def fill_page(path: Path, name: str, text: str) -> None:
    """Put a text between the marks of this name in a page."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    before, _, rest = path.read_text(encoding="utf-8").partition(begin)
    after = rest.partition(end)[2]
    path.write_text(f"{before}{begin}\n{text}\n{end}{after}", encoding="utf-8")
