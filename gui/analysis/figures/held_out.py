"""The figures of the quick check and of a trained model. This module does not import Qt."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gui.analysis.export.value_file import data_words, rows_csv
from rigctl.analysis.report.figure import Figure, Matrix
from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from rigctl.analysis.classify_sessions import Classification
    from rigctl.analysis.report.demo import DemoResult

TRAINED = "Trials that the model was trained on; the counts say nothing about others."
UNSEEN = "Trials that the model was not trained on."


def spikes_csv(demo: DemoResult) -> str:
    """Return every spike of the trial in the quick check's raster."""
    spikes = demo.shown.spikes
    half = spikes.n_trains // 2
    names = [f"{kind} {i + 1}" for kind in ("SA", "RA") for i in range(half)]
    rows = [
        (name, f"{sample / SAMPLE_RATE_HZ:.3f}")
        for train, name in enumerate(names)
        for sample in spikes.train(train).tolist()
    ]
    return rows_csv(("neuron", "spike (s)"), rows)


def model_confusion(classification: Classification) -> Figure:
    """Return the matrix of the trials that the model was not trained on, else of all."""
    unseen, model = classification.unseen, classification.model
    shown, note = (unseen, UNSEEN) if unseen.n_scored else (classification, TRAINED)
    lines = [f"{model.components} components", note]
    matrix = Matrix(model.representation, lines, model.classes, shown.confusion.tolist())
    return Figure("Trained model", [matrix])


def data_and_model(classification: Classification) -> str:
    """Return where the trials come from, and the model's where that is another origin."""
    trials, model = classification.trials.simulated, classification.model.training.simulated
    words = data_words(simulated=trials)
    if model == trials:
        return words
    return f"{words}, {'SIMULATED' if model else 'recorded'} model"
