"""A session on a second disk: whole files under their names, nothing overwritten, troubles told."""

from __future__ import annotations

import shutil
from collections import namedtuple
from pathlib import Path

import h5py
import pytest

from rigctl.cli import main
from rigctl.session import second_copy
from rigctl.session.recover import recover
from rigctl.session.second_copy import DRAFTS, SessionCopy
from rigctl.session.verify import verify
from tests.session.block_session import spoil_one_sample
from tests.session.building import SyntheticRig, plan, recorder

Usage = namedtuple("Usage", "total used free")


@pytest.fixture
def disk(tmp_path: Path) -> Path:
    folder = tmp_path / "second"
    folder.mkdir()
    return folder


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_closed_session_is_copied_whole(
    session: Path, disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["copy", str(session), str(disk)]) == 0
    copy = disk / session.name
    assert names(copy) == names(session)
    assert all((copy / name).read_bytes() == (session / name).read_bytes() for name in names(copy))
    assert verify(copy).whole
    assert "part-0001.h5\n" in capsys.readouterr().out
    assert main(["copy", str(session), str(disk)]) == 0
    assert capsys.readouterr().out == f"{copy} has all that is finished\n"


def test_a_part_is_copied_when_the_next_one_has_begun(tmp_path: Path, disk: Path) -> None:
    copy = SessionCopy(tmp_path / "session", disk)
    with recorder(tmp_path / "session") as rec:
        source, (first, second, *_) = SyntheticRig(rec), plan().trials
        rec.begin_part("start", first.texture)
        source.trial(first)
        rec.wait_written()
        copy.update()
        assert copy.copied == ["protocol.toml", "rig.toml"]
        rec.begin_part("another plate", second.texture)
        source.trial(second)
        rec.wait_written()
        copy.update()
        assert copy.copied[2:] == ["part-0001.h5"]
    copy.update()
    assert copy.copied[3:] == ["part-0002.h5"]
    assert verify(copy.folder).trials_committed == verify(tmp_path / "session").trials_committed


def test_a_disk_that_is_missing_or_full_is_told_and_catches_up(
    session: Path, disk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    disk.rmdir()
    assert main(["copy", str(session), str(disk)]) == 3
    assert f"{disk} is not there: connect the second disk" in capsys.readouterr().err
    assert not disk.exists(), "an unmounted disk's folder would be on the first one"
    disk.mkdir()
    with monkeypatch.context() as patch:
        patch.setattr(second_copy.shutil, "disk_usage", lambda _: Usage(2 << 20, 1 << 20, 1 << 20))
        assert main(["copy", str(session), str(disk)]) == 3
    assert f"the disk of {disk} is full: protocol.toml needs" in capsys.readouterr().err
    assert main(["copy", str(session), str(disk)]) == 0
    assert verify(disk / session.name).whole


def test_a_disk_that_fails_midway_leaves_no_half_file(
    session: Path, disk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sync = second_copy.os.fsync

    def fail_for_parts(descriptor: int) -> None:
        if Path(f"/proc/self/fd/{descriptor}").resolve().suffix == ".h5":
            raise OSError(28, "No space left on device")
        sync(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(second_copy.os, "fsync", fail_for_parts)
        assert main(["copy", str(session), str(disk)]) == 3
    assert "takes no files (No space left on device): look at the second" in capsys.readouterr().err
    assert not list((disk / session.name).glob("*.h5"))
    assert main(["copy", str(session), str(disk)]) == 0
    assert DRAFTS not in names(disk / session.name)
    assert verify(disk / session.name).whole


def test_a_disk_that_stores_other_bytes_is_refused(
    session: Path, disk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write = second_copy._write

    def spoil(path: Path, draft: Path) -> bytes:
        digest = write(path, draft)
        with draft.open("r+b") as file:
            file.write(b"?")
        return digest

    monkeypatch.setattr(second_copy, "_write", spoil)
    assert main(["copy", str(session), str(disk)]) == 3
    assert "reads otherwise" in capsys.readouterr().err
    assert names(disk / session.name) <= {DRAFTS}


def test_a_file_that_differs_is_left_and_nothing_is_added_to_it(
    session: Path, disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = disk / session.name / "part-0001.h5"
    other.parent.mkdir()
    other.write_bytes(b"of another session")
    assert main(["copy", str(session), str(disk)]) == 2
    assert "differs from" in capsys.readouterr().err
    assert other.read_bytes() == b"of another session"
    assert names(other.parent) <= {"part-0001.h5", DRAFTS}


def test_a_part_that_recover_has_closed_takes_the_place_of_its_copy(
    session: Path, disk: Path
) -> None:
    """A killed writer's part: 48 bytes at its start say that it is open."""
    part = session / "part-0001.h5"
    head = bytearray(part.read_bytes())
    SessionCopy(session, disk).update()
    copy = disk / session.name / part.name
    head[:48] = head[:47] + bytes([head[47] ^ 1])
    copy.write_bytes(bytes(head))
    SessionCopy(session, disk).update()
    assert copy.read_bytes() == part.read_bytes()
    assert recover(disk / session.name).closed == ()


def test_rows_that_are_not_those_recorded_are_told(
    session: Path, disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = session / "part-0001.h5"
    with h5py.File(part, "r+") as file:
        spoil_one_sample(file)
    assert verify(session).problems
    assert main(["copy", str(session), str(disk)]) == 1
    assert "rows are not those that were recorded, copied as they are" in capsys.readouterr().err
    assert (disk / session.name / part.name).read_bytes() == part.read_bytes()


def test_the_sessions_own_folder_is_refused(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["copy", str(session), str(session.parent)]) == 2
    assert "holds the session itself" in capsys.readouterr().err


def test_a_folder_that_is_no_session_is_refused(
    tmp_path: Path, disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    for folder in ("empty", "absent"):
        assert main(["copy", str(tmp_path / folder), str(disk)]) == 2
        assert "is not a session" in capsys.readouterr().err


def test_another_process_that_copies_is_left_alone(session: Path, disk: Path) -> None:
    target = disk / session.name
    target.mkdir()
    copy = SessionCopy(session, disk)
    with second_copy._sole(target) as is_ours:
        assert is_ours
        copy.update()
        assert copy.copied == []
    copy.update()
    assert "part-0001.h5" in copy.copied
    shutil.rmtree(target)
