"""Measure which spread of a person's movement decides how well a moving finger knows textures.

``python -m tools.finger_spreads`` prints a table of ``docs/explanation/moving-finger.md``: sets
of the paper's protocol from slides of the virtual finger, without board and cable. Marks and
velocities are those of the wrist, which wears the tracker; its noise and delay are not in them.
With ``--identify N`` it tries N persons whose spreads lie within their ranges, judges each by
Figure 4B's Original curve alone, and prints what that says of each spread.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.parameter_fields import describe
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.world_file import load_world
from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import RigctlError
from rigctl.finger.analysis.scans import (
    KINDS,
    FingerDataSet,
    FingerEncoding,
    RecordedScans,
    ScanRecording,
    encode_readings,
)
from rigctl.finger.analysis.tasks import DrawSettings, draw_accuracies, run_finger_tasks
from rigctl.finger.bench.calibration import sensor_passport
from rigctl.finger.bench.operator import ALONG, FORCE, WRIST_ALONG, draw_habits, draw_slide
from rigctl.finger.bench.operator_parameters import OperatorParameters
from rigctl.finger.bench.skin import TOP_LAYER, FingerSkin
from rigctl.finger.published import DEPLOYED, FINGER_TASKS, NEW_SESSION, SAME_SESSION, FingerTask
from rigctl.finger.scaled_time import BATCH_SAMPLES
from rigctl.finger.values import MARKS_MM, ScanKind, Stage, VelocityProfile
from tools.identify_bench import JUDGES

PLATES = ("A", "B", "D", "L", "N")
REPEATS = {Stage.NORMALISE: 2, Stage.TRAIN: 4, Stage.CALIBRATE: 2, Stage.RUN: 4}
FIRST_SESSION = (Stage.NORMALISE, Stage.TRAIN)
COMPONENTS = 25
DRAWS = 10
SPREADS: Mapping[str, tuple[str, ...]] = {
    "speed": ("speed_session_spread", "speed_scan_spread", "speed_wander_spread"),
    "path": (
        "run_up_scatter_mm",
        "lateral_session_mm",
        "lateral_scan_mm",
        "lateral_wander_mm",
        "skew_session_deg",
        "skew_scan_deg",
        "seating_mm",
    ),
    "pressure": ("force_session_spread", "force_scan_spread", "force_wander_spread"),
    "the sensor on the finger": (
        "tilt_attachment_deg",
        "tilt_scan_deg",
        "turn_attachment_deg",
        "turn_scan_deg",
        "shift_attachment_mm",
        "attachment_spread",
        "gain_drift_spread",
        "rest_drift_spread",
    ),
    "the wrist": ("wrist_session_mm", "wrist_scan_mm", "wrist_bend_mm", "wrist_wander_mm"),
}
"""Parameters of the virtual person, by what they move."""
PERSONS: Mapping[str, tuple[str, ...]] = {
    "the virtual person": (),
    **{f"without spread of {what}": names for what, names in SPREADS.items()},
    "without any spread": tuple(name for names in SPREADS.values() for name in names),
}
CURVE = {
    "same session, saturation": (SAME_SESSION, range(60, 71), SAME_SESSION.quoted[0].percent),
    "new session, 54 components": (NEW_SESSION, range(54, 55), NEW_SESSION.quoted[0].percent),
}
"""Figure 4B's Original as the paper quotes it: task, components, accuracy in per cent."""
IDENTIFYING_SEEDS = (11, 12)
NEAR = 0.25
"""Share of the persons that count as near the curve."""
IDENTIFIED = 0.5
"""A spread is identified where four fifths of theirs lie within this share of its range."""
TASKS = (SAME_SESSION, NEW_SESSION, DEPLOYED)


