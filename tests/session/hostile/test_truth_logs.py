"""The log of a simulated world from a stranger is read as declared, or refused in one sentence."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.errors import SessionError
from rigctl.session.files.ground_truth import check_log
from rigctl.session.files.truth_file import COLUMNS, END
from rigctl.session.format.data_sets import DIGESTS, LIBVER, TEXTS
from rigctl.session.hdf5_file import write_attributes
from rigctl.session.verify.session import verify
from tests.session.building import record_plan
from tests.session.hostile.spoiling import HOSTILE, spoil
from tests.session.test_truth_log import write_log

PATHS = [*(each.path for each in (*COLUMNS, END, DIGESTS)), *(path for path, _ in TEXTS)]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("truth") / "s"
    record_plan(folder)
    write_log(folder, 3_000)
    return folder


@pytest.fixture
def log(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(recorded / "world.h5", tmp_path / "world.h5"))


def refusal(log: Path) -> str:
    """Return the sentence that refuses a log."""
    with pytest.raises(SessionError) as caught:
        check_log(log)
    sentence = str(caught.value)
    assert str(log) in sentence
    assert "\n" not in sentence
    return sentence


@pytest.mark.parametrize("change", HOSTILE)
def test_each_hostile_data_set_is_refused_by_its_path(log: Path, change: str) -> None:
    whole = log.read_bytes()
    for path in PATHS:
        spoil(log, path, HOSTILE[change])
        assert path in refusal(log)
        log.write_bytes(whole)
    check_log(log)


def resize(path: str, rows: int) -> Callable[[Any], None]:
    return lambda file: file[path].resize(rows, axis=0)


def delete_digests(file: Any) -> None:
    del file[DIGESTS.path], file[END.path], file.attrs["previous_digest"]


CHANGES: dict[str, Callable[[Any], None]] = {
    "the last digest gone": resize("/digests", 10),
    "one digest more": resize("/digests", 12),
    "no digests": resize("/digests", 0),
    "no table of digests": delete_digests,
    "no row at the end": resize("/end", 0),
    "two rows at the end": resize("/end", 2),
    "fewer rows": resize("/sync", 2_999),
    "more rows": resize("/sync", 3_001),
    "another first millisecond": lambda file: write_attributes(file, {"first_ms": 1}),
    "another start": lambda file: write_attributes(file, {"start_loop_s": 1.0}),
    "another first digest": lambda file: write_attributes(file, {"previous_digest": "1" * 64}),
    "no first digest": lambda file: file.attrs.__delitem__("previous_digest"),
    "one attribute more": lambda file: write_attributes(file, {"more": 1}),
    "another unit": lambda file: write_attributes(file["/force_g"], {"unit": "N"}),
}


@pytest.mark.parametrize("change", CHANGES)
def test_no_change_of_rows_digests_or_attributes_is_called_whole(log: Path, change: str) -> None:
    with h5py.File(log, "r+", libver=LIBVER) as file:
        CHANGES[change](file)
    assert "is damaged" in refusal(log)


def test_no_bit_of_the_digests_can_be_changed(log: Path) -> None:
    with h5py.File(log) as file:
        rows = file[DIGESTS.path][()].tobytes()
    whole = log.read_bytes()
    start = whole.index(rows)
    rng = np.random.default_rng(3)
    for at in rng.choice(len(rows), 30, replace=False).tolist():
        hit = bytearray(whole)
        hit[start + at] ^= 1 << int(rng.integers(8))
        log.write_bytes(hit)
        refusal(log)


def test_verify_names_the_log(recorded: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(recorded, tmp_path / "s"))
    assert verify(folder).whole
    with h5py.File(folder / "world.h5", "r+", libver=LIBVER) as file:
        del file["/rig_toml"]
    (problem,) = verify(folder).problems
    assert "world.h5 is damaged: /rig_toml is missing" in problem
