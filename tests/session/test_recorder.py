"""The recorder saves all its data, and its status counts only saved data."""

from __future__ import annotations

import errno
import shutil
import subprocess
import threading
from contextlib import closing
from itertools import product
from pathlib import Path

import h5py
import numpy as np
import pytest
from h5py import h5f

from rigctl.errors import DiskFault, SessionError
from rigctl.session import layout
from rigctl.session import recorder as recorder_module
from rigctl.session.part import PartReader
from rigctl.session.recorder import Recorder, read_history
from rigctl.session.session import Session
from rigctl.session.session_reader import MOST_OPEN
from rigctl.session.verify import verify
from rigctl.session.writer import CounterMap, SessionWriter
from rigctl.session.writer_lock import LOCK_FILE
from rigctl.values import Event, Gap, Verdict
from tests.session.building import (
    BLOCK,
    PROTOCOL,
    RIG,
    SyntheticRig,
    block,
    drum_state,
    header,
    plan,
    record_plan,
    recorder,
    trial_row,
    value_of,
)


def test_all_recorded_data_is_read_back(tmp_path: Path) -> None:
    planned = record_plan(tmp_path / "s")
    with Session.open(tmp_path / "s") as session:
        assert session.finished
        assert [p.attributes["texture"] for p in session.parts] == ["A", "B"]
        assert session.protocol_text == PROTOCOL
        assert session.config.about.operator == "Jörg"
        assert session.header == header()
        assert len(session.committed()) == len(planned.trials)
        for index, trial in enumerate(planned.trials):
            row = session.trial_row(index)
            assert row.trial == trial
            first = row.first_counter
            counters = np.arange(first, first + trial.n_samples)
            assert np.array_equal(session.samples(index), value_of(counters))
            assert session.window(index).complete


