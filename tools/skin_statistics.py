"""Compare the simulated skin's readings with real ones, and show what each mechanism does to them.

``make skin`` writes the tables of ``docs/explanation/real-and-simulated.md``. The scaled
representations are computed here, and never in the search of :mod:`tools.identify_bench`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.further_tasks import TASKS
from rigctl.analysis.published import Task
from rigctl.analysis.representations import represent
from rigctl.analysis.settings import AnalysisSettings
from rigctl.analysis.splits import make_splits
from rigctl.analysis.tasks import SweepSettings, run_tasks, score_splits
from rigctl.analysis.trial_set import Design, TrialSet, join_sessions, open_trials
from rigctl.bench.parameters import WorldParameters, validated
from rigctl.bench.world_file import load_world
from rigctl.config.resources import protocols
from rigctl.config.rig_config import PAPER_ARRAY
from rigctl.config.toml_reader import TomlText
from rigctl.encoder.batch import mean_normalised_reading
from rigctl.encoder.features import SPEED_SCALED, UNSCALED
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.encoder.force_search import mean_sa_rates_hz, search_c
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT
from rigctl.encoder.reading import conductance
from rigctl.errors import ConfigError, RigctlError
from rigctl.exchange.column_map import parse_map
from rigctl.exchange.importer import import_files
from rigctl.session.session import Session
from tools.identify_bench import DRAWS, JUDGES
from tools.skin_figures import SkinFigures, skin_figures
from tools.slides import DEPTHS_MM, SlideSession, simulate_slides, slide_features

PAGE = Path(__file__).parents[1] / "docs" / "explanation" / "real-and-simulated.md"
Floats = NDArray[np.float64]


SHALLOW_MM = (0.6, 0.9, 1.2, 1.5)
SHOWN_REPEATS, MECHANISM_REPEATS = 4, 2
INPUTS = tuple(reading % PAPER_ARRAY.inputs for reading in range(PAPER_ARRAY.count))
"""Input of each reading."""
FORMS = ("original", "force", "force_blind", "speed", "speed_force")
"""Representations in the order of the table's columns."""
LEFT_OUT, EXTRAPOLATED = (
    next(task for task in TASKS if task.key == key)
    for key in ("leave-speed-out", "untrained-speed")
)


def slide_accuracies(slides: SlideSession, reference: float, task: Task) -> tuple[float, ...]:
    """Return the accuracy of each representation in a task, per cent."""
    own = searched_c(slides, reference)
    blind = _texture_blind(own, slides.design)
    encodings = (
        (UNSCALED, None),
        (UNSCALED, own),
        (UNSCALED, blind),
        (SPEED_SCALED, None),
        (SPEED_SCALED, own),
    )
    return tuple(
        _accuracy(slide_features(slides, layout, c), slides.design, task) for layout, c in encodings
    )


def searched_c(slides: SlideSession, reference: float) -> Floats:
    """Return the factor that brings each trial's SA rates to those at the reference press.

    Float64 (n_trials, n_taxels).
    """
    design = slides.design
    ranges = Normalisation.from_samples(slides.samples, "all trials")
    out = np.ones((len(slides.samples), ranges.n_taxels))
    aims: dict[tuple[int, float], tuple[Floats, Floats]] = {}
    conditions = design.conditions()
    for rows in sorted(conditions, key=lambda rows: design.force_g[rows[0]] != reference):
        trials = [slides.samples[row] for row in rows]
        texture_and_speed = int(design.texture[rows[0]]), float(design.speed_mm_s[rows[0]])
        if design.force_g[rows[0]] == reference:
            rates_hz = mean_sa_rates_hz(trials, ranges)
            aims[texture_and_speed] = mean_normalised_reading(trials, ranges), rates_hz
        else:
            out[rows] = search_c(trials, *aims[texture_and_speed], ranges).c
    return out


def _texture_blind(c: Floats, design: Design) -> Floats:
    """Return the mean of C over all textures at a speed and press, for each trial."""
    out = np.empty_like(c)
    for speed in np.unique(design.speed_mm_s):
        for press in np.unique(design.force_g):
            rows = (design.speed_mm_s == speed) & (design.force_g == press)
            out[rows] = c[rows].mean(axis=0)
    return out


