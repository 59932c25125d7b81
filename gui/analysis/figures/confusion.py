"""Confusion matrices as numbers. This module does not import Qt."""

from __future__ import annotations

import csv
import io
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gui.analysis.figures.accuracy import PERCENT

HEAD = (
    "task", "representation", "components", "true texture", "predicted texture",
    "count (trials)", "share of the true texture (%)", "simulated",
)  # fmt: skip


class ConfusionCounts(NamedTuple):
    """How often each class (row) was named as which (column): ``counts`` int64 (n, n).

    ``components``: of the classifier. ``note``: what must be known of the counts, or empty.
    """

    task: str
    representation: str
    components: int
    classes: tuple[str, ...]
    counts: NDArray[np.int64]
    note: str = ""

    @property
    def share(self) -> NDArray[np.float64]:
        """Share of each true class, 0 to 1, float64 (n, n); 0 where it has no trials."""
        rows = self.counts.sum(axis=1, keepdims=True)
        share: NDArray[np.float64] = self.counts / np.maximum(rows, 1)
        return share

    def right_words(self) -> str:
        """Return how many trials are right."""
        right, n = int(np.trace(self.counts)), int(self.counts.sum())
        shown = f"{self.components} component{'' if self.components == 1 else 's'}"
        accuracy = f"{100 * right / n:.2f}{PERCENT}" if n else "no trials"
        words = f"{right} of {n} trials right ({accuracy}), {shown}"
        return f"{words}. {self.note}" if self.note else words

    def cell_words(self, row: int, column: int) -> str:
        """Return a cell in words: true and predicted class, count and share."""
        count, n = int(self.counts[row, column]), int(self.counts[row].sum())
        share = f"{100 * self.share[row, column]:.1f}{PERCENT}"
        names = f"true {self.classes[row]}, predicted {self.classes[column]}"
        return f"{names}: {count} of {n} trials ({share} of the true ones)"


class ConfusionPlot(NamedTuple):
    """The matrices of a page, and where the data come from."""

    matrices: tuple[ConfusionCounts, ...]
    origin: str
    simulated: bool

    def to_csv(self) -> str:
        """Return every cell of every matrix as a row."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(HEAD)
        origin = "yes" if self.simulated else "no"
        for matrix in self.matrices:
            head, share = (matrix.task, matrix.representation, matrix.components), matrix.share
            for (row, column), count in np.ndenumerate(matrix.counts):
                names = matrix.classes[row], matrix.classes[column]
                percent = f"{100 * share[row, column]:.4f}"
                writer.writerow((*head, *names, int(count), percent, origin))
        return out.getvalue()
