"""The load cell's error in each sixteenth of a turn of the drum."""

from __future__ import annotations

from collections.abc import Sequence

from gui.calibrate.stem_plot import Stem, StemPlot

TITLE = "Error (g) over the sixteenth of the turn, from the index mark on"
HINT = "Turn the drum once to measure it"


class ImbalancePlot(StemPlot):
    """A point for each sixteenth."""

    def __init__(self) -> None:
        super().__init__(TITLE, HINT)

    def show_table(self, table_g: Sequence[float]) -> None:
        """Show the errors; none before they are measured."""
        last = max(1, len(table_g) - 1)
        self.show_stems([Stem(n / last, value, f"{n + 1}") for n, value in enumerate(table_g)])
