"""``rigctl recover`` puts back a part that was replaced while it was recorded."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from rigctl.session.read.recovery_file import read_recoveries
from rigctl.session.recover.recover import recover
from rigctl.session.verify.session import verify
from tests.session.damage import kill_while_recording, record_four_parts
from tests.session.recover.test_recover import NOW, digests_of, readable_trials


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("killed")
    kill_while_recording(folder / "s", 6, folder / "scratch")
    kill_while_recording(folder / "older", 2, folder / "another")
    record_four_parts(folder / "other", repeats=4)
    return folder


PUT_THERE: dict[str, Callable[[Path, Path], object]] = {
    "nothing": lambda sources, part: None,
    "no HDF5": lambda sources, part: part.write_bytes(b"replaced"),
    "another session": lambda sources, part: shutil.copy(sources / "other" / part.name, part),
    "an older copy": lambda sources, part: shutil.copy(sources / "older" / part.name, part),
}


@pytest.mark.parametrize("there", PUT_THERE)
def test_the_saved_part_is_put_back_with_its_trials(
    killed: Path, tmp_path: Path, there: str
) -> None:
    folder = Path(shutil.copytree(killed / "s", tmp_path / "s"))
    part = folder / "part-0001.h5"
    trials, saved = readable_trials(folder), part.read_bytes()
    part.rename(folder / "part-0001.saved")
    PUT_THERE[there](killed, part)
    before = digests_of(folder)
    dry = recover(folder, NOW, dry_run=True)
    assert (dry.parts[0].name, dry.parts[0].remedy) == ("part-0001.h5", "put back")
    assert digests_of(folder) == before
    recover(folder, NOW)
    assert readable_trials(folder) == trials and len(trials) == 6
    assert part.read_bytes()[48:] == saved[48:]
    assert set(before.values()) <= set(digests_of(folder).values())
    (record,) = read_recoveries(folder)
    assert [one.name for one in record.moved] == ([] if there == "nothing" else [part.name])
    assert [one.name for one in record.replaced_parts] == [part.name]
    assert verify(folder).whole, verify(folder).problems
    assert recover(folder, NOW).findings.is_in_order


def test_a_saved_file_beside_a_good_part_is_left_alone(killed: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(killed / "other", tmp_path / "s"))
    for name in ("part-0001.saved", "part-0002.saved"):
        (folder / name).write_bytes(b"no part")
    shutil.copy(folder / "part-0001.h5", folder / "part-0001.saved")
    before = digests_of(folder)
    assert recover(folder, NOW).findings.is_in_order
    assert digests_of(folder) == before