class SlidingFinger:
    """A person and a sensor in one session; every slide begins where it touches the plate."""

    def __init__(
        self, parameters: WorldParameters, operator: OperatorParameters, seed: int, session: int
    ) -> None:
        self._operator, self._seed = operator, (seed, session)
        self._habits = draw_habits(operator, np.random.default_rng(self._seed))
        self._skin = FingerSkin(parameters, 1000 * seed + session, self._habits.rest)
        self._n_slides = itertools.count(1)

    def scan(self, plate: str, profile: VelocityProfile, stage: Stage) -> ScanRecording:
        """Return a scan between the marks, not yet encoded: its spikes are 0."""
        number = next(self._n_slides)
        random = np.random.default_rng([*self._seed, number])
        slide = draw_slide(self._operator, self._habits, profile, random)
        self._skin.begin_slide(number, plate, slide.mounting)
        along_mm, force_g = (np.ascontiguousarray(slide.rows[:, i]) for i in (ALONG, FORCE))
        readings = self._skin.advance(along_mm, force_g)[:, TOP_LAYER]
        tracked_mm = along_mm + slide.rows[:, WRIST_ALONG]
        behind = [tracked_mm[slide.down : slide.up] >= mark for mark in MARKS_MM]
        if behind[0][0] or not behind[1][-1]:  # a mark is not passed: a run repeats the scan
            return self.scan(plate, profile, stage)
        at_marks = [np.argmax(passed) for passed in behind]
        inside = slice(*(slide.down + np.array(at_marks)))
        # A batch takes as many milliseconds as it has samples; the last one may have fewer.
        ends = np.append(np.arange(inside.start, inside.stop, BATCH_SAMPLES), inside.stop)
        velocities_um_per_s = np.rint(1e6 * np.diff(tracked_mm[ends]) / np.diff(ends))
        return ScanRecording(
            readings[inside],
            np.zeros_like(readings[inside], np.uint8),
            velocities_um_per_s.astype(np.int64),
            plate,
            profile.value,
            stage.value,
            number,
        )


def simulate_data_set(
    parameters: WorldParameters, operator: OperatorParameters, seed: int
) -> FingerDataSet:
    """Return the scans of a first session and of one on a later day."""
    sets, ranges = [], None
    for session, stages in enumerate((FIRST_SESSION, (Stage.CALIBRATE, Stage.RUN))):
        finger = SlidingFinger(parameters, operator, seed, session)
        scans = [
            finger.scan(plate, profile, stage)
            for stage in stages
            for _ in range(REPEATS[stage])
            for plate, profile in itertools.product(PLATES, VelocityProfile)
        ]
        if ranges is None:
            first = [one.readings for one in scans if one.stage == Stage.NORMALISE.value]
            ranges = Normalisation.from_samples(first, "normalisation")
        encoded = (one._replace(spikes=encode_readings(one.readings, ranges)) for one in scans)
        name, encoding = Path(f"session {session}"), FingerEncoding(ranges)
        recorded = RecordedScans(
            name, tuple(encoded), encoding, True, {}, (), passport=sensor_passport(parameters, seed)
        )
        sets.append(recorded.scans)
    return FingerDataSet.from_sessions(f"seed {seed}", *sets)


def accuracies(data_sets: Sequence[FingerDataSet]) -> dict[tuple[FingerTask, ScanKind], float]:
    """Return accuracies in per cent with :data:`COMPONENTS`, by task and representation."""
    results, _ = run_finger_tasks(data_sets, DrawSettings(draws=DRAWS))
    return {
        (result.task, kind): 100.0 * float(result.mean(kind)[min(COMPONENTS, result.k_max) - 1])
        for result in results
        for kind in result.accuracy
    }


def person(places: Mapping[str, float]) -> OperatorParameters:
    """Return the virtual person with each kind of spread at a place in its ranges.

    0 is the low end, 0.5 the nominal person, 1 the high end.
    """
    rows = {row.name: row for row in describe(OperatorParameters())}
    spreads: dict[str, Any] = {
        name: float(np.interp(place, (0.0, 0.5, 1.0), (row.low, row.value, row.high)))
        for what, place in places.items()
        for name in SPREADS[what]
        for row in [rows[name]]
    }
    return replace(OperatorParameters(), **spreads)


def draw_places(n: int, seed: int) -> list[dict[str, float]]:
    """Return places of n persons that fill all ranges, a Latin hypercube."""
    random = np.random.default_rng(seed)
    each = {what: (random.permutation(n) + random.random(n)) / n for what in SPREADS}
    return [{what: float(places[i]) for what, places in each.items()} for i in range(n)]


def original_curve(world: WorldParameters, places: Mapping[str, float]) -> list[float]:
    """Return a person's figures of :data:`CURVE`, per cent."""
    rows: dict[str, list[Any]] = {}
    settings = DrawSettings(draws=DRAWS)
    for number, seed in enumerate(IDENTIFYING_SEEDS):
        data_set = simulate_data_set(world, person(places), seed)
        for draw in range(DRAWS):
            drawn = draw_accuracies(data_set, ScanKind.ORIGINAL, [0, number, draw], settings)
            for key, accuracy in drawn:
                rows.setdefault(key, []).append(accuracy)
    return [
        100.0 * float(np.mean([row[at.start - 1 : at.stop - 1] for row in rows[task.key]]))
        for task, at, _ in CURVE.values()
    ]


