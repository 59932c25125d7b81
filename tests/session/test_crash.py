"""A killed writer leaves readable parts and every row that it reported as saved."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigctl.session.recorder import Recorder
from rigctl.session.session import Session
from rigctl.session.writer_lock import LOCK_FILE, lock_owner_pid
from tests.session.building import PROTOCOL, RIG, header, value_of


def endless_writer(folder: Path, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "tests.session.endless_writer", str(folder), *options]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def acknowledged(writer: subprocess.Popen[str], lines: int) -> int:
    """Read some lines; return the last number of trials that the writer reported on disk."""
    assert writer.stdout is not None
    on_disk = 0
    for _, line in zip(range(lines), writer.stdout, strict=False):
        on_disk = int(line.removeprefix("trials "))
    return on_disk


def check_every_trial(folder: Path) -> int:
    """Check that each row of each part points at its own samples; return the number of rows."""
    with Session.open(folder) as session:
        for index in range(len(session.trials)):
            window = session.window(index)
            assert window.complete
            assert np.array_equal(window.samples, value_of(window.counters))
        return len(session.trials)


def test_two_readers_in_one_process_follow_a_growing_part(tmp_path: Path) -> None:
    """Each reader keeps its own rows when the other opens or refreshes the same file."""
    with endless_writer(tmp_path / "s") as writer:
        acknowledged(writer, 25)
        with Session.open(tmp_path / "s") as first, Session.open(tmp_path / "s") as second:
            for _ in range(2):
                for session in (first, second):
                    for index in range(len(session.trials)):
                        window = session.window(index)
                        assert window.complete
                        assert window.counters[0] == session.trials["first_counter"][index]
                        assert np.array_equal(window.samples, value_of(window.counters))
                first.refresh()
        writer.kill()


@pytest.mark.parametrize("lines", [1, 4, 25])
def test_a_killed_writer_leaves_all_committed_rows(tmp_path: Path, lines: int) -> None:
    writer = endless_writer(tmp_path / "s")
    on_disk = acknowledged(writer, lines)
    writer.send_signal(signal.SIGKILL)
    rest = writer.communicate()[0].split()
    if rest and rest[-1].isdigit():
        on_disk = int(rest[-1])
    assert on_disk > 0
    assert check_every_trial(tmp_path / "s") >= on_disk


def test_a_killed_session_is_resumed_in_a_new_part(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    for sitting in range(3):
        with endless_writer(folder, *["resume"][: bool(sitting)]) as writer:
            acknowledged(writer, 2)
            writer.send_signal(signal.SIGKILL)
            assert writer.stdout is not None
            writer.stdout.read()
    assert lock_owner_pid(folder) == writer.pid
    with Recorder(folder, header(), PROTOCOL, RIG, resume=True) as rec:
        rec.begin_part("resume", "A")
    with Session.open(folder) as session:
        assert [part.number for part in session.parts] == [1, 2, 3, 4]
        assert [part.finished for part in session.parts] == [False, False, False, True]
    check_every_trial(folder)


def test_a_second_process_cannot_write_the_same_session(tmp_path: Path) -> None:
    with endless_writer(tmp_path / "s") as first:
        acknowledged(first, 1)
        with endless_writer(tmp_path / "s", "resume") as second:
            out, _ = second.communicate()
        first.kill()
        assert first.stdout is not None
        first.stdout.read()
    assert f"is being written by process {first.pid}" in out
    assert second.returncode == 2
    check_every_trial(tmp_path / "s")


@pytest.mark.parametrize("limit", [4_000, 60_000, 300_000, 1_000_003])
def test_a_full_disk_raises_one_sentence_and_keeps_committed_trials(
    tmp_path: Path, limit: int
) -> None:
    """A limit on the file's size simulates the disk: HDF5 sees the same failing write."""
    with endless_writer(tmp_path / "s", f"limit={limit}") as writer:
        out, _ = writer.communicate()
    *reports, last = out.splitlines()
    assert "the file may not grow further (file size limit)" in last
    assert writer.returncode == 3
    assert not (tmp_path / "s" / LOCK_FILE).exists()
    if reports:
        assert check_every_trial(tmp_path / "s") >= int(reports[-1].removeprefix("trials "))
