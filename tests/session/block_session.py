"""A session whose tables have several blocks of rows, each with its digest."""

from __future__ import annotations

from pathlib import Path

import h5py

from tests.session import building
from tests.session.building import SyntheticRig, plan


def record_in_blocks(folder: Path, first_value: int = 0) -> str:
    """Record the plan with a flush after each trial; return the closing digest."""
    with building.recorder(folder) as rec:
        source = SyntheticRig(rec, first_value)
        texture = ""
        for trial in plan().trials:
            if trial.texture != texture:
                texture = trial.texture
                rec.begin_part("plate change", texture)
            source.trial(trial)
            rec.wait_written()
    return rec.closing_digest


def spoil_one_sample(file: h5py.File) -> None:
    """Change one bit of a sample of trial 6."""
    file["/taxels/samples"][500, 3] ^= 1
