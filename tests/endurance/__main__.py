"""The soak: the paper's whole plan with faults and kills, in ``build/soak``; a later call goes on.

``python -m tests.endurance [PAGE]`` prints what happened and writes the page.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

from tests.endurance.campaign import Campaign, State
from tests.endurance.page import describe, fill_page

FOLDER = Path("build/soak")
PLAN = Path("protocols/paper.toml")
REPORT_EVERY_S = 60.0


class _Progress:
    """Prints a line a minute."""

    def __init__(self) -> None:
        self._told_s = -REPORT_EVERY_S

    def __call__(self, state: State) -> None:
        if time.monotonic() - self._told_s < REPORT_EVERY_S:
            return
        self._told_s = time.monotonic()
        print(
            f"{state.committed}/{state.planned} trials, {sum(state.faults.values())} faults, "
            f"{state.kills} kills, {len(state.unsafe)} unsafe, {len(state.problems)} problems",
            flush=True,
        )


def main(arguments: Sequence[str]) -> int:
    """Run to the end; return 1 where something was lost, doubled, unsafe or grew."""
    campaign = Campaign(FOLDER, PLAN)
    try:
        campaign.run(_Progress())
    except KeyboardInterrupt:
        print("interrupted: the same command goes on")
    found = describe(campaign)
    print(found.text)
    if arguments:
        fill_page(Path(arguments[0]), "soak", found.text)
    return 0 if found.holds else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