def _accuracy(features: Floats, design: Design, task: Task) -> float:
    correct = tested = 0
    for draw in range(DRAWS):
        splits = make_splits(design, task.family, 0, draw)
        score = score_splits(features, design, splits, [task], published.K_MAX)[task.key]
        correct, tested = correct + int(score.correct[-1]), tested + score.n_tested
    return 100.0 * correct / tested


FABRIC_MAP = """
[files]
pattern = '(?P<texture>[A-Za-z]+)_F(?P<force>[0-9]+)_V(?P<speed>-?[0-9]+)mmps_(?P<repeat>[0-9]+)'
[time]
column = "timestamp"
unit = "ms"
[taxels]
columns = ["channel1..channel16"]
[labels]
force_unit = "level"
"""
FORWARD = "forward"
FABRIC_LEVEL = 210.0
"""The level to which the other is scaled."""


class TrialReadings(NamedTuple):
    """Readings of trials, float64 (n, n_taxels) each, and their design."""

    samples: list[Floats]
    design: Design


def import_fabrics(folder: Path, out: Path) -> TrialSet:
    """Import the recordings in a folder as a session and return its trials.

    Raises WrongUse for a folder without recordings, or with others.
    """
    mapping = parse_map(TomlText("fabrics", FABRIC_MAP, ConfigError), "fabrics")
    import_files(sorted(folder.glob("*_F*.csv")), mapping, out, "2022-01-01T00:00:00+00:00")
    return join_sessions([out])


def read_trials(trials: TrialSet) -> list[TrialReadings]:
    """Return imported readings in their own unit, for each direction, forward first."""
    (source,) = trials.provenance
    low, high = np.array(source["scaling"]).T
    with open_trials(trials.files) as reader:
        samples = [low + (high - low) / 65535.0 * reader.read(trial) for trial in trials.trials]
    with Session.open(trials.paths[0]) as session:
        backward = session.trials["direction"][[trial.row for trial in trials.trials]] != FORWARD
    ways = (np.flatnonzero(backward == way) for way in (False, True))
    return [_select(samples, Design.from_trials(trials), rows) for rows in ways]


def _select(samples: Sequence[Floats], of: Design, rows: NDArray[np.intp]) -> TrialReadings:
    design = Design(of.textures, of.texture[rows], of.speed_mm_s[rows], of.force_g[rows])
    return TrialReadings([samples[row] for row in rows], design)


def session_accuracies(trials: TrialSet, reference: float, folder: Path) -> tuple[float, ...]:
    """Return the accuracy of each representation with each speed left out, per cent."""
    settings = AnalysisSettings().with_reference_force(reference)
    made = represent(trials, DEFAULT, folder, settings=settings)
    sweep = SweepSettings(iterations=DRAWS, tasks=(LEFT_OUT.family,))
    ((result,), _) = run_tasks(made, sweep)
    curves = {curve.representation.key: curve for curve in result.curves}
    return tuple(100.0 * float(curves[form].mean[-1]) for form in FORMS)


class Mechanism(NamedTuple):
    """A property of skin, plate or circuit that is changed alone, from the nominal world.

    ``height_spread_mm``: as of :class:`tools.slides.Slider`. ``loaded``: whether the taxels of an
    input load each other, and the divider a taxel.
    """

    name: str
    measured_by: str
    parameters: Mapping[str, Any] = MappingProxyType({})
    height_spread_mm: float | None = None
    loaded: bool = True


def _with(name: str, measured_by: str, **parameters: float) -> Mechanism:
    return Mechanism(name, measured_by, parameters)


