"""Render the tables of ``docs/reference/virtual-finger.md`` from the parameters.

``python -m rigctl.simulation.finger.parameter_page`` writes them; ``--check`` only compares.
"""

from __future__ import annotations

import sys
from pathlib import Path

from rigctl.simulation.bench.world.parameter_fields import describe
from rigctl.simulation.bench.world.parameter_tables import TABLE_HEAD, table_line
from rigctl.simulation.finger.operator_parameters import OperatorParameters, TrackerParameters

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "virtual-finger.md"
BEGIN, END = "<!-- parameters -->\n", "<!-- end of parameters -->"

_GROUPS = {
    "slow_mm_s": "Speed",
    "run_up_mm": "Path",
    "force_g": "Pressure",
    "tilt_attachment_deg": "Sensor on the finger",
    "wrist_behind_mm": "Wrist",
    "lower_s": "Between the slides",
    "rate_hz": "Tracker",
}


def render(page: str) -> str:
    """Return the page with current tables; the text around them is unchanged."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}{_tables()}{END}{rest.partition(END)[2]}"


def _tables() -> str:
    parts = []
    for row in [*describe(OperatorParameters()), *describe(TrackerParameters())]:
        if row.name in _GROUPS:
            parts.append(f"\n### {_GROUPS[row.name]}\n\n{TABLE_HEAD}")
        parts.append(table_line(row))
    return "".join(parts)


def main(arguments: list[str]) -> int:
    """Write the tables, or with ``--check`` return 1 if they are stale."""
    page = PAGE.read_text(encoding="utf-8")
    if "--check" in arguments:
        return int(page != render(page))
    PAGE.write_text(render(page), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
