"""The residual of each known mass: how far it is from the line that is the scale."""

from __future__ import annotations

from collections.abc import Sequence

from gui.calibrate.stem_plot import Stem, StemPlot

TITLE = "Mass less the line (g) over the mass (g)"
HINT = "Two readings make a line"


class ResidualPlot(StemPlot):
    """A point for each mass; the line in the middle is the scale."""

    def __init__(self) -> None:
        super().__init__(TITLE, HINT)

    def show_points(self, masses_g: Sequence[float], residuals_g: Sequence[float]) -> None:
        """Show residuals; none for no line."""
        widest_g = max(masses_g, default=0.0) or 1.0
        pairs = zip(masses_g, residuals_g, strict=True)
        stems = [Stem(mass / widest_g, residual, f"{mass:g}") for mass, residual in pairs]
        self.show_stems(stems, " g")
