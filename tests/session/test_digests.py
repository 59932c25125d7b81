"""The chain of digests, recomputed from the files by h5py and hashlib alone."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.errors import DiskFault
from rigctl.session.digests import FIRST_DIGEST, describe_part
from rigctl.session.layout import DIGESTS, SessionOutcome
from rigctl.session.recorder import Recorder
from rigctl.session.session import Session
from rigctl.session.session_reader import read_closing_digest
from tests.finger import finger_building
from tests.session import building
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan


def rebuild(path: Path, previous: str) -> Iterator[tuple[str, str]]:
    """Yield each stored digest of a part beside the one that its rows give."""
    with h5py.File(path, "r") as file:
        ends: dict[str, int] = {}
        for row in file["digests"][:]:
            table, first, count = row["table"].decode(), int(row["first_row"]), int(row["n_rows"])
            rows = describe_part(file) if table == "/" else file[table][first : first + count]
            data = rows if isinstance(rows, bytes) else rows.tobytes()
            place = f"{table}\n{first}\n{count}\n".encode()
            previous = hashlib.sha256(previous.encode() + place + data).hexdigest()
            yield row["digest"].decode(), previous
            assert first == ends.get(table, 0)
            ends[table] = first + count
        ends.pop("/")
        lengths = {
            f"/{name}": len(file[name]) for name in _growing(file) if f"/{name}" != DIGESTS.path
        }
        assert ends == {path: n for path, n in lengths.items() if n}


def _growing(file: h5py.File) -> list[str]:
    names: list[str] = []
    file.visititems(
        lambda name, node: (
            names.append(name) if isinstance(node, h5py.Dataset) and node.chunks else None
        )
    )
    return names


@pytest.mark.parametrize("record", [building.record_plan, finger_building.record_plan])
def test_every_row_is_covered_once_and_parts_are_linked(tmp_path: Path, record: object) -> None:
    folder = tmp_path / "s"
    assert callable(record)
    record(folder)
    previous = FIRST_DIGEST
    for path in sorted(folder.glob("part-*.h5")):
        with h5py.File(path, "r") as file:
            assert file.attrs["previous_digest"].decode() == previous
        for stored, computed in rebuild(path, previous):
            assert stored == computed
            previous = stored
    assert read_closing_digest(folder) == previous


def test_a_resumed_session_continues_the_chain(tmp_path: Path) -> None:
    trials = plan().trials
    for sitting, trial in enumerate(trials[:2]):
        with Recorder(tmp_path, header(), PROTOCOL, RIG, resume=sitting > 0) as rec:
            rec.begin_part("start", trial.texture)
            SyntheticRig(rec, 10_000 * sitting).trial(trial)
        assert rec.closing_digest == read_closing_digest(tmp_path)
    with h5py.File(tmp_path / "part-0001.h5", "r") as file:
        last = file["digests"][-1]["digest"]
    with h5py.File(tmp_path / "part-0002.h5", "r") as file:
        assert file.attrs["previous_digest"] == last


@pytest.mark.parametrize(
    ("outcome", "said"),
    [(None, "stopped"), (SessionOutcome.FAILED, "failed"), (SessionOutcome.FINISHED, "finished")],
)
def test_the_last_part_says_how_the_session_ended(
    tmp_path: Path, outcome: SessionOutcome | None, said: str
) -> None:
    rec = building.recorder(tmp_path)
    rec.begin_part("start", "A")
    SyntheticRig(rec).trial(plan().trials[0])
    rec.begin_part("plate change", "B")
    rec.close(outcome)
    with Session.open(tmp_path) as session:
        (event,) = session.events_of("session_end")
        assert event.data == {"outcome": said, "committed": 1, "planned": 8}
        assert [part.finished for part in session.parts] == [True, True]


def test_a_failure_in_the_with_block_is_a_failed_session(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), building.recorder(tmp_path) as rec:
        rec.begin_part("start", "A")
        _ = 1 // 0
    with Session.open(tmp_path) as session:
        assert session.events_of("session_end")[0].data["outcome"] == "failed"


def test_one_changed_sample_changes_the_closing_digest(tmp_path: Path) -> None:
    """A negative control: without the samples in the chain, both digests would be equal."""
    digests = set()
    for name, change in (("a", 0), ("b", 1)):
        with building.recorder(tmp_path / name) as rec:
            rec.begin_part("start", "A")
            samples = building.block(0)
            samples.samples[3, 7] ^= np.uint16(change)
            rec.add_block(samples)
        digests.add(rec.closing_digest)
    assert len(digests) == 2


@pytest.mark.parametrize("replaced", [False, True])
def test_a_part_that_loses_its_name_stops_the_recording(tmp_path: Path, replaced: bool) -> None:
    rec = building.recorder(tmp_path)
    rec.begin_part("start", "A")
    source = SyntheticRig(rec)
    source.trial(plan().trials[0])
    rec.wait_written()
    path = tmp_path / "part-0001.h5"
    path.unlink()
    if replaced:
        path.write_bytes(b"another file")
    source.trial(plan().trials[1])
    with pytest.raises(DiskFault, match=r"part-0001\.h5 was removed, renamed or replaced"):
        rec.wait_written()
    rec.close()
    saved = tmp_path / ("part-0001.saved" if replaced else "part-0001.h5")
    assert str(saved) in str(rec.failure)
    saved.rename(path)
    with Session.open(tmp_path) as session:
        assert len(session.committed()) == 2
