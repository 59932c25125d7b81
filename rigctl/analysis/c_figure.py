"""C as images of taxel and speed, and the SA rates by force before and after it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.report.figure import Figure, Image, Panel, Series
from rigctl.analysis.representations import REPRESENTATIONS, Representation, RepresentationSet
from rigctl.analysis.study import Findings, Row, Study
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.root_bracket import SearchStatus
from rigctl.errors import WrongUse

ORIGINAL, FORCE = (one for one in REPRESENTATIONS if one.key in ("original", "force"))
NOTE = (
    "SA rate in Hz: spikes over the time of the trial, mean over all taxels and trials of a "
    "texture and force. C brings the rate of each taxel, texture and speed to that at the "
    "reference force."
)
Floats = NDArray[np.float64]


def measure(study: Study) -> Findings:
    """Return C by force, and the rates. Raises WrongUse where force was not scaled."""
    found = study.representations
    if found.force is None or FORCE.key not in found.files:
        raise WrongUse("it needs Force Scaled representations, which are left out")
    before, after = (_rates_hz(found, one) for one in (ORIGINAL, FORCE))
    rows = _rows(study, before, after)
    images, rates = _images(found.force, study), _rate_figure(study, before, after)
    return Findings(_sentences(study, before, after), rows, [rates, images], NOTE)


def _rates_hz(found: RepresentationSet, one: Representation) -> Floats:
    """Return the mean SA rate of each trial, float64 (n_trials,)."""
    layout, n = found.layout(one), found.trials.n_taxels
    seconds = np.array(
        [layout.window_durations_s(t.n_samples, t.speed_mm_s) for t in found.trials.trials]
    )
    values = found.features(one).reshape(len(seconds), 2 * n, -1)[:, :n]
    spikes = np.einsum("itw,iw->i", values, seconds) / n
    return np.asarray(spikes / seconds.sum(axis=1))


def _rows(study: Study, before: Floats, after: Floats) -> list[Row]:
    design = study.design
    rows: list[Row] = []
    for label, texture in enumerate(design.textures):
        for force in np.unique(design.force_g).tolist():
            mine = (design.texture == label) & (design.force_g == force)
            if mine.any():
                rates = (round(float(one[mine].mean()), 3) for one in (before, after))
                row = {"texture": texture, "force_g": force}
                rows.append({**row, **dict(zip(("before_hz", "after_hz"), rates, strict=True))})
    return rows


def _means(study: Study, rates: Floats) -> tuple[list[float], list[float], list[float]]:
    """Return the forces, and mean and deviation over textures of the rates at each."""
    design = study.design
    forces = np.unique(design.force_g).tolist()
    means, deviations = [], []
    for force in forces:
        each = [
            rates[(design.texture == label) & (design.force_g == force)]
            for label in range(len(design.textures))
        ]
        by_texture = np.array([one.mean() for one in each if len(one)])
        means.append(float(by_texture.mean()))
        deviations.append(float(by_texture.std(ddof=1)) if len(by_texture) > 1 else 0.0)
    return forces, means, deviations


def _sentences(study: Study, before: Floats, after: Floats) -> list[str]:
    unit = study.representations.trials.press_unit
    forces, first, _ = _means(study, before)
    _, second, _ = _means(study, after)
    ends = [f"{forces[0]:g} to {forces[-1]:g} {unit}"]
    ends += [f"{one[0]:.1f} to {one[-1]:.1f} Hz" for one in (first, second)]
    return [
        f"From {ends[0]} the mean SA rate goes from {ends[1]} without C, from {ends[2]} with it."
    ]


def _rate_figure(study: Study, before: Floats, after: Floats) -> Figure:
    unit = study.representations.trials.press_unit
    series = []
    for name, colour, rates in (("without C", "ink", before), ("with C", "red", after)):
        forces, means, deviations = _means(study, rates)
        series.append(Series(name, colour, forces, means, deviations))
    highest = max((one.ends(i) or (0, 0))[1] for one in series for i in range(len(one.x)))
    label = f"force ({unit})"
    ends = (0.0, 1.05 * max(series[0].x)), (0.0, 1.05 * highest)
    panel = Panel("", series, label, "SA rate (Hz)", *ends, unit="Hz", x_name=unit)
    return Figure("SA rates by force", [panel], ["Mean over textures; bars: standard deviation."])


def _images(force: ForceMatrix, study: Study) -> Figure:
    """Return the mean C over textures as images of taxel and speed, one for each force."""
    trials = study.representations.trials
    names, unit = trials.sensor_layout.names, trials.press_unit
    speeds = [f"{speed:g}" for speed in force.speeds_mm_s]
    known = np.where(force.status == SearchStatus.ABSENT, np.nan, force.c)
    panels = []
    for level, force_g in enumerate(force.forces_g):
        if force_g == force.reference_g:
            continue
        cells = known[..., level]
        counts = np.isfinite(cells).sum(axis=0)
        sums = np.nansum(cells, axis=0)
        values = _cells(sums, counts)
        title = f"C at {force_g:g} {unit} (mean over textures)"
        panels.append(Image(title, names, speeds, values, "speed (mm/s)", "taxel", middle=1.0))
    return Figure("C by taxel and speed", panels, ["1: no scaling."], columns=3)


def _cells(sums: Floats, counts: NDArray[np.int64]) -> Sequence[Sequence[float | None]]:
    return [
        [float(total / n) if n else None for total, n in zip(*line, strict=True)]
        for line in zip(sums.tolist(), counts.tolist(), strict=True)
    ]
