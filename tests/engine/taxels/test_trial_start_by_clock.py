"""Trials without a sync wire: cut by the drum's clock, within the stated uncertainty."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.bench.chips.rig import ChipSimulation
from rigctl.bench.virtual_rig import VirtualRig
from rigctl.boards.clock_fit import ClockFit
from rigctl.boards.drum_codes import Signal
from rigctl.boards.drum_states import State
from rigctl.cli import main
from rigctl.cli.run import _rig
from rigctl.config.rig_config import Ports, RigConfig, Signals
from rigctl.engine.rig import Rig
from rigctl.engine.step_runner import (
    POLL_WIRE_S,
    estimate_trial_start,
    frame_wire_s,
)
from rigctl.rig import open_rig
from rigctl.session.ground_truth import open_truth
from rigctl.session.session import Session
from rigctl.session.summary import summarise_session
from rigctl.session.verify import verify
from tests.engine.engine_harness import TINY, EngineHarness, open_harness, open_session
from tests.firmware.taxels.chip import TaxelChip

NO_WIRE = RigConfig(signals=Signals(sync=False))
EARLIEST_MS, LATEST_MS = -1.0, 2.0
"""Delay of the first sample after the window's true start; the sync line gives 0 to 1."""


def first_reading_ms(rig: Rig) -> Callable[[int], float]:
    """Return the world time at which the taxel board began the frame of that counter."""
    simulation = rig.simulation
    if isinstance(simulation, VirtualRig):
        taxels = simulation._taxels
        return lambda counter: (taxels._origin_us + counter * taxels.frame_us) / 1000
    assert isinstance(simulation, ChipSimulation)
    clock = simulation.taxels_board.clock
    with TaxelChip() as alone:
        alone.run(2)
        zero = int(alone.sampled(0)[0])
    return lambda counter: clock.us(counter * 16_000 + zero) / 1000


def true_start_ms(session: Session, index: int) -> float:
    """Return the world time at the end of the run-in, from the ground truth of the travel."""
    with open_truth(session.path / "world.h5") as truth:
        first_ms, speed = truth.first_ms, truth.window("speed_mm_s", 0, truth.n_rows)
    polls = session.drum(index).polls
    last_still = int(np.flatnonzero(polls["state"] == State.RUN)[0]) - 1
    first = int(polls["at_s"][last_still] * 1000) - first_ms
    travel_mm = np.cumsum(np.abs(speed[first:].astype(np.float64))) * 1e-3
    run_in_mm = session.config.drum.run_in_mm
    behind = int(np.argmax(travel_mm >= run_in_mm - 1e-3))
    before_mm = travel_mm[behind - 1]
    share = (run_in_mm - before_mm) / (travel_mm[behind] - before_mm)
    return first_ms + first + behind + float(share)


@pytest.mark.parametrize("kind", ["virtual", "firmware"])
def test_the_first_sample_is_within_the_stated_uncertainty(tmp_path: Path, kind: str) -> None:
    protocol = TINY.replace('"A", "L"', '"D"').replace("100, 120", "75, 120")
    with open_harness(tmp_path, rig_kind=kind, config=NO_WIRE) as harness:
        run = harness.record(protocol)
        assert (run.outcome, run.complete) == ("done", True)
        reading_ms = first_reading_ms(harness.rig)
        with open_session(harness.session) as session:
            trials = [event.data for event in session.events_of("trial")]
            late_ms = [
                reading_ms(int(session.trials["first_counter"][index]))
                - true_start_ms(session, int(index))
                for index in session.committed()
            ]
            assert all(session.window(int(i)).complete for i in session.committed())
    assert len(trials) == len(late_ms) == 2
    for late, data in zip(late_ms, trials, strict=True):
        assert data["cut_by"] == "drum clock"
        assert EARLIEST_MS <= late <= LATEST_MS
        assert abs(late) < data["cut_uncertainty_ms"] < 8


def test_a_session_without_the_wire_is_valid_and_usable(tmp_path: Path) -> None:
    with open_harness(
        tmp_path, config=replace(NO_WIRE, ports=Ports(simulate="virtual"))
    ) as harness:
        assert harness.record().complete
        assert any("drum's clock cuts" in text for text in harness.texts("log"))
    report = verify(harness.session)
    assert report.whole, report.problems
    assert any("the drum's clock marks the trials" in note for note in report.notes)
    summary = summarise_session(harness.session)
    assert summary["cut_by"] == "drum clock"
    assert summary["world"]["trials"] == 4
    assert summary["world"]["max_speed_error_permille"] < 1
    assert main(["encode", str(harness.session), "--out", str(tmp_path / "spikes.h5")]) == 0
    resumed = _rig(Namespace(rig=None, resume=str(harness.session)))
    assert Path(resumed) == harness.session / "rig.toml", "with the wires that it was begun with"
    with open_session(harness.session) as session:
        assert not np.any(session.window(0).flags & 1), "the board drives no wire that is absent"


def test_a_fitted_wire_that_is_broken_rejects_the_trial(harness: EngineHarness) -> None:
    assert harness.rig.faults is not None
    harness.rig.faults.rewire(absent=[Signal.SYNC])
    run = harness.record(TINY.replace('"A", "L"', '"A"').replace("100, 120", "120"))
    assert not run.complete
    with open_session(harness.session) as session:
        assert session.header.cut_by == "sync line"
        assert set(session.trials["verdict"].tolist()) == {"rejected"}
        assert "never rose" in session.trials["reasons"][0]


def test_a_description_may_have_simulated_boards_without_the_wire(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text('[ports]\nsimulate = "virtual"\n[signals]\nsync = false\n')
    rig = open_rig(str(path), paced=False)
    try:
        assert (rig.kind, rig.simulated) == ("virtual", True)
        assert isinstance(rig.simulation, VirtualRig)
        assert rig.simulation._bench.disturbances.absent == {Signal.SYNC}
        assert rig.config.ports == Ports(simulate="virtual")
    finally:
        rig.close()


def clock(ppm: float, wire_s: float, late_s: np.ndarray, step_s: float) -> ClockFit:
    """Return a clock read every ``step_s`` for 20 s, with delayed arrivals."""
    fit = ClockFit()
    for n, late in enumerate(late_s):
        true_s = 100 + n * step_s
        fit.add((true_s - 90) * (1 + ppm * 1e-6), true_s + wire_s + float(late))
    return fit


@pytest.mark.parametrize("ppm", [-5000.0, 0.0, 5000.0])
def test_arrivals_with_jitter_give_a_start_within_the_uncertainty(ppm: float) -> None:
    random = np.random.default_rng(7)
    drum = clock(1200, POLL_WIRE_S, random.exponential(0.002, 400), 0.05)
    taxels = clock(ppm, frame_wire_s(18), random.exponential(0.004, 400), 0.05)
    rise_s = 119.9
    place = estimate_trial_start(round((rise_s - 90) * (1 + 1200e-6) * 1e6), drum, taxels, 18)
    assert place is not None
    right = (rise_s - 90) * (1 + ppm * 1e-6) * 1000
    assert abs(place.first_counter - right) < 2 < place.uncertainty_ms < 15


def test_an_unknown_clock_gives_no_start() -> None:
    known = clock(0, 0.0, np.zeros(400), 0.05)
    assert estimate_trial_start(1, known, ClockFit(), 18) is None
    assert estimate_trial_start(1, ClockFit(), known, 18) is None
