"""A session without a part is awaited only where a recorder has prepared its folder."""

from __future__ import annotations

import os
import socket
import subprocess
from pathlib import Path

import pytest

from rigctl.acquisition.follow.awaited_session import (
    NOTHING_YET,
    AwaitedSession,
    follows_finger,
    is_awaited,
)
from rigctl.acquisition.follow.followed_drum import FollowedDrum
from rigctl.acquisition.follow.growing_session import GrowingSession
from rigctl.acquisition.follow.recorder_watch import RecorderWatch
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.errors import WrongUse
from rigctl.session.writer_lock import Writer, WriterLock, writer_of
from tests.acquisition.engine_harness import EngineHarness

DRUM = 'name = "d"\ntextures = ["A"]\nspeeds_mm_s = [40]\nforces_g = [500]\n'
FINGER = 'name = "f"\ntextures = ["A"]\nprofiles = ["medium"]\n'


@pytest.mark.parametrize(("protocol", "is_finger"), [(DRUM, False), (FINGER, True)])
def test_the_protocol_of_a_prepared_folder_names_the_experiment(
    tmp_path: Path, protocol: str, is_finger: bool
) -> None:
    (tmp_path / "protocol.toml").write_text(protocol)
    assert not is_awaited(tmp_path)
    with pytest.raises(WrongUse, match="is not a session"):
        follows_finger(tmp_path)
    (tmp_path / "writer.lock").write_text("1\n")
    assert is_awaited(tmp_path)
    assert follows_finger(tmp_path) is is_finger


def test_the_session_comes_with_its_first_part(harness: EngineHarness, tmp_path: Path) -> None:
    harness.record()
    folder, writer = tmp_path / "awaited", LiveWriter(tmp_path / "followed.live")
    folder.mkdir()
    for name in ("protocol.toml", "writer.lock"):
        (folder / name).write_text(DRUM)
    waiting = EngineStatus(state_words=NOTHING_YET)
    awaited = AwaitedSession(folder, lambda: FollowedDrum(GrowingSession(folder), writer), waiting)
    awaited.refresh()
    assert [event.text for events in awaited.take(0.0) for event in events] == [NOTHING_YET]
    awaited.refresh()
    assert list(awaited.take(0.0)) == [] and awaited.status(0.0) is waiting
    for part in sorted(harness.session.glob("part-*.h5")):
        (folder / part.name).write_bytes(part.read_bytes())
    awaited.refresh()
    assert any(awaited.take(0.0)) and awaited.newest_s > 0
    assert awaited.status(0.0).run.trials_committed == 4
    awaited.close()
    writer.close()


@pytest.fixture
def dead_pid() -> int:
    """Return the id of a process that has ended."""
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


def looked(folder: Path) -> RecorderWatch:
    """Return a watch after two looks, a second apart."""
    watch = RecorderWatch(folder)
    for now_s in (0.0, 0.5, 1.0):
        watch.look(now_s, has_ended=False)
    return watch


def test_a_recorder_that_was_killed_before_its_first_part_is_gone(
    tmp_path: Path, dead_pid: int
) -> None:
    lock = tmp_path / "writer.lock"
    lock.write_text(f"{dead_pid}\n{socket.gethostname()}\n")
    watch = looked(tmp_path)
    assert f"the recorder is gone: process {dead_pid} ended before the first plate" in watch.gone
    assert "start the run again, into the same folder" in watch.gone
    lock.write_text(f"{os.getpid()}\n{socket.gethostname()}\n")  # the id is another's by now
    assert writer_of(tmp_path) is Writer.GONE
    (tmp_path / "part-0001.h5").touch()
    assert f"put it in order with rigctl recover {tmp_path}" in looked(tmp_path).gone


def test_a_recorder_that_lives_or_begins_is_not_gone(tmp_path: Path, dead_pid: int) -> None:
    (tmp_path / "writer.lock").write_text(f"{dead_pid}\n{socket.gethostname()}\n")
    watch = looked(tmp_path)
    assert watch.gone
    lock = WriterLock(tmp_path)  # the run is started again
    assert writer_of(tmp_path) is Writer.LIVES
    watch.look(2.0, has_ended=False)
    assert not watch.gone and not watch.silent
    lock.release()
    watch.look(3.0, has_ended=False)
    watch.look(4.0, has_ended=True)
    assert not watch.gone and not watch.silent


@pytest.mark.parametrize("name", ["elsewhere\n", "localhost\n", "", "x" * 400])
def test_of_another_computer_the_age_of_the_lock_raises_a_doubt(
    tmp_path: Path, dead_pid: int, name: str
) -> None:
    """A network may not carry the locks of the operating system: nobody is called gone."""
    lock = tmp_path / "writer.lock"
    lock.write_text(f"{dead_pid}\n{name}")
    watch = looked(tmp_path)
    assert writer_of(tmp_path) is Writer.UNKNOWN and not watch.gone and not watch.silent
    os.utime(lock, (1_000_000, 1_000_000))
    watch = looked(tmp_path)
    assert not watch.gone and "since the run was prepared on " in watch.silent
    assert ("elsewhere" in watch.silent) is name.startswith("elsewhere")
