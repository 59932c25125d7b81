"""A virtual data set lifts when its protocol does, with the bench's memory of a contact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.session.session import Session
from rigctl.session.verify import verify
from rigctl.synth.dataset import DatasetRequest, generate, load_plan

TEXT = """
textures = ["B"]
speeds_mm_s = [100, 120]
forces_g = [500]
repeats = 3
[trial]
lift = "{lift}"
[[steps]]
at = "drift"
kind = "tare"
limit_g = 1
"""


def make(folder: Path, lift: str, stop_at: int = 1000, resume: bool = False) -> None:
    (path := folder.parent / "plan.toml").write_text(TEXT.format(lift=lift))
    done: list[object] = []
    plan = load_plan(path, None, 1)
    request = DatasetRequest(plan, 1, folder, "2026-01-02T03:04:05+00:00", resume)
    generate(request, done.append, lambda: len(done) >= stop_at)


def readings(folder: Path) -> NDArray[np.float64]:
    """Return the mean readings of the trials, float64 (n_trials, n_taxels)."""
    with Session.open(folder) as session:
        return np.array([session.samples(row).mean(axis=0) for row in session.committed()])


def test_repeats_of_one_contact_are_alike(tmp_path: Path) -> None:
    spreads = []
    for lift in ("trial", "condition"):
        make(tmp_path / lift, lift)
        assert verify(tmp_path / lift).whole
        spreads.append(readings(tmp_path / lift)[1:3].std(axis=0).mean())
    assert spreads[1] < 0.3 * spreads[0]


def test_a_data_set_resumed_in_contact_equals_an_uninterrupted_one(tmp_path: Path) -> None:
    make(tmp_path / "whole", "condition")
    make(tmp_path / "parted", "condition", stop_at=2)
    make(tmp_path / "parted", "condition", resume=True)
    np.testing.assert_array_equal(readings(tmp_path / "parted"), readings(tmp_path / "whole"))
