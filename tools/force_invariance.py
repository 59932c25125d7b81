"""Measure what force scaling gains at untrained forces, with a label and without.

``make invariance`` writes the tables of ``docs/explanation/force-invariance.md``: slides of the
simulated bench, the sensor calibrated on the smooth plate of the same session.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.pca_lda import Split
from rigctl.analysis.splits import make_splits, stratified_folds
from rigctl.analysis.tasks import score_splits
from rigctl.analysis.trial_set import Design
from rigctl.bench.parameters import WorldParameters, parameter_infos
from rigctl.bench.world_file import NOMINAL_WORLD, load_world
from rigctl.config.rig_config import PAPER_ARRAY
from rigctl.encoder.batch import common_bin_edges, count_spikes, features_from_counts
from rigctl.encoder.features import SPEED_SCALED, UNSCALED, FeatureLayout
from rigctl.encoder.force_gain import ForceGain, calibrated, divided
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import override, preset
from rigctl.encoder.reading import Reading, conductance
from rigctl.encoder.root_bracket import LIMIT_C
from rigctl.errors import RigctlError
from tools.skin_statistics import searched_c
from tools.slides import Slider, SlideSession, simulate_slides, slide_features

PAGE = Path(__file__).parents[1] / "docs" / "explanation" / "force-invariance.md"
MARK = "<!-- make invariance writes what follows -->\n"
SEEDS, REPEATS, DRAWS = (21, 22, 23), 8, 4
LEVELS_G = np.linspace(75.0, 1200.0, 20)
"""Forces of the protocol ``sensor``."""
CALIBRATION_MM_S = 80.0
WIRING = list(PAPER_ARRAY.order)
INPUTS = tuple(reading % PAPER_ARRAY.inputs for reading in WIRING)
CONDUCTANCES = override(preset("default"), [f"reading={Reading.CONDUCTANCE}"])
LAYOUTS = (UNSCALED, SPEED_SCALED)
TASKS = tuple(task for task in published.TASKS if task.key in published.TABLE_1)
UNTRAINED = ("untrained-force", "untrained-both")
Floats = NDArray[np.float64]
Samples = NDArray[np.uint16]


class Calibration(NamedTuple):
    """Mean conductances on the smooth plate, float64 (n_levels, n_taxels)."""

    curves: Floats

    def estimated_g(self, readings: Samples) -> float:
        """Return the mean force that all taxels show over a trial."""
        sums = np.maximum.accumulate(self.curves.sum(axis=1))
        return float(np.interp(readings.sum(axis=1), sums, LEVELS_G).mean())

    def factors(self, force_g: Floats, ranges: Normalisation, *, each: bool) -> Floats:
        """Return the factor on each taxel's current at known forces, float64 (n, n_taxels).

        It is from the sum of all taxels, or of ``each`` by itself.
        """
        above = (self.curves - ranges.low).clip(min=1.0)
        if not each:
            above = np.tile(above.sum(axis=1, keepdims=True), ranges.n_taxels)
        aim = [np.interp(REFERENCE_FORCE_G, LEVELS_G, curve) for curve in above.T]
        now = [np.interp(force_g, LEVELS_G, curve) for curve in above.T]
        factors: Floats = np.minimum(np.array(aim)[:, None] / np.array(now), LIMIT_C).T
        return factors


def calibrate(parameters: WorldParameters, seed: int) -> Calibration:
    """Press the smooth plate of a session at all levels, up and down."""
    slider = Slider(parameters, seed)
    slider.mount(published.SMOOTH)
    rounds = [
        [_readings(slider.trial(CALIBRATION_MM_S, force_g)).mean(axis=0) for force_g in levels]
        for levels in (LEVELS_G, LEVELS_G[::-1])
    ]
    return Calibration((np.array(rounds[0]) + np.array(rounds[1])[::-1]) / 2.0)


def _readings(samples: Samples) -> Samples:
    """Return the conductance at each place of the sensor."""
    return conductance(np.ascontiguousarray(samples[:, WIRING]), INPUTS)


class Measured(NamedTuple):
    """Accuracy of each task in per cent, by what scales the force and whether time is scaled.

    ``estimate``: mean of estimated over set force, and its standard deviation over textures, for
    each force.
    """

    accuracy: dict[tuple[str, bool], dict[str, float]]
    estimate: dict[float, tuple[float, float]]


def measure(parameters: WorldParameters, seed: int, repeats: int) -> Measured:
    """Simulate a session and its calibration, and classify every representation."""
    (slides,) = simulate_slides(parameters, repeats, [seed])
    calibration = calibrate(parameters, seed)
    own = searched_c(slides, REFERENCE_FORCE_G)
    accuracy = {
        (name, layout is SPEED_SCALED): accuracies(features, slides.design, seed)
        for layout in LAYOUTS
        for name, features in _features(slides, own, calibration, layout)
    }
    return Measured(accuracy, _estimates(calibration, slides))


def _features(
    slides: SlideSession, own: Floats, found: Calibration, layout: FeatureLayout
) -> Iterator[tuple[str, Floats]]:
    """Yield the features with each kind of force scaling; ``own``: C of each trial's texture."""
    readings = [_readings(samples) for samples in slides.samples]
    yield "Original", slide_features(slides, layout)
    yield "Force Scaled (label)", slide_features(slides, layout, own)
    yield "texture-blind C (set force)", slide_features(slides, layout, _blind(own, slides.design))
    ranges = Normalisation.from_samples(readings, "all trials", Reading.CONDUCTANCE)
    encode = partial(_encode, readings, slides.design, ranges, layout)
    forces_g = slides.design.force_g
    for each, name in ((False, "Calibrated by the set force"), (True, "the same for each taxel")):
        yield name, encode(factors=found.factors(forces_g, ranges, each=each))
    shares, plain = encode(gain=divided(ranges)), encode()
    yield "Divided", shares
    yield "Divided, beside plain SA rates", np.hstack([shares, plain[:, : plain.shape[1] // 2]])
    yield "Calibrated", encode(gain=calibrated(LEVELS_G, found.curves, ranges))


def _blind(c: Floats, design: Design) -> Floats:
    """Return the mean of C over all textures at a speed and force, for each trial."""
    keys = np.stack([design.speed_mm_s, design.force_g], axis=1)
    _, condition = np.unique(keys, axis=0, return_inverse=True)
    condition = condition.reshape(-1)
    means = np.array([c[condition == one].mean(axis=0) for one in range(condition.max() + 1)])
    blind: Floats = means[condition]
    return blind


def _encode(
    readings: Sequence[Samples],
    design: Design,
    ranges: Normalisation,
    layout: FeatureLayout,
    gain: ForceGain | None = None,
    factors: Floats | None = None,
) -> Floats:
    out = np.empty((len(readings), layout.n_features(ranges.n_taxels)))
    for speed in np.unique(design.speed_mm_s):
        rows = np.flatnonzero(design.speed_mm_s == speed).tolist()
        trials = [readings[row] for row in rows]
        lengths = [len(trial) for trial in trials]
        timing = common_bin_edges([layout], max(lengths), float(speed)), lengths, float(speed)
        scale = None if factors is None else factors[rows]
        encoder = (timing[0], ranges, CONDUCTANCES)
        counts = count_spikes(trials, *encoder, sa_scale=scale)
        if gain is not None:
            scaled = [gain.apply(trial) for trial in trials]
            counts[:, : ranges.n_taxels] = count_spikes(scaled, *encoder, sa_only=True)
        out[rows] = features_from_counts(counts, *timing, layout)
    return out


def accuracies(features: Floats, design: Design, seed: int) -> dict[str, float]:
    """Return the accuracy of each task of Table 1 with 50 components, per cent."""
    folds = stratified_folds(design.texture, published.N_FOLDS, seed)
    fits = [[Split(train, {"textures": test, "groups": test}) for train, test in folds]]
    fits += [make_splits(design, "extrapolation", seed, draw) for draw in range(DRAWS)]
    correct, tested = (dict.fromkeys((task.key for task in TASKS), 0) for _ in range(2))
    for splits in fits:
        tasks = [task for task in TASKS if task.key in splits[0].tests]
        for key, score in score_splits(features, design, splits, tasks, published.K_MAX).items():
            correct[key] += int(score.correct[-1])
            tested[key] += score.n_tested
    return {key: 100.0 * correct[key] / tested[key] for key in correct}


def _estimates(found: Calibration, slides: SlideSession) -> dict[float, tuple[float, float]]:
    design = slides.design
    shown = np.array([found.estimated_g(_readings(one)) for one in slides.samples]) / design.force_g
    out = {}
    for force_g in np.unique(design.force_g):
        of_texture = [
            shown[(design.force_g == force_g) & (design.texture == texture)].mean()
            for texture in range(len(design.textures))
        ]
        out[float(force_g)] = float(np.mean(of_texture)), float(np.std(of_texture))
    return out


def table(measured: Sequence[Measured]) -> str:
    """Return a line for each representation: accuracies, mean over the seeds and each."""
    lines = ["| force scaling | time | " + " | ".join(task.title for task in TASKS) + " |"]
    lines.append("|---|---|" + "---:|" * len(TASKS))
    for name, is_scaled in measured[0].accuracy:
        cells = []
        for task in TASKS:
            each = [one.accuracy[name, is_scaled][task.key] for one in measured]
            cells.append(f"{np.mean(each):.1f} ({', '.join(f'{value:.0f}' for value in each)})")
        time = "speed" if is_scaled else "plain"
        lines.append(f"| {name} | {time} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def gain_table(measured: Sequence[Measured]) -> str:
    """Return what each scaling gains over Original at untrained forces, beside half of C's gain."""
    columns = [(task, scaled) for task in UNTRAINED for scaled in (False, True)]
    titles = {task.key: task.title.lower() for task in TASKS}
    heads = [f"{titles[task]}, {'speed scaled' if scaled else 'plain'}" for task, scaled in columns]
    lines = ["| seed | force scaling | " + " | ".join(heads) + " |", "|---|---|" + "---:|" * 4]
    names = list(dict.fromkeys(name for name, _ in measured[0].accuracy))[1:]
    for seed, one in zip(SEEDS, measured, strict=False):
        for name in names:
            gains = [
                one.accuracy[name, scaled][task] - one.accuracy["Original", scaled][task]
                for task, scaled in columns
            ]
            cells = " | ".join(f"{gain:+.1f}" for gain in gains)
            lines.append(f"| {seed} | {name} | {cells} |")
    return "\n".join(lines) + "\n"


def estimate_table(measured: Sequence[Measured]) -> str:
    """Return the estimated over the set force: mean over textures ± their deviation."""
    forces_g = list(measured[0].estimate)
    lines = ["| seed | " + " | ".join(f"{force_g:g} g" for force_g in forces_g) + " |"]
    lines.append("|---|" + "---:|" * len(forces_g))
    for seed, one in zip(SEEDS, measured, strict=False):
        cells = [f"{mean:.2f} ± {sd:.3f}" for mean, sd in one.estimate.values()]
        lines.append(f"| {seed} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _bench_words(parameters: WorldParameters) -> str:
    """Return the parameters that are not the nominal bench's."""
    pairs = zip(parameter_infos(parameters), parameter_infos(), strict=True)
    changed = [f"{one.name} = {one.value:g}" for one, usual in pairs if one.value != usual.value]
    return f"the bench with {', '.join(changed)}" if changed else "the nominal bench"


def main(arguments: list[str] | None = None) -> int:
    """Measure and write the page, or print with ``--print``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--world", type=Path, help="world file (default: the nominal bench)")
    parser.add_argument(
        "--repeats", type=int, default=REPEATS, help=f"of each condition ({REPEATS})"
    )
    parser.add_argument("--print", action="store_true", help="print, and leave the page as it is")
    options = parser.parse_args(arguments)
    try:
        world = NOMINAL_WORLD if options.world is None else load_world(options.world)
        measured = [measure(world.parameters, seed, options.repeats) for seed in SEEDS]
    except RigctlError as error:
        print(f"rigctl: {error}", file=sys.stderr)
        return 2
    bench = _bench_words(world.parameters)
    text = (
        f"Slides of {bench}, {options.repeats} of each condition, seeds "
        f"{', '.join(map(str, SEEDS))}; mean accuracy in % and that of each seed.\n\n"
        f"{table(measured)}\nGain over Original, points:\n\n{gain_table(measured)}\n"
        f"Estimated over set force, mean over the textures ± their deviation:\n\n"
        f"{estimate_table(measured)}"
    )
    if options.print:
        print(text, end="")
        return 0
    head, _, _ = PAGE.read_text(encoding="utf-8").partition(MARK)
    PAGE.write_text(f"{head}{MARK}\n{text}", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
