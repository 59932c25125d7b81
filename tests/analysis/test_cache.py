"""The cache: a second run computes nothing, and no stale or damaged entry is used."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.analysis.cache import Cache, Resources, cache_folder, cache_key
from rigctl.analysis.executors import local_executor
from rigctl.analysis.representations import RepresentationSet, represent
from rigctl.analysis.spike_counts import fingerprint, hash_array
from rigctl.analysis.trial_set import join_sessions
from rigctl.encoder.parameters import DEFAULT, PRESETS, EncoderParameters
from tests.analysis.recordings import record
from tests.session.forging import rewrite_digests

TEXTURES, SPEEDS = "AB", (40, 80, 120)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    folder = record(tmp_path / "session", TEXTURES, travel_mm=12.0, speeds=SPEEDS)
    settle(folder)
    return folder


def settle(folder: Path) -> None:
    """Make the files older: the cache does not trust the mtime of a file just written."""
    for part in folder.glob("part-*.h5"):
        os.utime(part, ns=(10**18, 10**18 + part.stat().st_mtime_ns % 10**9))


def analyse(
    session: Path, out: Path, cache: Cache, parameters: EncoderParameters = DEFAULT
) -> RepresentationSet:
    out.mkdir()
    return represent(join_sessions([session]), parameters, out, resources=Resources(cache=cache))


def assert_equal(one: RepresentationSet, two: RepresentationSet) -> None:
    assert one.files.keys() == two.files.keys()
    for key in one.files:
        assert one.files[key].read_bytes() == two.files[key].read_bytes()


def test_a_second_run_encodes_nothing(session: Path, tmp_path: Path) -> None:
    first, second = Cache(tmp_path / "cache"), Cache(tmp_path / "cache")
    fresh = analyse(session, tmp_path / "one", first)
    conditions = len(TEXTURES) * len(SPEEDS)
    # Ranges of counts and of conductances; each condition with C, with the mean C and divided.
    assert (first.hits, first.misses) == (0, 2 + 3 * conditions)
    again = analyse(session, tmp_path / "two", second)
    assert (second.hits, second.misses) == (2 + 3 * conditions, 0)
    assert_equal(fresh, again)
    assert_equal(fresh, analyse(session, tmp_path / "three", Cache()))
    assert fresh.force is not None and again.force is not None
    np.testing.assert_array_equal(fresh.force.evaluations, again.force.evaluations)


def test_other_parameters_and_samples_are_encoded_again(session: Path, tmp_path: Path) -> None:
    analyse(session, tmp_path / "one", Cache(tmp_path / "cache"))
    other = Cache(tmp_path / "cache")
    analyse(session, tmp_path / "two", other, PRESETS["explicit"])
    assert (other.hits, other.misses) == (2, 3 * len(TEXTURES) * len(SPEEDS))
    with h5py.File(session / "part-0001.h5", "r+") as part:
        first, samples = int(part["trials"][0]["first_sample"]), part["taxels/samples"]
        samples[first + 5 : first + 55] = np.sort(samples[first + 5 : first + 55], axis=0)
    rewrite_digests(session)
    settle(session)
    changed = Cache(tmp_path / "cache")
    fresh = analyse(session, tmp_path / "three", changed)
    # One file's two ranges, the trial's own condition with C and divided, and the mean of C over
    # textures at its speed.
    assert changed.misses == 2 + 2 + len(TEXTURES)
    assert_equal(fresh, analyse(session, tmp_path / "four", Cache()))


def test_a_damaged_entry_is_computed_and_replaced(session: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    fresh = analyse(session, tmp_path / "one", Cache(cache))
    entries = sorted(cache.glob("??/*.npz"))
    entries[0].write_bytes(b"")
    entries[1].write_bytes(entries[1].read_bytes()[:-1])
    damaged = bytearray(entries[2].read_bytes())
    damaged[damaged.index(b"\x93NUMPY") + 20] ^= 1  # a byte that the checksum covers
    entries[2].write_bytes(damaged)
    entries[3].write_bytes(b"something else entirely")
    again = Cache(cache)
    assert_equal(fresh, analyse(session, tmp_path / "two", again))
    assert again.misses == 4
    last = Cache(cache)
    assert_equal(fresh, analyse(session, tmp_path / "three", last))
    assert last.misses == 0


def test_results_before_an_interruption_stay_in_the_cache(session: Path, tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()

    def interrupt(stage: str, done: int, all_: int) -> None:
        if stage.startswith("searching") and done == 3:
            raise KeyboardInterrupt

    with local_executor(2) as executor, pytest.raises(KeyboardInterrupt):
        joined, cache = join_sessions([session]), Cache(tmp_path / "cache")
        resources = Resources(executor, cache, interrupt)
        represent(joined, DEFAULT, tmp_path / "one", resources=resources)
    resumed = Cache(tmp_path / "cache")
    fresh = analyse(session, tmp_path / "two", resumed)
    assert resumed.hits == 1 + 3
    assert_equal(fresh, analyse(session, tmp_path / "three", Cache()))


def test_a_file_that_was_just_written_is_read_again(session: Path, tmp_path: Path) -> None:
    analyse(session, tmp_path / "one", Cache(tmp_path / "cache"))
    (session / "part-0001.h5").touch()
    again = Cache(tmp_path / "cache")
    analyse(session, tmp_path / "two", again)
    assert again.misses == 2


def test_the_least_recently_used_entry_goes_first(tmp_path: Path) -> None:
    cache = Cache(tmp_path, max_bytes=4000)
    for number, name in enumerate(("aa", "bb", "cc")):
        cache.put(name, {"x": np.zeros(1000, np.uint8)})
        os.utime(tmp_path / name / f"{name}.npz", (number, number))
    assert cache.get("aa") is not None
    (tmp_path / "cc" / "left.new").write_bytes(b"by a killed process")
    os.utime(tmp_path / "cc" / "left.new", (0, 0))
    cache.trim()
    assert cache.get("bb") is None and not (tmp_path / "cc" / "left.new").exists()
    assert cache.get("aa") is not None and cache.get("cc") is not None


def test_an_unwritable_cache_does_not_end_the_analysis(session: Path, tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file, not a folder")
    cache = Cache(tmp_path / "cache")
    result = analyse(session, tmp_path / "one", cache)
    assert "cannot be written" in result.remarks[-1]
    cache.trim()


def test_keys_distinguish_parts_and_types() -> None:
    zero = np.zeros(2, np.uint8)
    keys = [
        cache_key("ab", "c"),
        cache_key("a", "bc"),
        cache_key(zero),
        cache_key(zero.view(np.int8)),
    ]
    assert len({*keys, cache_key(zero.reshape(1, 2)), cache_key()}) == 6


def test_the_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert cache_folder() == Path("/somewhere/rigctl")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path.home() / ".cache" / "rigctl"


@pytest.mark.parametrize(
    ("text", "expected"),
    [(b"", 0x2D06800538D394C2), (b"a", 0xE6C632B61E964E1F), (b"abc", 0x78AF5F94892F3950)],
)
def test_hashes_never_change(text: bytes, expected: int) -> None:
    """Files of spikes hold them."""
    assert hash_array(np.frombuffer(text, np.uint8)) == expected


@pytest.mark.parametrize("n_taxels", [1, 5, 18])
@pytest.mark.parametrize("n", [1, 2, 31, 33, 700])
def test_a_fingerprint_is_range_and_hash(n: int, n_taxels: int) -> None:
    samples = np.random.default_rng(n).integers(0, 1024, (n, n_taxels)).astype(np.uint16)
    block = np.zeros((4 + n, n_taxels), np.uint16)
    block[4:] = samples
    hashes, low, high = fingerprint(block, np.array([0, 4]), np.array([3, n]))
    assert hashes.tolist() == [hash_array(block[:3]), hash_array(samples)]
    assert low[0].max() == high[0].max() == 0
    np.testing.assert_array_equal(low[1], samples.min(axis=0))
    np.testing.assert_array_equal(high[1], samples.max(axis=0))
