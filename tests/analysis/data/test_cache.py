"""What was worked out is not worked out again, and nothing stale or broken is taken for it."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.analysis.data.cache import Cache, cache_folder, key_of
from rigctl.analysis.data.fingerprint import hash_of, look_at
from rigctl.analysis.data.trial_set import join_sessions
from rigctl.analysis.execution.executor import processes
from rigctl.analysis.features.representations import RepresentationSet, represent
from rigctl.encoding.parameters import DEFAULT, PRESETS, EncoderParameters
from tests.analysis.recordings import record

TEXTURES, SPEEDS = "AB", (40, 80, 120)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    folder = record(tmp_path / "session", TEXTURES, travel_mm=12.0, speeds=SPEEDS)
    settle(folder)
    return folder


def settle(folder: Path) -> None:
    """Files just written are not known by their time of change; make them older."""
    for part in folder.glob("part-*.h5"):
        os.utime(part, ns=(10**18, 10**18 + part.stat().st_mtime_ns % 10**9))


def made(
    session: Path, out: Path, cache: Cache, parameters: EncoderParameters = DEFAULT
) -> RepresentationSet:
    out.mkdir()
    return represent(join_sessions([session]), parameters, out, kept=cache)


def same(one: RepresentationSet, two: RepresentationSet) -> None:
    assert one.files.keys() == two.files.keys()
    for key in one.files:
        assert one.files[key].read_bytes() == two.files[key].read_bytes()


def test_a_second_run_encodes_nothing(session: Path, tmp_path: Path) -> None:
    first, second = Cache(tmp_path / "cache"), Cache(tmp_path / "cache")
    fresh = made(session, tmp_path / "one", first)
    conditions = len(TEXTURES) * len(SPEEDS)
    assert (first.found, first.missed) == (0, 1 + 2 * conditions)
    again = made(session, tmp_path / "two", second)
    assert (second.found, second.missed) == (1 + 2 * conditions, 0)
    same(fresh, again)
    same(fresh, made(session, tmp_path / "three", Cache()))
    assert fresh.force is not None and again.force is not None
    np.testing.assert_array_equal(fresh.force.evaluations, again.force.evaluations)


def test_other_numbers_and_other_bytes_are_encoded_anew(session: Path, tmp_path: Path) -> None:
    made(session, tmp_path / "one", Cache(tmp_path / "cache"))
    other = Cache(tmp_path / "cache")
    made(session, tmp_path / "two", other, PRESETS["explicit"])
    assert (other.found, other.missed) == (1, 2 * len(TEXTURES) * len(SPEEDS))
    with h5py.File(session / "part-0001.h5", "r+") as part:
        first, samples = int(part["trials"][0]["first_sample"]), part["taxels/samples"]
        samples[first + 5 : first + 55] = np.sort(samples[first + 5 : first + 55], axis=0)
    settle(session)
    changed = Cache(tmp_path / "cache")
    fresh = made(session, tmp_path / "three", changed)
    # One file's ranges, the trial's own condition, and the mean of C over textures at its speed.
    assert changed.missed == 1 + 1 + len(TEXTURES)
    same(fresh, made(session, tmp_path / "four", Cache()))


def test_a_broken_entry_is_worked_out_again(session: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    fresh = made(session, tmp_path / "one", Cache(cache))
    entries = sorted(cache.glob("??/*.entry"))
    entries[0].write_bytes(b"")
    entries[1].write_bytes(entries[1].read_bytes()[:-1])
    broken = bytearray(entries[2].read_bytes())
    broken[-1] ^= 1
    entries[2].write_bytes(broken)
    entries[3].write_bytes(b"something else entirely")
    again = Cache(cache)
    same(fresh, made(session, tmp_path / "two", again))
    assert again.missed == 4
    last = Cache(cache)
    same(fresh, made(session, tmp_path / "three", last))
    assert last.missed == 0


def test_what_was_done_before_an_interruption_is_kept(session: Path, tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()

    def interrupt(stage: str, done: int, all_: int) -> None:
        if stage.startswith("searching") and done == 3:
            raise KeyboardInterrupt

    with processes(2) as crew, pytest.raises(KeyboardInterrupt):
        joined, cache = join_sessions([session]), Cache(tmp_path / "cache")
        represent(joined, DEFAULT, tmp_path / "one", kept=cache, crew=crew, progress=interrupt)
    resumed = Cache(tmp_path / "cache")
    fresh = made(session, tmp_path / "two", resumed)
    assert resumed.found == 1 + 3
    same(fresh, made(session, tmp_path / "three", Cache()))


def test_a_file_that_was_just_written_is_read_again(session: Path, tmp_path: Path) -> None:
    made(session, tmp_path / "one", Cache(tmp_path / "cache"))
    (session / "part-0001.h5").touch()
    again = Cache(tmp_path / "cache")
    made(session, tmp_path / "two", again)
    assert again.missed == 1


def test_the_longest_unused_goes_first(tmp_path: Path) -> None:
    cache = Cache(tmp_path, most_bytes=3000)
    for number, name in enumerate(("aa", "bb", "cc")):
        cache.put(name, {"x": np.zeros(1000, np.uint8)})
        os.utime(tmp_path / name / f"{name}.entry", (number, number))
    assert cache.get("aa") is not None
    (tmp_path / "cc" / "left.new").write_bytes(b"by a killed process")
    os.utime(tmp_path / "cc" / "left.new", (0, 0))
    cache.trim()
    assert cache.get("bb") is None and not (tmp_path / "cc" / "left.new").exists()
    assert cache.get("aa") is not None and cache.get("cc") is not None


def test_a_cache_that_cannot_be_written_ends_nothing(session: Path, tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file, not a folder")
    cache = Cache(tmp_path / "cache")
    result = made(session, tmp_path / "one", cache)
    assert "nothing more was kept" in result.remarks[-1]
    cache.trim()


def test_keys_tell_parts_and_types_apart() -> None:
    zero = np.zeros(2, np.uint8)
    keys = [key_of("ab", "c"), key_of("a", "bc"), key_of(zero), key_of(zero.view(np.int8))]
    assert len({*keys, key_of(zero.reshape(1, 2)), key_of()}) == 6


def test_the_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert cache_folder() == Path("/somewhere/rigctl")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path.home() / ".cache" / "rigctl"


@pytest.mark.parametrize(
    ("text", "expected"),
    [(b"", 0x2D06800538D394C2), (b"a", 0xE6C632B61E964E1F), (b"abc", 0x78AF5F94892F3950)],
)
def test_contents_have_the_same_name_for_good(text: bytes, expected: int) -> None:
    """The names stand in files of spikes."""
    assert hash_of(np.frombuffer(text, np.uint8)) == expected


@pytest.mark.parametrize("n_taxels", [1, 5, 18])
@pytest.mark.parametrize("n", [1, 2, 31, 33, 700])
def test_a_look_gives_range_and_hash(n: int, n_taxels: int) -> None:
    samples = np.random.default_rng(n).integers(0, 1024, (n, n_taxels)).astype(np.uint16)
    memory = np.zeros((4 + n, n_taxels), np.uint16)
    memory[4:] = samples
    hashes, low, high = look_at(memory, np.array([0, 4]), np.array([3, n]))
    assert hashes.tolist() == [hash_of(memory[:3]), hash_of(samples)]
    assert low[0].max() == high[0].max() == 0
    np.testing.assert_array_equal(low[1], samples.min(axis=0))
    np.testing.assert_array_equal(high[1], samples.max(axis=0))
