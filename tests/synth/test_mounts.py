"""A virtual plate is seated anew at each mounting, and the session says which one it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.parameters import WorldParameters
from rigctl.bench.world_file import SimulatedWorld
from rigctl.session.session import Session
from rigctl.session.verify import verify
from rigctl.synth.dataset import DatasetRequest, generate, load_plan

TEXT = """
textures = ["B"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 2
mounts = 2
"""


def make(folder: Path, stop_at: int = 1000, resume: bool = False, tilt_mm: float = 0.05) -> None:
    world = SimulatedWorld(replace(WorldParameters(), plate_tilt_mm=tilt_mm))
    (path := folder.parent / "twice.toml").write_text(TEXT)
    plan = load_plan(path, None, 1, world)
    done: list[object] = []
    request = DatasetRequest(plan, 1, folder, "2026-01-02T03:04:05+00:00", resume, world)
    generate(request, done.append, lambda: len(done) >= stop_at)


def mean_readings(folder: Path) -> NDArray[np.float64]:
    """Return the mean reading of each trial and taxel, float64 (n_trials, n_taxels)."""
    with Session.open(folder) as session:
        return np.array([session.samples(row).mean(axis=0) for row in session.committed()])


def test_a_mounting_has_a_tilt_of_its_own(tmp_path: Path) -> None:
    make(tmp_path / "session")
    with Session.open(tmp_path / "session") as session:
        assert session.trials["mount"].tolist() == [1, 1, 2, 2]
        assert session.trials["repeat"].tolist() == [1, 2, 1, 2]
    readings = mean_readings(tmp_path / "session")
    within = np.abs(readings[0] - readings[1]).mean()
    between = np.abs(readings[0] - readings[2]).mean()
    assert between > 3 * within
    assert not verify(tmp_path / "session").problems


def test_an_interrupted_set_continues_in_its_mounting(tmp_path: Path) -> None:
    make(tmp_path / "whole")
    make(tmp_path / "session", stop_at=3)
    make(tmp_path / "session", resume=True)
    with Session.open(tmp_path / "session") as session:
        assert session.trials["mount"].tolist() == [1, 1, 2, 2]
    np.testing.assert_array_equal(
        mean_readings(tmp_path / "session"), mean_readings(tmp_path / "whole")
    )