def identify(world: WorldParameters, n: int, seed: int) -> None:
    """Print each person's places and distance from the curve, and what that says of each spread."""
    print(_row(*SPREADS, *CURVE, "distance"))
    print(_row(*["---"] * (len(SPREADS) + len(CURVE) + 1)))
    found = []
    for places in draw_places(n, seed):
        curve = original_curve(world, places)
        off = [ours - quoted for ours, (_, _, quoted) in zip(curve, CURVE.values(), strict=True)]
        found.append([*places.values(), *curve, float(np.sqrt(np.mean(np.square(off))))])
        print(_row(*(f"{value:.2f}" for value in found[-1])), flush=True)
    _print_spreads(np.array(found))


def _print_spreads(table: NDArray[np.float64]) -> None:
    """Print where the persons near the curve have each spread, and its rank correlation with it."""
    near = table[np.argsort(table[:, -1])[: max(2, round(NEAR * len(table)))]]
    correlation = np.asarray(np.corrcoef(table.argsort(axis=0).argsort(axis=0).T))
    print("\n" + _row("spread", "place near the curve", *(f"rank with {x}" for x in CURVE), ""))
    print(_row(*["---"] * (3 + len(CURVE))))
    for column, what in enumerate(SPREADS):
        low, middle, high = np.quantile(near[:, column], (0.1, 0.5, 0.9))
        ranks = correlation[column, len(SPREADS) : len(SPREADS) + len(CURVE)]
        verdict = "identified" if high - low < IDENTIFIED else "free"
        place = f"{middle:.2f} ({low:.2f} to {high:.2f})"
        print(_row(what, place, *(f"{one:+.2f}" for one in ranks), verdict))


def spread_rows(
    parameters: WorldParameters, seeds: Sequence[int] = JUDGES
) -> Iterator[tuple[str, list[float]]]:
    """Yield the accuracies of the virtual person, and those with each spread taken away."""
    for name, spreads in PERSONS.items():
        person: Any = replace(OperatorParameters(), **dict.fromkeys(spreads, 0.0))
        found = accuracies([simulate_data_set(parameters, person, seed) for seed in seeds])
        yield name, [found[task, kind] for task in TASKS for kind in KINDS]


def main(arguments: list[str] | None = None) -> int:
    """Print a row for the nominal person and one for each spread that is taken away.

    With ``--gains``: a row for each representation of the nominal person.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--world", type=Path, help="world file of skin and plates")
    parser.add_argument("--seeds", type=int, nargs="+", default=JUDGES, help="(4 5 6)")
    parser.add_argument("--gains", action="store_true", help="every representation, all tasks")
    parser.add_argument("--identify", type=int, metavar="N", help="persons to try, by Figure 4B")
    options = parser.parse_args(arguments)
    try:
        world = load_world(options.world).parameters if options.world else WorldParameters()
    except RigctlError as error:
        print(f"rigctl: {error}", file=sys.stderr)
        return 2
    if options.identify:
        identify(world, options.identify, options.seeds[0])
        return 0
    if options.gains:
        sets = [simulate_data_set(world, OperatorParameters(), seed) for seed in options.seeds]
        _print_gains(accuracies(sets))
        return 0
    print(_row("person", *(f"{task.key}, {kind}" for task in TASKS for kind in KINDS)))
    print(_row(*["---"] * (1 + len(TASKS) * len(KINDS))))
    for name, found in spread_rows(world, options.seeds):
        print(_row(name, *(f"{accuracy:.1f}" for accuracy in found)), flush=True)
    return 0


def _print_gains(found: Mapping[tuple[FingerTask, ScanKind], float]) -> None:
    print(_row("representation", *(f"{task.figure} {task.title.lower()}" for task in FINGER_TASKS)))
    print(_row(*["---"] * (1 + len(FINGER_TASKS))))
    for kind in ScanKind:
        print(_row(kind, *(f"{found[task, kind]:.1f}" for task in FINGER_TASKS)))


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    sys.exit(main())
