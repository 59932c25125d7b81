"""Render the tables of ``docs/reference/world.md`` from parameters, plates and wirings.

``python -m rigctl.bench.parameter_tables`` writes them; ``--check`` only compares.
"""

from __future__ import annotations

import sys
from pathlib import Path

from rigctl.bench.parameter_fields import ParameterInfo
from rigctl.bench.parameters import WorldParameters, parameter_infos
from rigctl.bench.textures import CATALOGUE
from rigctl.bench.wirings import catalogue_table

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "world.md"

TABLE_HEAD = (
    "| parameter | nominal | range | unit | meaning | source |\n|---|---|---|---|---|---|\n"
)
_GROUPS = {
    "circumference_mm": "Drum",
    "actuator_speed_mm_s": "Actuator",
    "contact_mm": "Contact",
    "loadcell_rate_hz": "Load cell",
    "drum_clock_ppm": "Clocks of the boards",
    "base_height_mm": "Textures",
    "taxel_pitch_mm": "Skin and taxels",
}


def heading(name: str) -> str:
    """Return the heading of the group whose first parameter this is, else an empty string."""
    return _GROUPS.get(name, "")


def render(page: str) -> str:
    """Return the page with current tables; the text between them is unchanged."""
    tables = {"parameters": _parameters(), "plates": _plates(), "wirings": "\n" + catalogue_table()}
    for name, lines in tables.items():
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
        before, _, rest = page.partition(begin)
        page = f"{before}{begin}{lines}{end}{rest.partition(end)[2]}"
    return page


def _parameters() -> str:
    parts = []
    for row in parameter_infos():
        if heading(row.name):
            parts.append(f"\n### {heading(row.name)}\n\n{TABLE_HEAD}")
        parts.append(table_line(row))
    return "".join(parts)


def table_line(row: ParameterInfo) -> str:
    """Return a parameter as a line below :data:`TABLE_HEAD`."""
    span = f"{row.low:.6g} … {row.high:.6g}"
    return f"| `{row.name}` | {row.value:.6g} | {span} | {row.unit} | {row.doc} | {row.source} |\n"


def _plates() -> str:
    p = WorldParameters()
    lines = ["\n| plate | group | height, mm | spacing, mm |\n|---|---|---|---|\n"]
    for plate in CATALOGUE.values():
        height_mm, space_mm = p.base_height_mm * plate.height, p.base_space_mm * plate.space
        shown = f"{space_mm:g}" if plate.height else "–"
        lines.append(f"| {plate.name} | {plate.group} | {height_mm:g} | {shown} |\n")
    return "".join(lines)


def main(arguments: list[str]) -> int:
    """Write the tables, or with ``--check`` return 1 if they are stale."""
    page = PAGE.read_text(encoding="utf-8")
    if "--check" in arguments:
        return int(page != render(page))
    PAGE.write_text(render(page), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
