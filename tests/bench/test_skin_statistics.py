"""The simulated skin has the statistics of real recordings."""

from __future__ import annotations

from rigctl.bench import parameter_tables
from rigctl.bench.parameters import WorldParameters
from tools.identify_bench import RANGES, SkinMeasures, measure_skin, simulate_slides

SEED, REPEATS = 1, 8


def test_the_skin_has_the_statistics_of_real_skins_and_of_the_page() -> None:
    (session,) = simulate_slides(WorldParameters(), REPEATS, [SEED])
    figures = measure_skin(session)
    print("\n".join(figures.lines()))
    for name, (low, high) in RANGES.items():
        assert low < getattr(figures, name) < high, name
    page = parameter_tables.PAGE.read_text(encoding="utf-8")
    for line in shown(figures):
        assert line in page, f"{line}: write it into docs/reference/world.md"


def shown(figures: SkinMeasures) -> list[str]:
    """Return the figures as the last columns of the page's table rows."""
    mean, amplitude = (
        " / ".join(f"{abs(share):.2f}" for share in shares)
        for shares in (figures.mean_shares, figures.amplitude_shares)
    )
    scatter = f"{figures.mean_scatter:.1%} / {figures.amplitude_scatter:.1%}"
    growths = f"× {figures.growth:.1f}", f"× {figures.mean_growth:.1f}"
    return [f"| {cell} |\n" for cell in (mean, amplitude, *growths, scatter)]
