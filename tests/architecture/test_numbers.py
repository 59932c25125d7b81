"""Results that pages tell are those that a command wrote, and of today's benches and encoder."""

from __future__ import annotations

import re

import pytest

from tools.docs_numbers import CHECKOUT, DOCS, NUMBERS, bench, main, stored, written

CHECKED = {
    "explanation/encoder-kernel.md": "tests/benchmarks/encoder/ablation.py",
    "explanation/force-invariance.md": "tests/bench/test_force_invariance.py",
    "explanation/moving-finger.md": "tests/finger/bench/test_finger_spreads.py",
    "explanation/real-and-simulated.md": "tests/bench/test_skin_statistics.py",
    "how-to/accept.md": "tests/analysis/test_acceptance.py",
    "reference/encoding.md": "tests/encoder/test_parameters.py",
    "reference/firmware.md": "tests/firmware/page.py",
    "reference/protocols.md": "tests/architecture/test_reference_pages.py",
    "reference/virtual-finger.md": "rigctl/finger/bench/operator_parameters.py",
    "reference/world.md": "rigctl/bench/parameter_tables.py",
}
"""Pages with tables of other numbers, and what writes or checks them."""
RESULT = re.compile(
    r"[−+]?[\d,]*\.\d+( ?%)?|\d+ ?%|[\d.]+ → [\d.]+.*|[\d.]+–[\d.]+|[\d.]+ % \(.*\)"
)


@pytest.mark.parametrize("name", NUMBERS)
def test_a_page_has_the_numbers_that_its_command_wrote(name: str) -> None:
    page = (DOCS / NUMBERS[name].page).read_text(encoding="utf-8")
    assert written(page, name, stored()) == page, "python -m tools.docs_numbers --write"


def test_the_numbers_are_of_the_benches_and_the_encoder_as_they_are() -> None:
    today = pytest.approx(bench(), rel=0.005)
    stale = [name for name, entry in stored().items() if entry["bench"] != today]
    assert not stale, f"make docs-numbers NUMBERS='{' '.join(stale)}'"


def test_every_table_of_results_is_written_by_a_command_or_checked() -> None:
    found = set()
    for path in DOCS.rglob("*.md"):
        page = re.sub(
            "<!-- numbers: .*?<!-- end of numbers -->", "", path.read_text("utf-8"), flags=re.S
        )
        rows = [line.strip("| \n").split("|")[1:] for line in page.splitlines() if line[:1] == "|"]
        if any(RESULT.fullmatch(cell.strip()) for row in rows for cell in row):
            found.add(path.relative_to(DOCS).as_posix())
    # A decision has the numbers of its day.
    assert {page for page in found if not page.startswith("decisions/")} == set(CHECKED)
    assert all((CHECKOUT / file).is_file() for file in CHECKED.values())


def test_unknown_numbers_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ra-rate"]) == 2
    assert "there are no numbers ra-rate: choose from ra-rates," in capsys.readouterr().err