WEIGHTS = "reading of a taxel under weights"
TRAVEL = "load cell over travel, smooth plate"
PLATES_END, UNDER_WEIGHTS = "a dial gauge at the plate's ends", "a dial gauge under weights"
RULER, RIDGE, FEELER = "a ruler", "a single ridge", "a feeler gauge at its edges"
MECHANISMS = (
    _with("**the nominal world**", "–"),
    Mechanism("no circuit", "the reading `conductance`", loaded=False),
    _with("more load on dividers", "an ohmmeter", top_gain=0.25, bottom_gain=0.35),
    _with("concave taxel curve", WEIGHTS, conductance_power=0.5),
    _with("convex taxel curve", WEIGHTS, conductance_power=1.3),
    _with("saturating taxels", WEIGHTS, saturation_g=500.0),
    _with("contact area: bridged grooves", "a ridge over carbon paper", bridging_mm=1.0),
    _with("less spread in the lower layer", RIDGE, bottom_blur_mm=1.8),
    _with("more spread in the upper layer", RIDGE, top_blur_mm=1.5),
    _with("no skin beyond the array", RULER, skin_length_mm=15.0),
    _with("taxels that stand out", "a dial gauge", taxel_rise_mm=0.2),
    _with("stiffer frame, softer skin", TRAVEL, frame_share=0.5),
    _with("the same, skin that stiffens", TRAVEL, frame_share=0.5, pressure_power=2.1),
    _with("all softer", TRAVEL, stiffness_g_mm=300.0),
    _with("drum's curve", "a dial gauge", edge_drop_mm=0.2),
    _with("no tilt of the sensor", FEELER, sensor_tilt_mm=0.0),
    _with("more tilt of the sensor", FEELER, sensor_tilt_mm=0.1),
    _with("no tilt of plates", PLATES_END, plate_tilt_mm=0.0),
    _with("more tilt of plates", PLATES_END, plate_tilt_mm=0.03),
    _with("plates that do not give in", UNDER_WEIGHTS, plate_give_mm=0.0),
    _with("plates that give in more", UNDER_WEIGHTS, plate_give_mm=0.05),
    Mechanism("depths from a fixed zero", "–", height_spread_mm=0.0),
    Mechanism("the same, plates ± 0.1 mm", "a calliper", height_spread_mm=0.1),
    _with("finer ridges", RULER, base_space_mm=5.0),
    _with("wider ridges", RULER, base_space_mm=8.0),
)


def mechanism_figures(mechanism: Mechanism) -> list[SkinFigures]:
    """Return the figures at set depths and at set forces, of two repeats of the first seed."""
    parameters = validated(replace(WorldParameters(), **mechanism.parameters))
    found = []
    for depths_mm in (DEPTHS_MM, ()):
        (slides,) = simulate_slides(
            parameters, MECHANISM_REPEATS, JUDGES[:1], depths_mm, mechanism.height_spread_mm
        )
        trials: Sequence[NDArray[Any]] = slides.samples
        if not mechanism.loaded:
            trials = [conductance(trial, INPUTS) for trial in slides.samples]
        found.append(skin_figures(trials, slides.design))
    return found


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |\n"


PRINTED = "21 printed textures, 9 piezoresistive taxels"
STATISTICS_HEAD = _row(
    "set", "pressed", "between textures", "between speeds", "between repeats",
    "between textures over within a trial", "mean, least to most pressed", "amplitude",
) + _row(*["---"] * 8)  # fmt: skip
PRINTED_STATISTICS = _row(
    PRINTED, "depths of 0–1.5 mm", "0.072–0.076", "0.013–0.015", "–", "0.7", "× 1.13–1.20",
    "× 1.2–1.3",
)  # fmt: skip
ACCURACY_HEAD = _row(
    "set", "pressed", "Original", "Force Scaled", "texture-blind", "Speed Scaled", "both"
) + _row(*["---"] * 7)
PRINTED_ACCURACIES = _row(
    PRINTED, "depths of 0–1.5 mm", "39.0", "61.5", "39.0", "92.1", "95.7"
)  # fmt: skip
"""Both rows were measured once, on recordings that another laboratory published."""
FORCES = "250–1000 g"
TRAINED = "250–1000 g, only 40–80 mm/s trained"
PAPERS_ACCURACIES = _row("the paper", TRAINED, "36.8", "67.5", "–", "85.5", "91.5")
MECHANISM_HEAD = _row(
    "changed", "parameters", "by depth: between textures", "over within", "mean", "amplitude",
    "by force: between textures", "over within", "mean", "amplitude", "measured by",
) + _row(*["---"] * 11)  # fmt: skip


def mechanism_table() -> str:
    """Return a row for each mechanism."""
    rows = [MECHANISM_HEAD]
    for mechanism in MECHANISMS:
        changes = ", ".join(f"`{name}` {v:g}" for name, v in mechanism.parameters.items())
        cells = []
        for figures in mechanism_figures(mechanism):
            textures, _, _, *others = figures.cells
            cells += [textures, *others]
        rows.append(_row(mechanism.name, changes or "–", *cells, mechanism.measured_by))
        print(rows[-1], end="", file=sys.stderr, flush=True)
    return "".join(rows)


def _depths(depths_mm: Sequence[float]) -> str:
    return f"depths of {depths_mm[0]}–{depths_mm[-1]} mm"


