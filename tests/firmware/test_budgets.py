"""Both images use at most three quarters of flash, RAM and stack, and the stack is bounded."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

from rigctl.config.resources import checkout
from tests.firmware.building import built
from tests.firmware.drum.support.chip import DrumChip
from tests.firmware.taxels.chip import TaxelChip

root = checkout()
assert root is not None
SCRIPT = root / "arduino" / "budgets.py"


def load_script() -> ModuleType:
    """Import the script as a module."""
    spec = spec_from_file_location("budgets", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.modules["budgets"] = module
    spec.loader.exec_module(module)
    return module


def run_script(board: str, image: Path) -> subprocess.CompletedProcess[str]:
    """Run the script like the Makefile."""
    command = [sys.executable, str(SCRIPT), board, str(image)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("board", ["drum", "taxels"])
def test_an_image_leaves_a_quarter_of_each_budget_free(board: str) -> None:
    done = run_script(board, built(f"firmware/{board}.elf"))
    assert done.returncode == 0, done.stderr
    assert f"{board}: flash" in done.stdout and "stack" in done.stdout


def test_an_image_over_budget_is_refused() -> None:
    done = run_script("taxels", built("firmware/probe-large.elf"))
    assert done.returncode == 1
    assert "more than 75% of RAM" in done.stderr


def test_an_unbounded_stack_is_refused() -> None:
    done = run_script("taxels", built("firmware/probe-recursive.elf"))
    assert done.returncode == 1
    assert "no bound of the stack" in done.stderr


def test_the_taxel_boards_measured_stack_is_within_its_bound() -> None:
    stack = load_script().budgets("taxels", str(built("firmware/taxels.elf")))["stack"]
    with TaxelChip() as board:
        board.run(400)
        used = stack.room - board.statuses[-1].free_stack_bytes
    assert 0.5 * stack.taken < used <= stack.taken


def test_the_drum_boards_measured_stack_is_within_its_bound() -> None:
    stack = load_script().budgets("drum", str(built("firmware/drum.elf")))["stack"]
    with DrumChip() as drum:
        drum.run(400)
        used = stack.room - drum.get("free_stack_bytes")
    assert 0 < used <= stack.taken
