"""Each interrupt handler is as short as the limit demands and as long as its comment says."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from rigctl.config.resources import checkout
from tests.firmware.interrupts import drum_cycles, taxel_cycles

LIMIT_CYCLES = 400
"""25 µs."""
HANDLER = re.compile(r"((?://[^\n]*\n)+)ISR\((\w+)_vect")
FIGURE = re.compile(r"(\d+) cycles, (\d+) µs")


def told_cycles(board: str) -> dict[str, int]:
    """Return the figure in the comment before each handler of a board, cycles."""
    root = checkout()
    assert root is not None
    told = {}
    for path in (root / "arduino" / board).glob("chip_*.cpp"):
        text = path.read_text(encoding="utf-8")
        handlers = HANDLER.findall(text)
        assert len(handlers) == text.count("ISR("), path
        for comment, name in handlers:
            ((cycles, us),) = FIGURE.findall(comment.replace("\n//", ""))
            assert round(int(cycles) / 16) == int(us), name
            told[name] = int(cycles)
    return told


@pytest.mark.parametrize(("board", "measure"), [("drum", drum_cycles), ("taxels", taxel_cycles)])
def test_every_interrupt_keeps_its_limit_and_its_comment(
    board: str, measure: Callable[[], dict[str, int]]
) -> None:
    measured = measure()
    assert max(measured.values()) <= LIMIT_CYCLES, measured
    assert measured == pytest.approx(told_cycles(board), rel=0.05)
