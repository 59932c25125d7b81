"""What the encoder makes of one taxel of one trial, from the reading to the spikes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.trial_set import TrialRef, TrialSet, open_trials
from rigctl.analysis.report.example_taxel import chosen_trial, trials_origin
from rigctl.config.names import shorten
from rigctl.encoding.encoder import encode_trials, membrane_mv
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters, RaDerivative
from rigctl.encoding.ra_filter import ra_signals
from rigctl.values import SAMPLE_RATE_HZ

Floats = NDArray[np.float64]

CHANNELS = ("SA", "RA")
MAX_LETTERS = 20
"""Of a texture's name, in a title."""
COLUMNS = (
    "sample", "time_s", "reading", "low_passed", "derivative", "sa_current", "ra_current",
    "sa_mv", "ra_mv", "sa_spikes", "ra_spikes",
)  # fmt: skip
_FORMATS = ("%d", "%.3f", "%.6f", "%.6f", "%.6f", "%.4f", "%.4f", "%.4f", "%.4f", "%d", "%d")


@dataclass(frozen=True, slots=True)
class TaxelCourse:
    """The signals of the paper's Figure 2D for one taxel, one value a sample.

    ``reading``: float64 (n,), 0–1, as encoded. ``low_passed``: the reading behind the RA filter.
    ``derivative``: its change, in ``derivative_unit``. ``current``: float64 (n, 2), SA and RA,
    mV/ms. ``membrane_mv``: float64 (n, 2). ``spikes``: int32 sample indices of SA and of RA.
    ``c``: the factor on the SA current.
    """

    title: str
    words: str
    origin: str
    simulated: bool
    reading: Floats
    low_passed: Floats
    derivative: Floats
    derivative_unit: str
    current: Floats
    membrane_mv: Floats
    spikes: tuple[NDArray[np.int32], NDArray[np.int32]]
    c: float = 1.0

    @property
    def duration_s(self) -> float:
        """Length of the trial."""
        return len(self.reading) / SAMPLE_RATE_HZ


def load_course(
    trials: TrialSet,
    ranges: Normalisation,
    parameters: EncoderParameters,
    trial_id: int | None = None,
    taxel: int | None = None,
    c: Floats | None = None,
) -> TaxelCourse:
    """Return the signals of a trial and taxel, by default of the trial of Figure 2C.

    The default taxel has the largest standard deviation. ``c``: factors on the SA current, float64
    (n_trials, n_taxels). Raises WrongUse for a trial that is not in the set.
    """
    row = chosen_trial(trials, trial_id)
    trial = trials.trials[row]
    with open_trials(trials.files) as reader:
        samples = reader.read(trial)
    index = taxel - 1 if taxel else int(ranges.apply(samples).std(axis=0).argmax())
    factor = 1.0 if c is None else float(c[row, index])
    own = replace(ranges, low=ranges.low[[index]], high=ranges.high[[index]])
    words = _words(trials, trial, index, ranges, parameters, None if c is None else factor)
    simulated = bool(trials.provenance[trial.session]["simulated"])
    texts = (_title(trial, index), words, trials_origin(trials), simulated)
    return _encode(samples[:, [index]], own, parameters, factor, texts)


def write_course(course: TaxelCourse, path: Path) -> None:
    """Write each sample as a line of text, behind a line that says whose they are and the units."""
    n = len(course.reading)
    counts = [np.bincount(train, minlength=n) for train in course.spikes]
    signals = (course.reading, course.low_passed, course.derivative)
    columns = (np.arange(n), np.arange(n) / SAMPLE_RATE_HZ, *signals, *course.current.T)
    units = (
        f"time in s, reading and low_passed 0–1, derivative {course.derivative_unit}, currents "
        f"mV/ms, v in mV, spikes a sample; {SAMPLE_RATE_HZ} samples a second"
    )
    comment = f"# {course.title}; {course.words}; {course.origin}; {units}\n"
    with path.open("w", encoding="utf-8") as file:
        file.write(f"{comment}{','.join(COLUMNS)}\n")
        table = np.column_stack((*columns, *course.membrane_mv.T, *counts))
        np.savetxt(file, table, fmt=",".join(_FORMATS))


def _encode(
    samples: NDArray[np.uint16],
    ranges: Normalisation,
    parameters: EncoderParameters,
    c: float,
    texts: tuple[str, str, str, bool],
) -> TaxelCourse:
    scale = np.array([[c]])
    (spikes,) = encode_trials([samples], ranges, parameters, sa_scale=scale)
    x = ranges.apply(samples)
    low_passed, derivative, ra_current = (signal[:, 0] for signal in ra_signals(x, parameters))
    sa_current = c * parameters.sa_gain * x[:, 0]
    per_sample = parameters.ra_derivative is RaDerivative.PER_SAMPLE
    return TaxelCourse(
        *texts,
        reading=x[:, 0],
        low_passed=low_passed,
        derivative=derivative,
        derivative_unit="1/sample" if per_sample else "1/s",
        current=np.column_stack([sa_current, ra_current]),
        membrane_mv=membrane_mv(samples, ranges, parameters, sa_scale=scale),
        spikes=(spikes.train(0), spikes.train(1)),
        c=c,
    )


def _title(trial: TrialRef, index: int) -> str:
    return (
        f"Texture {shorten(trial.texture, MAX_LETTERS)} at {trial.speed_mm_s:g} mm/s and "
        f"{trial.force_g:g} g, taxel {index + 1} of trial {trial.trial_id}"
    )


def _words(
    trials: TrialSet,
    trial: TrialRef,
    index: int,
    ranges: Normalisation,
    parameters: EncoderParameters,
    c: float | None,
) -> str:
    layout = trials.sensor_layout
    place = f"row {layout.row_of(index) + 1}, column {index % layout.columns + 1}"
    if len(layout.layers) > 1:
        place = f"layer {layout.layers[layout.layer_of(index)]}, {place}"
    span = f"0–1: {ranges.low[index]}–{ranges.high[index]} {ranges.reading.unit}"
    scaled = "without C" if c is None else f"SA current times C = {c:.4g}"
    session = trials.paths[trial.session].name
    return f"{place} · {span} · encoder {parameters.name} · {scaled} · session {session}"
