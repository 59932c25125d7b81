"""A part whose writer was killed opens like a closed one; a damaged part is an error."""

from __future__ import annotations

from pathlib import Path

import h5py
import pytest

from rigctl.errors import SessionError
from rigctl.session.part import CHECKSUM_AT, SUPERBLOCK_BYTES, lookup3, map_as_closed
from rigctl.session.recorder import Recorder
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan, record_plan, recorder

PUBLISHED = (b"Four score and seven years ago", 0x17770551)


@pytest.fixture
def dead(tmp_path: Path) -> Path:
    """Return a session that was copied while it was written, as a killed writer leaves it."""
    with recorder(tmp_path / "live") as rec:
        rec.begin_part("start", "A")
        bench = SyntheticRig(rec)
        for trial in plan().trials[:4]:
            bench.trial(trial)
        rec.wait_written()
        (tmp_path / "dead").mkdir()
        for name in ("part-0001.h5", "protocol.toml", "rig.toml", "writer.lock"):
            (tmp_path / "dead" / name).write_bytes((tmp_path / "live" / name).read_bytes())
    return tmp_path / "dead"


def test_the_checksum_agrees_with_published_values() -> None:
    data, value = PUBLISHED
    assert lookup3(data) == value


def test_the_checksum_agrees_with_hdf5(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    head = (tmp_path / "s" / "part-0001.h5").read_bytes()[:SUPERBLOCK_BYTES]
    assert lookup3(head[:CHECKSUM_AT]) == int.from_bytes(head[CHECKSUM_AT:], "little")


def test_a_dead_part_opens_and_holds_its_trials(dead: Path) -> None:
    with pytest.raises(OSError, match="already open"):
        h5py.File(dead / "part-0001.h5", "r")
    with Session.open(dead) as session:
        assert not session.finished
        assert all(session.window(index).complete for index in range(4))
    report = verify(dead)
    assert len(report.problems) == 1
    assert "was not closed properly, its writer was killed or could not write" in report.problems[0]


def test_a_dead_session_can_be_resumed(dead: Path) -> None:
    with Recorder(dead, header(), PROTOCOL, RIG, resume=True) as rec:
        rec.begin_part("resume", "B")
        bench = SyntheticRig(rec)
        for trial in plan().trials[4:]:
            bench.trial(trial)
    report = verify(dead)
    assert report.whole, report.problems
    assert report.trials_committed == 8


@pytest.mark.parametrize("share", [0.9, 0.5, 0.3, 0.1, 0.001])
def test_a_dead_part_that_was_cut_short_is_named_immediately(dead: Path, share: float) -> None:
    part = dead / "part-0001.h5"
    whole = part.read_bytes()
    part.write_bytes(whole[: int(share * len(whole))])
    problems = verify(dead).problems
    words = (f"{part} is damaged", "part-0001.h5 was cut short")
    assert any(line.startswith(words) for line in problems), problems


def test_an_empty_file_is_damaged(dead: Path) -> None:
    (dead / "part-0001.h5").write_bytes(b"")
    with pytest.raises(SessionError, match="is damaged"):
        Session.open(dead)


def test_the_map_equals_the_file_except_for_the_superblock(dead: Path) -> None:
    part = dead / "part-0001.h5"
    data = part.read_bytes()
    with map_as_closed(part) as view:
        assert view[SUPERBLOCK_BYTES:] == data[SUPERBLOCK_BYTES:]
        head = view[:SUPERBLOCK_BYTES]
    assert head[CHECKSUM_AT:] == lookup3(head[:CHECKSUM_AT]).to_bytes(4, "little")
    assert head[11] == 0 != data[11]
    assert int.from_bytes(head[28:36], "little") == len(data)
    assert part.read_bytes() == data


@pytest.mark.parametrize("data", [b"short", b"not HDF5".ljust(100)])
def test_another_file_is_not_mapped(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "other").write_bytes(data)
    with pytest.raises(OSError, match="too short, or it is not HDF5"):
        map_as_closed(tmp_path / "other")