def test_status_counts_only_what_another_process_can_read(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        rec.add_block(block(0))
        rec.commit_trial(trial_row(plan().trials[0], -1, Verdict.ABORTED))
        rec.wait_written()
        status = rec.status
        assert status.samples_on_disk == BLOCK
        assert status.bytes_on_disk == (tmp_path / "s" / "part-0001.h5").stat().st_size
        assert status.disk_free_bytes > 0
        with Session.open(tmp_path / "s") as session:
            assert session.n_samples == BLOCK
            assert not session.finished


def test_a_reader_follows_the_growing_session_into_new_parts(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        rec.wait_written()
        with Session.open(tmp_path / "s") as session:
            bench = SyntheticRig(rec)
            for texture, trial in zip("AB", plan().trials, strict=False):
                if texture == "B":
                    rec.begin_part("plate change", texture)
                bench.trial(trial)
                rec.wait_written()
                session.refresh()
                assert len(session.trials) == trial.trial_id
                newest = trial.trial_id - 1
                assert len(session.samples(newest)) == trial.n_samples
            assert session.parts[0].finished
            assert not session.finished


def test_a_session_of_many_parts_is_read_with_few_of_them_open(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        bench, trials = SyntheticRig(rec), plan().trials
        for number in range(MOST_OPEN + len(trials)):
            rec.begin_part("the run goes on", "A")
            for trial in trials[number : number + 1]:
                bench.trial(trial)
            rec.wait_written()
    with Session.open(tmp_path / "s") as session:
        assert h5f.get_obj_count(types=h5f.OBJ_FILE) <= MOST_OPEN < len(session.parts)
        assert len(session.committed()) == len(trials)
        assert all(session.window(index).complete for index in session.committed())


def test_drum_load_cell_and_events_are_kept(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        for poll in range(20):
            rec.add_drum(drum_state(poll * 0.025, 2 * poll, 100_000), 250.0, 40.0)
        rec.add_event(Event(0.3, "fault", "Über die Kraft.", {"force_g": 1500, "wort": "Öl"}))
        rec.add_event(Event(0.4, "log", "x" * 500, {"long": "y" * 500}))
        rec.commit_trial(trial_row(plan().trials[0], 60, Verdict.REJECTED, 2))
    with Session.open(tmp_path / "s") as session:
        fault, long, session_end, end = session.events
        assert fault == Event(0.3, "fault", "Über die Kraft.", {"force_g": 1500, "wort": "Öl"})
        assert long.text.endswith("…")
        assert long.data["truncated"]
        assert session_end.kind == layout.SESSION_END_KIND
        assert session_end.data == {"outcome": "stopped", "committed": 0, "planned": 8}
        assert end.kind == layout.PART_END_KIND
        row = session.trial_row(0)
        assert row.reasons == ("2 samples lost", "force off")
        drum = session.drum(0)
        assert drum.polls["at_s"][0] >= row.started_s
        assert drum.polls["at_s"][-1] <= row.ended_s
        assert drum.polls["force_set_g"][0] == 250
        assert np.allclose(drum.polls_s, drum.polls["at_s"] - 0.1)
        assert np.all(np.diff(drum.loadcell["sequence"]) == 1)


def test_rows_between_two_times_are_found_in_tables_of_many_chunks(tmp_path: Path) -> None:
    times_s = np.repeat(np.arange(800) * 0.025, 2)[: layout.DRUM.chunk_rows * 3]
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        for number, at_s in enumerate(times_s):
            rec.add_drum(drum_state(at_s, 2 * number), 250.0, 40.0)
    edges = times_s[layout.DRUM.chunk_rows - 1 :: layout.DRUM.chunk_rows]
    ends = (-1.0, 0.0, 3.01, *edges, *(edges + 0.025), times_s[-1], 99.0)
    with Session.open(tmp_path / "s") as session:
        for first, last in product(ends, ends):
            found = session.parts[0].rows_between(layout.DRUM, "at_s", first, last)
            inside = (times_s >= first) & (times_s <= last)
            assert found["at_s"].tolist() == times_s[inside].tolist()


def test_lost_samples_stay_visible_in_a_trial(tmp_path: Path) -> None:
    trial = plan().trials[0]
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        rec.add_block(block(0, 100))
        rec.add_block(block(107, 400, gap=Gap(100, 7, "crc")))
        rec.commit_trial(trial_row(trial, 90))
        rec.commit_trial(trial_row(trial, 103))
    with Session.open(tmp_path / "s") as session:
        window = session.window(0)
        assert window.gaps == (Gap(100, 7, "missing"),)
        assert len(window.samples) == trial.n_samples - 7
        assert not window.complete
        assert window.counters.tolist() == [*range(90, 100), *range(107, 90 + trial.n_samples)]
        assert session.window(1).counters[0] == 107
        assert session.trials["first_sample"].tolist() == [90, 100]
        assert session.gaps[["first_counter", "count", "row"]].tolist() == [(100, 7, 100)]


def test_counter_map_agrees_with_a_search() -> None:
    counters = np.concatenate([np.arange(5, 9), np.arange(12, 20), np.arange(40, 42)])
    mapped = CounterMap()
    for rows in np.split(counters, [3, 4, 9]):
        given = block(0, len(rows))
        mapped.add(type(given)(rows, given.samples, given.flags, given.edges, (), 0.0))
    for counter in range(42):
        assert mapped.row_of(counter) == np.searchsorted(counters, counter)
    assert mapped.row_of(42) == mapped.row_of(-1) == -1


def test_a_taxel_board_that_restarts_begins_a_new_part(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        rec.add_block(block(500))
        rec.add_block(block(0))
    with Session.open(tmp_path / "s") as session:
        assert [p.attributes["reason"] for p in session.parts] == [
            "start",
            "the taxel board restarted",
        ]
        assert session.n_samples == 2 * BLOCK


def stall_disk(monkeypatch: pytest.MonkeyPatch) -> tuple[threading.Event, threading.Event]:
    """Make every flush wait; return the events that one began, and that the disk is back."""
    flush_began, disk_is_back = threading.Event(), threading.Event()
    flush = SessionWriter.flush

    def slow_flush(self: SessionWriter) -> None:
        flush_began.set()
        disk_is_back.wait()
        flush(self)

    monkeypatch.setattr(SessionWriter, "flush", slow_flush)
    return flush_began, disk_is_back


def test_a_loss_before_dropped_samples_is_part_of_their_gap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flush_began, disk_is_back = stall_disk(monkeypatch)
    with recorder(tmp_path / "s", queue_limit_samples=3 * BLOCK) as rec:
        rec.begin_part("start", "A")
        flush_began.wait()
        first = 0
        while rec.status.failure is None:
            rec.add_block(block(first, gap=Gap(first - 5, 5, "crc")))
            first += BLOCK + 5
        disk_is_back.set()
        rec.wait_written()
        rec.add_block(block(first, gap=Gap(first - 5, 5, "crc")))
    assert verify(tmp_path / "s").problems == []
    with Session.open(tmp_path / "s") as session:
        assert session.gaps["count"].tolist()[-2:] == [BLOCK + 5, 5]


def test_a_full_queue_drops_counts_and_reports_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flush_began, disk_is_back = stall_disk(monkeypatch)
    with recorder(tmp_path / "s", queue_limit_samples=3 * BLOCK) as rec:
        rec.begin_part("start", "A")
        flush_began.wait()
        first = 0
        while rec.status.failure is None:
            rec.add_block(block(first))
            first += BLOCK
        rec.add_block(block(first))
        assert "cannot keep up" in (rec.status.failure or "")
        disk_is_back.set()
    with Session.open(tmp_path / "s") as session:
        gaps = session.gaps
        assert gaps["count"].tolist() == [2 * BLOCK]
        assert gaps["reason"].tolist() == ["recorder queue full"]
        assert session.n_samples + 2 * BLOCK == first + BLOCK


def test_a_second_writer_is_refused_and_the_first_process_is_named(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        rec.wait_written()
        with pytest.raises(SessionError, match=r"is being written by process \d+: stop that run"):
            Recorder(tmp_path / "s", header(), PROTOCOL, RIG, resume=True)
    assert not (tmp_path / "s" / LOCK_FILE).exists()


def test_a_session_is_not_overwritten(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    before = (tmp_path / "s" / "part-0001.h5").read_bytes()
    with pytest.raises(SessionError, match=r"already holds a session: continue it with --resume"):
        recorder(tmp_path / "s")
    assert (tmp_path / "s" / "part-0001.h5").read_bytes() == before


def test_what_a_run_without_parts_left_is_not_taken_for_that_of_another_run(
    tmp_path: Path,
) -> None:
    """A run that is killed before its first part leaves its texts."""
    for name, text in ((layout.PROTOCOL_FILE, PROTOCOL), (layout.RIG_FILE, RIG)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    Recorder(tmp_path, header(), PROTOCOL, RIG).close()
    with pytest.raises(SessionError, match=r"rig.toml is there already and is not that of this"):
        Recorder(tmp_path, header(), PROTOCOL, RIG + "# other\n")
    assert not (tmp_path / LOCK_FILE).exists()


def test_resuming_needs_the_same_plan(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    other = header(plan())
    changed = type(other)(**{**_fields(other), "plan_hash": "f" * 32})
    with pytest.raises(SessionError, match="another protocol or seed"):
        Recorder(tmp_path / "s", changed, PROTOCOL, RIG, resume=True)
    with pytest.raises(SessionError, match="is not a session"):
        Recorder(tmp_path / "new", header(), PROTOCOL, RIG, resume=True)


def test_a_part_that_was_killed_before_its_first_digest_is_read_once_for_a_resume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, last = tmp_path / "s", layout.part_name(2)
    record_plan(folder)
    with h5py.File(folder / last, "r+") as file:
        file[layout.DIGESTS.path].resize(0, axis=0)
    known = read_history(folder)
    with closing(PartReader(folder / last)) as part:
        assert known.last_digest and not part.last_digest
    read: list[Path] = []
    monkeypatch.setattr(recorder_module, "open_session", read.append)
    Recorder(folder, header(), PROTOCOL, RIG, resume=True, known=known).close()
    assert not read


def test_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "s").write_text("")
    with pytest.raises(SessionError, match="is a file: give the path of a folder"):
        recorder(tmp_path / "s")


def test_a_folder_that_cannot_be_created_is_named() -> None:
    with pytest.raises(DiskFault, match=r"cannot (make|write into) /proc/rigctl"):
        recorder(Path("/proc/rigctl"))


def test_data_before_the_first_part_is_a_fault(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        rec.add_block(block(0))
        with pytest.raises(DiskFault, match="begin a part before recording data"):
            rec.wait_written()


def test_another_number_of_taxels(tmp_path: Path) -> None:
    given = block(0, 30)
    wide = type(given)(
        given.counters, value_of(given.counters, 5), given.flags, given.edges, (), 0.0
    )
    with Recorder(tmp_path / "s", header(n_taxels=5), PROTOCOL, RIG) as rec:
        rec.begin_part("start", "A")
        rec.add_block(wide)
        rec.commit_trial(trial_row(plan().trials[1], 0))
    with Session.open(tmp_path / "s") as session:
        assert session.samples(0).shape == (30, 5)


def test_an_unexpected_error_is_reported_as_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: object) -> None:
        raise OSError(errno.EIO, "I/O error")

    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        rec.wait_written()
        monkeypatch.setattr("os.fsync", broken)
        rec.add_block(block(0))
        with pytest.raises(DiskFault, match="the disk reports an error: check or replace it"):
            rec.wait_written()
        rec.add_block(block(10))
        assert rec.status.queue_samples == 0


def test_two_readers_in_one_process_do_not_disturb_each_other(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    with Session.open(tmp_path / "s") as first, Session.open(tmp_path / "s") as second:
        first.refresh()
        for index in range(len(first.trials)):
            assert np.array_equal(first.samples(index), second.samples(index))


def test_older_tools_read_a_finished_part(tmp_path: Path) -> None:
    """Debian's h5dump is HDF5 1.10; it is one of the packages that make test installs."""
    h5dump = shutil.which("h5dump")
    assert h5dump is not None, "install hdf5-tools"
    record_plan(tmp_path / "s")
    part = str(tmp_path / "s" / "part-0001.h5")
    out = subprocess.run([h5dump, part], capture_output=True, text=True, check=True).stdout
    for word in ("trials", '"committed', "plan_hash", "speed_mm_s [mm/s]", "operator"):
        assert word in out


def _fields(value: object) -> dict[str, object]:
    return {name: getattr(value, name) for name in type(value).__slots__}
