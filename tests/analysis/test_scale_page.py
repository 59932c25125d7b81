"""The page on very many trials says what its own rates give."""

from __future__ import annotations

from rigctl.resources import checkout
from tests.bench import _scale_page as page


def test_the_page_is_rendered_from_its_rates() -> None:
    root = checkout()
    assert root is not None
    text = (root / "docs" / "explanation" / "scale.md").read_text(encoding="utf-8")
    rates = page.rates_of(text)
    assert page.render(rates) == text, "make scale writes it anew"
    assert set(page.UNITS) <= set(rates)
    full = [n for n, _ in page.breaks(rates)]
    assert full == sorted(full) and full[0] > 0
