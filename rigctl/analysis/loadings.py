"""The leading components as images of train and window, with the variance that each explains."""

from __future__ import annotations

import numpy as np

from rigctl.analysis.pca_lda import fit_pca
from rigctl.analysis.report.figure import Figure, Image
from rigctl.analysis.representations import Representation
from rigctl.analysis.splits import make_splits
from rigctl.analysis.study import Findings, Row, Study, percent
from rigctl.errors import WrongUse

DRAWN = 4
"""Components of a figure."""
COMPONENTS = 10
NOTE = (
    "Principal components of the training trials of the report's first fit: share of the variance, "
    "shares of the squared loadings that are of SA, and of each layer."
)


def measure(study: Study) -> Findings:
    """Return the loadings of each representation. Raises WrongUse where no task was run."""
    if not study.results:
        raise WrongUse("no task was run")
    family = study.results[0].task.family
    split = make_splits(study.design, family, study.settings.seed, 0)[0]
    rows: list[Row] = []
    figures, sentences = [], []
    for one in study.shown:
        features = np.asarray(study.representations.features(one)[split.train])
        n_components = min(COMPONENTS, len(features) - 1, features.shape[1])
        pca = fit_pca(features, n_components)
        total = float(features.var(axis=0, ddof=1).sum()) or 1.0
        shares = (pca.variance / total).tolist()
        rows += [_row(study, one, number, shares, pca.axes) for number in range(n_components)]
        figures.append(_figure(study, one, shares, pca.axes))
        sentences.append(f"{one.name}: the first {n_components} explain {sum(shares):.1%}")
    return Findings([f"{'; '.join(sentences)} of the variance."], rows, figures, NOTE)


def _row(
    study: Study, one: Representation, number: int, shares: list[float], axes: np.ndarray
) -> Row:
    layout = study.representations.trials.sensor_layout
    n = layout.n_taxels
    squares = (axes[:, number] ** 2).reshape(2 * n, -1).sum(axis=1)
    row = {
        "representation": one.name,
        "component": number + 1,
        "variance_percent": percent(shares[number]),
        "cumulative_percent": percent(sum(shares[: number + 1])),
        "sa_percent": percent(float(squares[:n].sum())),
    }
    by_taxel = squares[:n] + squares[n:]
    for layer, name in enumerate(layout.layers):
        row[f"layer_{name}_percent"] = percent(float(by_taxel[list(layout.taxels_of(layer))].sum()))
    return row


def _figure(study: Study, one: Representation, shares: list[float], axes: np.ndarray) -> Figure:
    trains = study.representations.trials.sensor_layout.train_names()
    names, order = [name for name, _ in trains], [row for _, row in trains]
    panels = []
    for number in range(min(DRAWN, len(shares))):
        values = axes[:, number].reshape(len(order), -1)[order]
        windows = [str(window + 1) for window in range(values.shape[1])]
        title = f"component {number + 1}: {shares[number]:.1%}"
        panels.append(Image(title, names, windows, values.tolist(), "window", "train"))
    note = "Loadings by train and window; the share of the variance that the component explains."
    return Figure(f"Loadings, {one.name}", panels, [note], columns=DRAWN)
