"""A killed recording of the finger is readable, holds every saved scan, and is resumed."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rigctl.errors import SessionError
from rigctl.finger.session import FingerSession
from rigctl.session.verify import verify
from rigctl.values import Verdict
from tests.finger.finger_building import VELOCITIES_UM_S, SyntheticFinger, plan, recorder


def killed_writer(folder: Path, lines: int, *options: str) -> int:
    """Kill a writer after it reported some trials; return the last number that it reported."""
    command = [sys.executable, "-m", "tests.finger.endless_writer", str(folder), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        for _ in zip(range(lines), writer.stdout, strict=False):
            pass
        with pytest.raises(SessionError, match=f"is being written by process {writer.pid}"):
            recorder(folder, resume=True)
        writer.send_signal(signal.SIGKILL)
        rest = writer.stdout.read().splitlines()
    return int(rest[-1].split()[1]) if rest and len(rest[-1].split()) == 2 else lines


@pytest.mark.parametrize("lines", [1, 6])
def test_a_killed_recording_keeps_its_scans_and_is_resumed(tmp_path: Path, lines: int) -> None:
    folder = tmp_path / "s"
    on_disk = killed_writer(folder, lines)
    with FingerSession.open(folder) as session:
        assert len(session.trials) >= on_disk
        assert not session.finished
    (problem,) = verify(folder).problems
    assert problem.startswith("part-0001.h5: was not closed properly, its writer was killed")

    killed_writer(folder, 1, "resume")
    with recorder(folder, resume=True) as rec, SyntheticFinger(rec) as finger:
        rec.begin_part("resume")
        finger.trial(plan().trials[-1], Verdict.REJECTED)
    with FingerSession.open(folder) as session:
        assert [part.finished for part in session.parts] == [False, False, True]
        for index in range(len(session.trials)):
            assert len(session.spikes(index)) == session.trials["count"][index]
            assert len(session.batches(index)) == len(VELOCITIES_UM_S)
    report = verify(folder)
    assert report.whole
    assert report.trials_committed >= min(on_disk, len(plan().trials))