class SimulatedBench(NamedTuple):
    """A world whose figures the page shows, under a name."""

    name: str
    parameters: WorldParameters

    def statistics_row(self, pressed: str, depths_mm: Sequence[float]) -> str:
        """Return its row in the table of statistics, of the first seed."""
        (slides,) = simulate_slides(self.parameters, SHOWN_REPEATS, JUDGES[:1], depths_mm)
        return _row(self.name, pressed, *skin_figures(slides.samples, slides.design).cells)

    def accuracies_row(
        self, pressed: str, depths_mm: Sequence[float], reference: float, task: Task = LEFT_OUT
    ) -> str:
        """Return its row of accuracies: the mean over the seeds, the least and the greatest."""
        sessions = simulate_slides(self.parameters, SHOWN_REPEATS, JUDGES, depths_mm)
        found = np.array([slide_accuracies(slides, reference, task) for slides in sessions])
        ends = zip(found.mean(axis=0), found.min(axis=0), found.max(axis=0), strict=True)
        cells = (f"{mean:.1f} ({low:.0f}–{high:.0f})" for mean, low, high in ends)
        return _row(self.name, pressed, *cells)


PAPERS_WORLD = load_world(protocols() / "worlds" / "paper.toml")
BENCHES = (
    SimulatedBench("the simulated bench", WorldParameters()),
    SimulatedBench("the paper's rig, simulated", PAPERS_WORLD.parameters),
)


def fabric_rows(folder: Path) -> tuple[str, str]:
    """Return the rows of the fabrics. Raises WrongUse for a folder without their recordings."""
    with tempfile.TemporaryDirectory() as scratch:
        trials = import_fabrics(folder, Path(scratch) / "session")
        name = f"{len(trials.textures)} fabrics, {trials.n_taxels} capacitive taxels"
        pressed = f"{len(trials.forces_g)} levels"
        statistics = [
            _row(f"{name}, {way}", pressed, *skin_figures(*readings).cells)
            for way, readings in zip(("forward", "backward"), read_trials(trials), strict=True)
        ]
        accuracies = session_accuracies(trials, FABRIC_LEVEL, Path(scratch))
        return "".join(statistics), _row(name, pressed, *(f"{one:.1f}" for one in accuracies))


def kept_rows(page: str, table: str) -> str:
    """Return the rows of the fabrics that a page's table has."""
    lines = page.partition(f"<!-- {table} -->")[2].partition(f"<!-- end of {table} -->")[0]
    return "".join(line for line in lines.splitlines(keepends=True) if "capacitive" in line)


def render(page: str, fabrics: Path | None) -> str:
    """Return the page with new tables; without their folder the fabrics keep their rows."""
    rows = [kept_rows(page, name) for name in ("statistics", "accuracies")]
    if fabrics is not None:
        rows = list(fabric_rows(fabrics))
    by_depth = [(_depths(depths_mm), depths_mm) for depths_mm in (DEPTHS_MM, SHALLOW_MM)]
    statistics, accuracies = "", PAPERS_ACCURACIES
    for bench in BENCHES:
        for pressed, depths_mm in (*by_depth, (FORCES, ())):
            statistics += bench.statistics_row(pressed, depths_mm)
            reference = depths_mm[1] if depths_mm else REFERENCE_FORCE_G
            accuracies += bench.accuracies_row(pressed, depths_mm, reference)
        accuracies += bench.accuracies_row(TRAINED, (), REFERENCE_FORCE_G, EXTRAPOLATED)
    tables = {
        "statistics": STATISTICS_HEAD + PRINTED_STATISTICS + rows[0] + statistics,
        "accuracies": ACCURACY_HEAD + PRINTED_ACCURACIES + rows[1] + accuracies,
        "mechanisms": mechanism_table(),
    }
    for name, lines in tables.items():
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
        before, _, rest = page.partition(begin)
        page = f"{before}{begin}\n{lines}{end}{rest.partition(end)[2]}"
    return page


def main(arguments: list[str] | None = None) -> int:
    """Write the tables of the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--fabrics", type=Path, metavar="DIR", help="fabric_slide recordings; else their rows stay"
    )
    options = parser.parse_args(arguments)
    try:
        page = render(PAGE.read_text(encoding="utf-8"), options.fabrics)
    except RigctlError as error:
        print(f"rigctl: {error}", file=sys.stderr)
        return 2
    PAGE.write_text(page, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
