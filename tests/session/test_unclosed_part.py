"""A part whose writer was killed opens as if it had been closed; damage is an error at once."""

from __future__ import annotations

import io
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.errors import SessionError
from rigctl.session.read.session import Session
from rigctl.session.read.unclosed_part import CHECKED_BYTES, SUPERBLOCK_BYTES, UnclosedPart, lookup3
from rigctl.session.verify.session import verify
from rigctl.session.write.recorder import Recorder
from tests.session.building import PROTOCOL, RIG, Bench, header, plan, record_plan, recorder

PUBLISHED = (b"Four score and seven years ago", 0x17770551)


@pytest.fixture
def dead(tmp_path: Path) -> Path:
    """A session copied while it is written: what a killed writer leaves."""
    with recorder(tmp_path / "live") as rec:
        rec.begin_part("start", "A")
        bench = Bench(rec)
        for trial in plan().trials[:4]:
            bench.trial(trial)
        rec.wait_written()
        (tmp_path / "dead").mkdir()
        for name in ("part-0001.h5", "protocol.toml", "rig.toml", "writer.lock"):
            (tmp_path / "dead" / name).write_bytes((tmp_path / "live" / name).read_bytes())
    return tmp_path / "dead"


def test_the_checksum_is_that_of_its_author() -> None:
    data, value = PUBLISHED
    assert lookup3(data) == value


def test_the_checksum_is_that_of_hdf5(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    head = (tmp_path / "s" / "part-0001.h5").read_bytes()[:SUPERBLOCK_BYTES]
    assert lookup3(head[:CHECKED_BYTES]) == int.from_bytes(head[CHECKED_BYTES:], "little")


def test_a_dead_part_opens_and_holds_its_trials(dead: Path) -> None:
    with pytest.raises(OSError, match="already open"):
        h5py.File(dead / "part-0001.h5", "r")
    with Session.open(dead) as session:
        assert not session.finished
        assert all(session.window(index).complete for index in range(4))
    report = verify(dead)
    assert len(report.problems) == 1
    assert "was not closed in order, its writer was killed or could not write" in report.problems[0]


def test_a_dead_session_can_be_resumed(dead: Path) -> None:
    with Recorder(dead, header(), PROTOCOL, RIG, resume=True) as rec:
        assert rec.left_by is not None
        rec.begin_part("resume", "B")
        bench = Bench(rec)
        for trial in plan().trials[4:]:
            bench.trial(trial)
    report = verify(dead)
    assert report.whole, report.problems
    assert report.trials_committed == 8


@pytest.mark.parametrize("share", [0.9, 0.5, 0.3, 0.1, 0.001])
def test_a_dead_part_that_was_cut_short_is_named_at_once(dead: Path, share: float) -> None:
    part = dead / "part-0001.h5"
    whole = part.read_bytes()
    part.write_bytes(whole[: int(share * len(whole))])
    problems = verify(dead).problems
    assert any(line.startswith(f"{part} is damaged") for line in problems), problems


def test_an_empty_file_is_damaged(dead: Path) -> None:
    (dead / "part-0001.h5").write_bytes(b"")
    with pytest.raises(SessionError, match="is damaged"):
        Session.open(dead)


def test_it_reads_like_the_file_but_for_the_superblock(dead: Path) -> None:
    data = (dead / "part-0001.h5").read_bytes()
    view = UnclosedPart(dead / "part-0001.h5")
    assert view.readable()
    assert view.seekable()
    assert view.seek(0, io.SEEK_END) == len(data)
    view.seek(40)
    buffer = bytearray(100)
    assert view.readinto(buffer) == 100
    assert buffer[8:] == data[48:140]
    assert view.tell() == 140
    view.seek(-4, io.SEEK_END)
    assert view.readinto(buffer) == 4
    assert np.frombuffer(buffer[:4], np.uint8).tobytes() == data[-4:]
