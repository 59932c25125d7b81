"""``rigctl verify`` notices every altered byte of a record, and says which rows and trials."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.errors import SessionError
from rigctl.session.digests import PartDamage, check_digests
from rigctl.session.hdf5_file import text_scalar
from rigctl.session.part import PartReader
from rigctl.session.verify import verify
from tests.session import building
from tests.session.block_session import record_in_blocks, spoil_one_sample
from tests.session.spoiling import Spoil, set_row

FLIPS = 100
FLIPS_BY_COMMAND = 10

Record = Callable[[Path], Any]


@pytest.fixture
def recorded(in_blocks: Path) -> Path:
    return in_blocks


def data_bytes(path: Path) -> list[range]:
    """Return the bytes of a file that hold rows, one range for each chunk."""
    found: list[range] = []

    def visit(_: str, node: object) -> None:
        if not isinstance(node, h5py.Dataset) or not node.chunks:
            return
        row_bytes = node.dtype.itemsize * int(np.prod(node.shape[1:]))
        chunks: list[Any] = []
        node.id.chunk_iter(chunks.append)
        for chunk in chunks:
            rows = min(node.chunks[0], node.shape[0] - chunk.chunk_offset[0])
            found.append(range(chunk.byte_offset, chunk.byte_offset + rows * row_bytes))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return found


def places(path: Path, count: int) -> Iterator[int]:
    """Yield bytes of a part's rows, the same number in each data set and each time."""
    rng = np.random.default_rng(7)
    ranges = data_bytes(path)
    for number in range(count):
        yield int(rng.choice(ranges[number % len(ranges)]))


def flip(path: Path, at: int, mask: int) -> None:
    with path.open("r+b") as file:
        file.seek(at)
        (value,) = file.read(1)
        file.seek(at)
        file.write(bytes([value ^ mask]))


@pytest.mark.parametrize("kind", ["in_blocks", "finger"])
def test_no_flipped_bit_of_the_rows_is_called_whole(
    kind: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    folder = Path(shutil.copytree(request.getfixturevalue(kind), tmp_path / "s"))
    assert verify(folder).problems == []
    path = folder / "part-0001.h5"
    for number, at in enumerate(places(path, FLIPS)):
        mask = 1 << number % 8
        flip(path, at, mask)
        if number < FLIPS_BY_COMMAND:
            assert not verify(folder).whole, f"bit {mask} of byte {at}"
        assert is_noticed(path), f"bit {mask} of byte {at}"
        flip(path, at, mask)
    assert verify(folder).problems == []


def is_noticed(path: Path) -> bool:
    try:
        part = PartReader(path)
    except SessionError:
        return True
    try:
        return check_digests(part) != PartDamage()
    except SessionError:
        return True
    finally:
        part.close()


@pytest.mark.parametrize("name", ["/taxels/samples", "/taxels/counter", "/drum", "/digests"])
def test_a_zeroed_page_is_noticed(session: Path, name: str) -> None:
    path = session / "part-0002.h5"
    with h5py.File(path, "r") as file:
        at = file[name].id.get_chunk_info(0).byte_offset
        size = min(4096, file[name].dtype.itemsize * file[name].size)
    with path.open("r+b") as file:
        file.seek(at)
        file.write(bytes(size))
    assert not verify(session).whole


def added_events(file: h5py.File) -> None:
    events = file["/events"]
    events.resize(len(events) + 1, axis=0)
    events[-1] = events[-2]


def removed_polls(file: h5py.File) -> None:
    file["/drum"].resize(len(file["/drum"]) - 1, axis=0)


def exchanged_blocks(file: h5py.File) -> None:
    rows = file["/drum"][:]
    file["/drum"][:] = rows[::-1]


def other_description(file: h5py.File) -> None:
    file.attrs.create("operator", text_scalar("Mallory"))


def other_object(file: h5py.File) -> None:
    file.create_group("more")


def other_protocol(file: h5py.File) -> None:
    text = bytes(file["/protocol_toml"][()]).replace(b"40", b"41")
    file["/protocol_toml"][()] = np.array(text, file["/protocol_toml"].dtype)


def removed_digest(file: h5py.File) -> None:
    rows = np.delete(file["/digests"][:], 4)
    file["/digests"].resize(len(rows), axis=0)
    file["/digests"][:] = rows


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (
            spoil_one_sample,
            "part-0002.h5: rows 406–811 of /taxels/samples are not those that were recorded: "
            "trial 6, attempt 1",
        ),
        (set_row("/taxels/arrivals", 3, arrived_s=3.2), "of /taxels/arrivals are not those that"),
        (set_row("/trials", 1, mean_force_g=249), "row 1 of /trials is not the one that was"),
        (set_row("/loadcell", 0, raw_counts=80_001), "rows 0–1 of /loadcell are not those that"),
        (added_events, "of /events were added, no digest covers them"),
        (removed_polls, "of /drum were removed or altered, the table is shorter"),
        (exchanged_blocks, "of /drum are not those that were recorded"),
        (other_description, "the part's attributes or texts are not those that were recorded"),
        (other_object, "the part's attributes or texts are not those that were recorded"),
        (other_protocol, "the part's attributes or texts are not those that were recorded"),
        (set_row("/digests", 5, digest=b"0" * 64), "not those that were recorded: trial 5"),
        (set_row("/digests", -1, digest=b"a" * 64), "of /events are not those that were recorded"),
        (set_row("/digests", 5, table=b"/other"), "of /digests were altered, removed or moved"),
        (set_row("/digests", 5, n_rows=0), "of /digests"),
        (removed_digest, "of /digests were altered, removed or moved"),
    ],
)
def test_what_was_altered_is_named(session: Path, spoil: Spoil, words: str) -> None:
    with h5py.File(session / "part-0002.h5", "r+") as file:
        spoil(file)
    problems = verify(session).problems
    assert any(words in line for line in problems), problems


def test_many_altered_rows_become_a_count(tmp_path: Path) -> None:
    with building.recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        for number in range(60):
            rec.add_block(building.block(10 * number))
            rec.wait_written()
    with h5py.File(tmp_path / "s" / "part-0001.h5", "r+") as file:
        for number in range(0, 60, 2):
            file["/taxels/samples"][10 * number, 0] ^= 1
    problems = verify(tmp_path / "s").problems
    assert len(problems) == 21
    assert problems[-1] == "part-0001.h5: and 10 more such blocks of rows of /taxels/samples"


def test_a_part_of_another_session_is_noticed(session: Path, tmp_path: Path) -> None:
    record_in_blocks(tmp_path / "other", first_value=5)
    shutil.copy(tmp_path / "other" / "part-0002.h5", session)
    problems = verify(session).problems
    assert any("part-0002.h5: does not follow part-0001.h5" in line for line in problems)


def test_a_first_part_recorded_again_is_noticed(session: Path, tmp_path: Path) -> None:
    record_in_blocks(tmp_path / "other", first_value=5)
    shutil.copy(tmp_path / "other" / "part-0001.h5", session)
    assert any("part-0002.h5: does not follow" in line for line in verify(session).problems)


def test_a_missing_last_part_is_a_problem(session: Path) -> None:
    (session / "part-0002.h5").unlink()
    report = verify(session)
    assert not report.whole
    assert any("part" in line and "missing" in line for line in report.problems)


def test_exchanged_parts_are_noticed(session: Path) -> None:
    (session / "part-0001.h5").rename(session / "x")
    (session / "part-0002.h5").rename(session / "part-0001.h5")
    (session / "x").rename(session / "part-0002.h5")
    assert not verify(session).whole
