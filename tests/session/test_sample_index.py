"""Samples that are read directly from the files equal those that HDF5 reads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.session.layout import LIBVER
from rigctl.session.part import PartReader
from rigctl.session.sample_index import SampleReader
from rigctl.session.session import Session
from rigctl.values import Gap
from tests.session.building import SyntheticRig, block, plan, record_plan, recorder, trial_row

CHUNKS_APART = 9_000
"""Idle samples between trials that put them into chunks of their own."""


def recorded(folder: Path) -> Path:
    """Two trials far apart, one of which lacks samples; the second begins a new part."""
    trials = plan().trials
    with recorder(folder) as rec:
        rec.begin_part("start", "A")
        bench = SyntheticRig(rec)
        bench.idle(CHUNKS_APART)
        bench.trial(trials[0])
        first = bench.counter + 60
        rec.add_block(block(bench.counter, 100))
        rec.add_block(block(bench.counter + 107, 500, gap=Gap(bench.counter + 100, 7, "here")))
        bench.counter += 607
        rec.commit_trial(trial_row(trials[1], first))
        rec.begin_part("plate change", "A")
        bench.idle(4096 - 60)
        bench.trial(trials[2])
    return folder


def check(folder: Path, *, plain: bool) -> list[bool]:
    """Check that both readers return the same samples; return which trials are complete."""
    with Session.open(folder) as session:
        files = session.sample_files()
        assert all((file.offsets is not None) is plain for file in files)
        rows = session.committed().tolist()
        ranges = session.sample_ranges(rows)
        with SampleReader(files) as reader:
            for row, located in zip(rows, ranges, strict=True):
                window = session.window(row)
                np.testing.assert_array_equal(reader.read(located), window.samples)
                assert located.complete is window.complete
    return [located.complete for located in ranges]


def test_samples_equal_those_read_by_hdf5(tmp_path: Path) -> None:
    assert check(recorded(tmp_path / "session"), plain=True) == [True, False, True]


def test_many_single_counters_are_looked_up(tmp_path: Path) -> None:
    record_plan(tmp_path / "session")
    with Session.open(tmp_path / "session") as session:
        rows = session.committed().tolist() * 5
        assert all(located.complete for located in session.sample_ranges(rows))


def test_a_part_that_grows_or_is_compressed_is_left_to_hdf5(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = recorded(tmp_path / "session")
    with monkeypatch.context() as patched:
        patched.setattr(PartReader, "is_growing", True)
        assert check(folder, plain=False) == [True, False, True]
    for part in folder.glob("part-*.h5"):
        small = part.with_name("small")
        with h5py.File(part) as source, h5py.File(small, "w", libver=LIBVER) as target:
            target.attrs.update(source.attrs)
            for name in (
                "drum",
                "loadcell",
                "trials",
                "events",
                "gaps",
                "digests",
                "protocol_toml",
            ):
                source.copy(name, target)
            source.copy("rig_toml", target)
            for name, node in source["taxels"].items():
                packed = {} if name == "arrivals" else {"compression": "gzip"}
                target.create_dataset(f"taxels/{name}", data=node[...], chunks=True, **packed)
        small.replace(part)
    assert check(folder, plain=False) == [True, False, True]


def test_a_file_truncated_after_indexing_is_an_error(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "session")
    with Session.open(folder) as session:
        files, ranges = session.sample_files(), session.sample_ranges(session.committed().tolist())
    assert files[0].offsets is not None
    with files[0].path.open("r+b") as file:
        file.truncate(int(files[0].offsets[0]) + 1)
    with SampleReader(files) as reader, pytest.raises(OSError, match="ends before"):
        reader.read(ranges[0])


@pytest.mark.parametrize("last", [False, True])
def test_short_gaps_are_read_as_the_sample_before_them(tmp_path: Path, last: bool) -> None:
    trial = plan().trials[0]
    lost = {70, 71, 72, 90} | ({60 + trial.n_samples - 1} if last else set())
    kept = np.array([row for row in range(60 + trial.n_samples + 100) if row not in lost])
    with recorder(tmp_path / "session") as rec:
        rec.begin_part("start", "A")
        whole = block(1000, 60 + trial.n_samples + 100)
        rec.add_block(
            replace(
                whole,
                **{name: getattr(whole, name)[kept] for name in ("counters", "samples", "flags")},
                edges=whole.edges[kept],
            )
        )
        rec.commit_trial(trial_row(trial, 1060))
    with (
        Session.open(tmp_path / "session") as session,
        SampleReader(session.sample_files()) as reader,
    ):
        (located,) = session.sample_ranges(session.committed().tolist())
        rows = np.arange(60, 60 + trial.n_samples)
        held = whole.samples[kept[np.searchsorted(kept, rows, side="right") - 1]]
        assert located.complete and located.n_samples == trial.n_samples
        np.testing.assert_array_equal(reader.read(located), held)
        assert len(session.window(0).gaps) == 2 + last
