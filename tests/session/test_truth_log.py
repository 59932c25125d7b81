"""The log of a simulated world: whole, cut by a kill at any moment, or damaged."""

from __future__ import annotations

import errno
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.errors import DiskFault, SessionError
from rigctl.session.ground_truth import begin_log, log_paths, open_truth
from rigctl.session.recorder import Recorder, check_same_world
from rigctl.session.summary import summarise_session
from rigctl.session.verify import verify
from rigctl.session.writer import PartWriter
from tests.session.building import PROTOCOL, RIG, header, record_plan
from tests.session.endless_truth import ROWS, rows_from

START = (header().start_utc, 0.0)


def killed_log(folder: Path, lines: int) -> int:
    """Kill a writer after it has printed some lines; return the rows that it reported on disk."""
    command = [sys.executable, "-m", "tests.session.endless_truth", str(folder), START[0]]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        for _, line in zip(range(lines), writer.stdout, strict=False):
            on_disk = int(line.removeprefix("rows "))
        writer.send_signal(signal.SIGKILL)
        rest = writer.stdout.read().split()
    return int(rest[-1]) if rest and rest[-1].isdigit() and rest[-1] != "rows" else on_disk


def write_log(folder: Path, n_rows: int = 9_000) -> Path:
    log = begin_log(folder, START, 0)
    for first in range(0, n_rows, 1_000):
        log.write(rows_from(first, 1_000))
    return log.close()


def assert_true(path: Path) -> int:
    """Check every row of a log; return their number."""
    with open_truth(path) as log:
        _, speed, force, sync = rows_from(0, log.n_rows)
        for name, values in (("speed_mm_s", speed), ("force_g", force), ("sync", sync)):
            assert np.array_equal(log.window(name, 0, log.n_rows), values)
        log.check()
        return log.n_rows


@pytest.mark.parametrize("lines", [1, 3, 12, 40])
def test_a_killed_writer_leaves_its_rows_and_the_session_can_be_whole_again(
    tmp_path: Path, lines: int
) -> None:
    folder = tmp_path / "s"
    record_plan(folder)
    on_disk = killed_log(folder, lines)
    partial = folder / "world.h5.partial"
    assert assert_true(partial) >= on_disk
    report = verify(folder)
    assert report.problems == []
    assert any("world.h5.partial: the log" in line and "killed" in line for line in report.notes)
    assert "world" in summarise_session(folder)
    later = replace(header(), start_utc="2026-11-22T08:00:00Z")
    with Recorder(folder, later, PROTOCOL, RIG, resume=True) as rec:
        rec.begin_part("resume", "A")
        log = begin_log(folder, (later.start_utc, 0.0), 500)
        log.write(rows_from(500))
        assert log.close() == folder / "world-0002.h5"
    assert verify(folder).problems == []
    assert [path.name for path in log_paths(folder)] == ["world.h5.partial", "world-0002.h5"]


def test_a_log_that_is_being_written_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    with Recorder(folder, header(), PROTOCOL, RIG) as rec:
        rec.begin_part("start", "A")
        rec.wait_written()
        log = begin_log(folder, START, 0)
        log.write(rows_from(0))
        assert assert_true(folder / "world.h5.partial") == ROWS
        log.write(rows_from(ROWS))
        assert assert_true(folder / "world.h5.partial") == 2 * ROWS
        assert assert_true(log.close()) == 2 * ROWS
    assert not (folder / "world.h5.partial").exists()


def test_a_whole_log_needs_no_tool_of_ours_and_replaces_an_older_one(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    path = write_log(tmp_path / "s")
    again = begin_log(tmp_path / "s", START, 0, again=True)
    again.write(rows_from(0, 20_000))
    assert assert_true(path) == 9_000
    assert again.close() == path
    with h5py.File(path) as file:
        assert file["speed_mm_s"].shape == (20_000,)
        assert file["speed_mm_s"].attrs["unit"] == b"mm/s"
    assert assert_true(path) == 20_000


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_a_log_cut_short_is_a_problem(tmp_path: Path, share: float) -> None:
    record_plan(tmp_path / "s")
    path = write_log(tmp_path / "s")
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    (problem,) = verify(tmp_path / "s").problems
    assert "world.h5" in problem


def test_a_partial_log_with_the_name_of_a_whole_one_is_a_problem(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    killed_log(tmp_path / "s", 5)
    (tmp_path / "s" / "world.h5.partial").rename(tmp_path / "s" / "world.h5")
    (problem,) = verify(tmp_path / "s").problems
    assert "its last rows are missing" in problem


def test_a_copy_of_a_log_is_not_that_of_another_sitting(tmp_path: Path) -> None:
    record_plan(tmp_path)
    path = write_log(tmp_path)
    shutil.copy(path, tmp_path / "world-0002.h5")
    (problem,) = verify(tmp_path).problems
    assert problem.startswith("world-0002.h5: is the log of sitting 1, it was copied or renamed")


def test_values_that_are_no_numbers_cost_that_log_only(tmp_path: Path) -> None:
    record_plan(tmp_path)
    path = write_log(tmp_path)
    with h5py.File(path, "r+") as file:
        file["/speed_mm_s"][:] = np.nan
    (problem,) = verify(tmp_path).problems
    assert problem.startswith(f"{path} is damaged: ")
    with open_truth(path) as log, pytest.raises(SessionError, match="speed_mm_s is no number"):
        log.window("speed_mm_s", 0, 10)


def test_a_full_disk_ends_the_log_with_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = begin_log(tmp_path, START, 0)
    log.write(rows_from(0))

    def fail(writer: PartWriter) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(PartWriter, "write", fail)
    with pytest.raises(DiskFault, match=r"partial could not be written \(No space left"):
        log.write(rows_from(ROWS))
    log.write(rows_from(2 * ROWS))
    assert log.close().name == "world.h5.partial"
    assert assert_true(tmp_path / "world.h5.partial") == ROWS


BEGUN = {"seed": 3, "world": {"start_mm": 251.0, "dead_taxels": [2]}, "world_file": "lab.toml"}


def test_the_same_world_from_another_file_is_the_same() -> None:
    again = {"world": {"start_mm": 251, "dead_taxels": (2,)}, "world_file": "copy.toml"}
    check_same_world(Path("s"), BEGUN, again)
    check_same_world(Path("s"), {}, {})


@pytest.mark.parametrize(
    ("world", "words"),
    [
        ({"start_mm": 100.0, "dead_taxels": []}, "start_mm is 251.0 there and 100.0 here"),
        ({"start_mm": 251.0, "dead_taxels": []}, r"dead_taxels is \[2\] there and \[\] here"),
        ({"start_mm": 251.0}, r"dead_taxels is \[2\] there and absent here"),
        ({**BEGUN["world"], "warp": 9}, "warp is absent there and 9 here"),
    ],
)
def test_the_first_parameter_that_differs_is_named(world: dict[str, object], words: str) -> None:
    with pytest.raises(SessionError, match=f"s was recorded in another world, {words}: "):
        check_same_world(Path("s"), BEGUN, {"world": world})


def test_a_session_without_a_world_is_not_resumed() -> None:
    with pytest.raises(SessionError, match="s does not say in which simulated world"):
        check_same_world(Path("s"), {"seed": 3}, BEGUN)
