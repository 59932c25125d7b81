"""The log of a simulated world from a stranger is read as declared, or refused in one sentence."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import pytest

from rigctl.errors import SessionError
from rigctl.session.ground_truth import END, check_log
from rigctl.session.layout import DRUM_TRUTH, LIBVER
from rigctl.session.verify import verify
from tests.session.building import record_plan
from tests.session.hostile.spoiling import HOSTILE, spoil
from tests.session.test_truth_log import write_log

PATHS = [each.path for each in (*DRUM_TRUTH, END)]


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


def test_verify_names_the_log(recorded: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(recorded, tmp_path / "s"))
    assert verify(folder).whole
    with h5py.File(folder / "world.h5", "r+", libver=LIBVER) as file:
        del file["/end"]
    (problem,) = verify(folder).problems
    assert "world.h5 is damaged: /end is missing" in problem
