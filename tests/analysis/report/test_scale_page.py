"""The page on very many trials follows from the rates at its end."""

from __future__ import annotations

from rigctl.config.resources import checkout
from tests.benchmarks.encoder import _scale_page


def test_the_page_is_rendered_from_its_rates() -> None:
    root = checkout()
    assert root is not None
    text = (root / "docs" / "explanation" / "scale.md").read_text(encoding="utf-8")
    rates = _scale_page.rates_of(text)
    assert _scale_page.render(rates) == text, "run make scale to write the page"
    assert set(_scale_page.UNITS) <= set(rates)
    full = [n for n, _ in _scale_page.growth_limits(rates)]
    assert full == sorted(full) and full[0] > 0
