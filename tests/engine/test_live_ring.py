"""Live data between processes: a reader gets complete rows, in order, the newest first of all."""

from __future__ import annotations

import errno
import multiprocessing
import multiprocessing.synchronize
import os
import resource
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rigctl.engine.live_file import LiveReader, LiveWriter
from rigctl.errors import DiskFault, RigFault

ROWS = 256


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[LiveWriter]:
    live = LiveWriter(tmp_path / "live.ring", 18, taxel_rows=ROWS, drum_rows=ROWS)
    yield live
    live.close()


@pytest.fixture
def reader(writer: LiveWriter) -> Iterator[LiveReader]:
    reader = LiveReader(writer.path)
    yield reader
    reader.close()


def add(writer: LiveWriter, first: int, n: int) -> None:
    counters = np.arange(first, first + n, dtype=np.int64)
    writer.add_taxels(
        time_s=counters / 1000.0,
        counters=counters,
        samples=np.repeat((counters % 1024).astype(np.uint16)[:, None], 18, axis=1),
        flags=(counters % 7).astype(np.uint8),
        spikes=np.repeat((counters % 3).astype(np.uint8)[:, None], 36, axis=1),
    )


def test_an_empty_ring_has_no_rows(reader: LiveReader) -> None:
    assert len(reader.taxels(100)) == 0
    assert len(reader.drum(100)) == 0
    assert reader.taxel_head == 0


def test_the_newest_rows_are_in_order_across_the_wrap(
    writer: LiveWriter, reader: LiveReader
) -> None:
    for first in range(0, 1000, 20):
        add(writer, first, 20)
    window = reader.taxels(200)
    assert window.counters.tolist() == list(range(800, 1000))
    assert window.first == 800
    assert np.array_equal(window.time_s, window.counters / 1000.0)
    assert np.array_equal(window.samples[:, 17], window.counters % 1024)
    assert np.array_equal(window.spikes[:, 35], window.counters % 3)
    assert reader.taxel_head == 1000


def test_a_window_larger_than_the_ring_gives_the_whole_ring(
    writer: LiveWriter, reader: LiveReader
) -> None:
    add(writer, 0, 100)
    assert len(reader.taxels(10_000)) == 100
    for first in range(100, 1000, 100):
        add(writer, first, 100)
    assert reader.taxels(10_000).counters.tolist() == list(range(1000 - ROWS, 1000))


def test_load_cell_samples_have_the_set_points_of_their_poll(
    writer: LiveWriter, reader: LiveReader
) -> None:
    writer.add_drum(
        np.array([1.0, 1.0125]),
        force_g=np.array([499.0, 501.0]),
        force_set_g=500.0,
        speed_mm_s=79.9,
        speed_set_mm_s=80.0,
        state=7,
    )
    window = reader.drum(10)
    assert window.force_g.tolist() == [499.0, 501.0]
    assert window.force_set_g.tolist() == [500.0, 500.0]
    assert window.speed_set_mm_s.tolist() == [80.0, 80.0]
    assert window.state.tolist() == [7, 7]


def test_the_encoders_range_can_be_read(writer: LiveWriter, reader: LiveReader) -> None:
    low, high = np.arange(18, dtype=np.uint16), np.arange(900, 918, dtype=np.uint16)
    writer.set_range(low, high)
    assert np.array_equal(reader.normalisation, (low, high))


def _write_fast(path: Path, rows: int, started: multiprocessing.synchronize.Event) -> None:
    live = LiveWriter(path, 18, taxel_rows=ROWS, drum_rows=ROWS)
    started.set()
    for first in range(0, rows, 50):
        add(live, first, 50)
    live.close()


def test_a_reader_in_another_process_never_sees_a_torn_row(tmp_path: Path) -> None:
    path = tmp_path / "live.ring"
    context = multiprocessing.get_context("spawn")
    started = context.Event()
    process = context.Process(target=_write_fast, args=(path, 400_000, started))
    process.start()
    assert started.wait(60)
    reader = LiveReader(path)
    last = 0
    while process.is_alive() and reader.taxel_head < 400_000:
        window = reader.taxels(ROWS)
        expected = np.arange(window.first, window.first + len(window))
        assert np.array_equal(window.counters, expected)
        assert np.array_equal(window.samples[:, 9], expected % 1024)
        assert np.array_equal(window.spikes[:, 0], expected % 3)
        assert window.first >= last
        last = window.first
    process.join()
    reader.close()
    assert process.exitcode == 0


def test_a_file_without_live_data_is_refused(tmp_path: Path) -> None:
    other_file = tmp_path / "notes.txt"
    other_file.write_text("not a ring" * 20)
    with pytest.raises(RigFault, match="no live data"):
        LiveReader(other_file)
    with pytest.raises(RigFault, match="check that the engine runs"):
        LiveReader(tmp_path / "absent")


def test_the_file_has_its_space_before_it_is_used(writer: LiveWriter) -> None:
    found = writer.path.stat()
    assert found.st_blocks * 512 >= found.st_size


def test_without_room_there_is_a_sentence_and_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int, offset: int, size: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(DiskFault, match=r"No space left on device\): make room there"):
        LiveWriter(tmp_path / "live.ring", 18)
    assert list(tmp_path.iterdir()) == []


def test_a_limit_of_the_process_is_a_sentence(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(DiskFault, match="cannot be created"):
            LiveWriter(tmp_path / "live.ring", 18)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("has_call", [True, False])
def test_without_a_call_for_space_zeros_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_call: bool
) -> None:
    def unsupported(descriptor: int, offset: int, size: int) -> None:
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    if has_call:
        monkeypatch.setattr(os, "posix_fallocate", unsupported)
    else:
        monkeypatch.delattr(os, "posix_fallocate")
    live = LiveWriter(tmp_path / "live.ring", 18)
    found = live.path.stat()
    assert found.st_blocks * 512 >= found.st_size
    add(live, 0, 10)
    live.close()


def test_a_name_that_is_taken_is_a_sentence(writer: LiveWriter) -> None:
    with pytest.raises(DiskFault, match="File exists"):
        LiveWriter(writer.path, 18)
    assert writer.path.exists()


@pytest.mark.parametrize("word", [2, 3])
@pytest.mark.parametrize("rows", [0, -1, ROWS // 2, 2 * ROWS, 1 << 40, 2**63 - 1, -(2**63)])
def test_wrong_rows_are_refused_before_anything_is_mapped(
    writer: LiveWriter, tmp_path: Path, word: int, rows: int
) -> None:
    copy = tmp_path / "copy"
    words = bytearray(writer.path.read_bytes())
    words[8 * word : 8 * word + 8] = np.int64(rows).tobytes()
    copy.write_bytes(words)
    with pytest.raises(RigFault, match="no live data of this version"):
        LiveReader(copy)


@pytest.mark.parametrize("size", [0, 8, 63, 64, 1024, 5000])
def test_a_file_cut_short_is_refused(writer: LiveWriter, tmp_path: Path, size: int) -> None:
    copy = tmp_path / "copy"
    copy.write_bytes(writer.path.read_bytes()[:size])
    with pytest.raises(RigFault, match="no live data of this version"):
        LiveReader(copy)
