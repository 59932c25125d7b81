"""Models, files of spikes and their parts from a stranger are read as declared, or refused."""

from __future__ import annotations

import os
from collections.abc import Callable
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.encoder.parameters import EncoderParameters
from rigctl.encoder.reading import Reading
from rigctl.errors import SessionError
from rigctl.finger.model_file import load_finger_model
from rigctl.session.analysis_file import LATER_PARAMETERS, load_force, load_inputs, load_ranges
from rigctl.session.hdf5_file import text_scalar
from rigctl.session.layout import LIBVER
from rigctl.session.model_file import load_model
from tests.session.hostile.analysis_files import write_finger_model, write_model, write_spikes
from tests.session.hostile.spoiling import HOSTILE, spoil

Load = Callable[[Path], Any]


def load_spikes(path: Path) -> None:
    """Read all that rigctl reads of a file of spikes."""
    load_force(path, Reading.COUNTS)
    load_ranges(path)
    load_inputs(path)


KINDS: dict[str, tuple[Callable[[Path], Path], Load, tuple[str, ...]]] = {
    "model": (write_model, load_model, ()),
    "finger model": (write_finger_model, load_finger_model, ()),
    "spikes": (write_spikes, load_spikes, ("c/", "inputs", "encoder/taxel_")),
}
"""How to write and load each kind, and the beginnings of the paths that are read; empty: all."""
CHANGES_EACH = 2
"""Changes tried at each data set, in turns: each change meets several data sets of each kind."""
UNREAD = ("/features/order", "/encoder/scaled_by")


def read_paths(path: Path, beginnings: tuple[str, ...]) -> list[str]:
    names: list[str] = []
    with h5py.File(path) as file:
        file.visititems(
            lambda name, node: names.append(f"/{name}") if isinstance(node, h5py.Dataset) else None
        )
    wanted = [name for name in names if name[1:].startswith(beginnings or "")]
    return [name for name in wanted if name not in UNREAD]


def refusal(load: Load, path: Path) -> str:
    with pytest.raises(SessionError) as caught:
        load(path)
    sentence = str(caught.value)
    assert str(path) in sentence
    assert "\n" not in sentence
    return sentence


@pytest.mark.parametrize("kind", KINDS)
def test_each_hostile_data_set_is_refused_by_its_path(tmp_path: Path, kind: str) -> None:
    write, load, beginnings = KINDS[kind]
    path = write(tmp_path / "file.h5")
    load(path)
    whole = path.read_bytes()
    changes = cycle(HOSTILE.values())
    for name in read_paths(path, beginnings):
        for change in islice(changes, CHANGES_EACH):
            spoil(path, name, change)
            assert name[1:] in refusal(load, path)
            path.write_bytes(whole)


IMPOSSIBLE: tuple[tuple[str, str, Any], ...] = (
    ("model", "features/n_windows", 0),
    ("model", "features/n_windows", 1 << 40),
    ("model", "features/window_ms", 0),
    ("model", "features/reference_mm_s", np.inf),
    ("model", "encoder/sample_rate_hz", 0.0),
    ("model", "encoder/sample_rate_hz", 1e300),
    ("model", "encoder/substeps", 2.5),
    ("model", "encoder/taxel_low", np.array([70_000, 0])),
    ("model", "encoder/taxel_high", np.array([0.5, 1.0])),
    ("model", "lda/dropped", np.array([9])),
    ("model", "lda/dropped", np.array([np.nan])),
    ("model", "pca/variance", np.array([np.nan, 1.0])),
    ("model", "training/inputs", "[" * 100_000),
    ("model", "training/inputs", '{"path": 1}'),
    ("model", "training/inputs", '[{"content": []}]'),
    ("model", "training/inputs", '[{"n_taxels": 1000000000000}]'),
    ("model", "training/inputs", '[{"wiring": "abc"}]'),
    ("model", "training/inputs", f'[{{"seed": {"9" * 10_000}}}]'),
    ("model", "c/speeds_mm_s", np.array([np.nan])),
    ("finger model", "reference_um_per_s", 0),
    ("finger model", "calibration/labels", np.array([0, 7])),
    ("spikes", "inputs", "null"),
    ("spikes", "c/c", np.full((2, 2, 1, 1), np.inf)),
)


@pytest.mark.parametrize(("kind", "name", "value"), IMPOSSIBLE)
def test_impossible_values_are_refused(tmp_path: Path, kind: str, name: str, value: Any) -> None:
    write, load, _ = KINDS[kind]
    path = write(tmp_path / "file.h5")
    with h5py.File(path, "r+", libver=LIBVER) as file:
        del file[name]
        file[name] = text_scalar(value) if isinstance(value, str) else value
    assert len(refusal(load, path)) < 500


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_is_refused_without_being_opened(tmp_path: Path, kind: str) -> None:
    load = KINDS[kind][1]
    os.mkfifo(tmp_path / "pipe")
    assert "is a pipe" in refusal(load, tmp_path / "pipe")
    assert "is a folder" in refusal(load, tmp_path)
    assert "is a device" in refusal(load, Path("/dev/zero"))
    assert "No such file" in refusal(load, tmp_path / "none.h5")


def delete(path: Path, names: tuple[str, ...]) -> None:
    """Delete data sets; who does so breaks the seal."""
    with h5py.File(path, "r+", libver=LIBVER) as file:
        for name in names:
            del file[name]


def test_a_model_of_an_older_version_has_the_default_ra_channel(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.h5")
    delete(path, tuple(f"encoder/{name}" for names in LATER_PARAMETERS for name in names))
    model = load_model(path)
    assert model.parameters == EncoderParameters()
    assert model.c is not None and model.c.rate_hz is None


def test_a_model_with_a_part_of_the_ra_channel_is_refused(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.h5")
    delete(path, ("encoder/ra_order",))
    assert "encoder/ra_order" in refusal(load_model, path)
