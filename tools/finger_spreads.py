"""Measure which spread of a person's movement decides how well a moving finger knows textures.

``python -m tools.finger_spreads`` prints the table of ``docs/explanation/moving-finger.md``: sets
of the paper's protocol from slides of the virtual finger, without board and cable. Marks and
velocities are those of the wrist, which wears the tracker; its noise and delay are not in them.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

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
from rigctl.finger.analysis.tasks import DrawSettings, run_finger_tasks
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
        at_marks = [np.argmax(tracked_mm[slide.down : slide.up] >= mark) for mark in MARKS_MM]
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


def main(arguments: list[str] | None = None) -> int:
    """Print a row for the nominal person and one for each spread that is taken away.

    With ``--gains``: a row for each representation of the nominal person.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--world", type=Path, help="world file of skin and plates")
    parser.add_argument("--seeds", type=int, nargs="+", default=JUDGES, help="(4 5 6)")
    parser.add_argument("--gains", action="store_true", help="every representation, all tasks")
    options = parser.parse_args(arguments)
    try:
        world = load_world(options.world).parameters if options.world else WorldParameters()
    except RigctlError as error:
        print(f"rigctl: {error}", file=sys.stderr)
        return 2
    if options.gains:
        sets = [simulate_data_set(world, OperatorParameters(), seed) for seed in options.seeds]
        _print_gains(accuracies(sets))
        return 0
    print(_row("person", *(f"{task.key}, {kind}" for task in TASKS for kind in KINDS)))
    print(_row(*["---"] * (1 + len(TASKS) * len(KINDS))))
    for name, spreads in PERSONS.items():
        person: Any = replace(OperatorParameters(), **dict.fromkeys(spreads, 0.0))
        sets = [simulate_data_set(world, person, seed) for seed in options.seeds]
        found = accuracies(sets)
        cells = (f"{found[task, kind]:.1f}" for task in TASKS for kind in KINDS)
        print(_row(name, *cells), flush=True)
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
