"""Every fault in one state of the drum, as the page of faults says; ``make faults`` tries all."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.config.resources import checkout
from tests.endurance.faults import FAULTS, Fault
from tests.endurance.matrix import STATES, try_fault


def cells_of_page() -> dict[str, list[str]]:
    """Return the cells of each fault on the page."""
    root = checkout()
    assert root is not None
    page = (root / "docs/reference/faults.md").read_text(encoding="utf-8")
    table = page.partition("<!-- faults: begin -->")[2].partition("<!-- faults: end -->")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]
    return {row[0]: row[1:] for row in rows if len(row) == len(STATES) + 3}


@pytest.mark.parametrize(
    ("fault", "number"),
    [(fault, number) for number, fault in enumerate(FAULTS)],
    ids=[fault.name for fault in FAULTS],
)
def test_a_fault_costs_what_the_page_says(tmp_path: Path, fault: Fault, number: int) -> None:
    state = number % len(STATES)
    cell = try_fault(fault, STATES[state], tmp_path / "rig")
    assert cell.problems == ()
    assert cell.code == cells_of_page()[fault.name][state]


def test_the_page_has_every_fault_and_no_unsafe_state() -> None:
    cells = cells_of_page()
    assert set(cells) - {"fault", "---"} == {fault.name for fault in FAULTS}
    assert {row[-1] for name, row in cells.items() if name not in ("fault", "---")} == {"yes"}
