"""The simulated skin measured as real recordings were, and held to what they show."""

from __future__ import annotations

import pytest

from rigctl.identification.measures import RANGES, measure
from rigctl.identification.slides import slide
from rigctl.world import reference
from rigctl.world.parameters import WorldParameters

SEED, REPEATS = 1, 8


def test_the_skin_does_what_real_skins_do_and_the_page_says_so() -> None:
    (session,) = slide(WorldParameters(), REPEATS, [SEED])
    figures = measure(session)
    print("\n".join(figures.lines()))
    for name, (low, high) in RANGES.items():
        assert low < getattr(figures, name) < high, name
    for name, told in (reference.OURS | reference.SHARES).items():
        assert getattr(figures, name) == pytest.approx(told, rel=0.05, abs=0.01), (
            f"{name}: write it into rigctl/world/reference.py"
        )
