"""``rigctl verify`` notices every altered byte of a record, and says which rows and trials."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.cli import main
from rigctl.errors import SessionError
from rigctl.session.chain.links import check_links
from rigctl.session.format.annotated_arrays import text_scalar
from rigctl.session.format.data_sets import DIGESTS
from rigctl.session.format.layout import SessionOutcome
from rigctl.session.read.part import PartReader
from rigctl.session.verify.session import verify
from rigctl.session.write.recorder import Recorder
from tests.session import building, finger_building
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan
from tests.session.forging import rewrite_digests

FLIPS = 300
FLIPS_BY_COMMAND = 15

Record = Callable[[Path], Any]


@pytest.fixture(scope="module")
def drum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of two parts with several blocks of rows in each table."""
    folder = tmp_path_factory.mktemp("drum") / "s"
    record_in_blocks(folder)
    return folder


@pytest.fixture(scope="module")
def finger(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finger") / "s"
    finger_building.record_plan(folder)
    return folder


@pytest.fixture
def session(drum: Path, tmp_path: Path) -> Path:
    """A copy of the drum's session to damage."""
    return Path(shutil.copytree(drum, tmp_path / "s"))


def record_in_blocks(folder: Path, first_value: int = 0) -> str:
    """Record the plan with a flush after each trial; return the closing digest."""
    with building.recorder(folder) as rec:
        source = SyntheticRig(rec, first_value)
        texture = ""
        for trial in plan().trials:
            if trial.texture != texture:
                texture = trial.texture
                rec.begin_part("plate change", texture)
            source.trial(trial)
            rec.wait_written()
    return rec.closing_digest


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


@pytest.mark.parametrize("kind", ["drum", "finger"])
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
        links = check_links(part)
    except SessionError:
        return True
    finally:
        part.close()
    coverage = links.coverage
    return any((links.damaged, links.altered, coverage.misplaced, coverage.gone))


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


def change(path: str, row: int, **values: object) -> Callable[[h5py.File], None]:
    def spoil(file: h5py.File) -> None:
        changed = file[path][row]
        for name, value in values.items():
            changed[name] = value
        file[path][row] = changed

    return spoil


def one_sample(file: h5py.File) -> None:
    file["/taxels/samples"][500, 3] ^= 1


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
            one_sample,
            "part-0002.h5: rows 406–811 of /taxels/samples are not those that were recorded: "
            "trial 6, attempt 1",
        ),
        (change("/taxels/arrivals", 3, arrived_s=3.2), "of /taxels/arrivals are not those that"),
        (change("/trials", 1, mean_force_g=249), "row 1 of /trials is not the one that was"),
        (change("/loadcell", 0, raw_counts=80_001), "rows 0–1 of /loadcell are not those that"),
        (added_events, "of /events were added, no digest covers them"),
        (removed_polls, "of /drum were removed or altered, the table is shorter"),
        (exchanged_blocks, "of /drum are not those that were recorded"),
        (other_description, "the part's attributes or texts are not those that were recorded"),
        (other_protocol, "the part's attributes or texts are not those that were recorded"),
        (
            change("/digests", 5, digest=b"0" * 64),
            "row 5 of /digests was altered, the rows that they cover are those that were",
        ),
        (change("/digests", -1, digest=b"a" * 64), "of /digests was altered, the rows that they"),
        (change("/digests", 5, table=b"/other"), "of /digests were altered, removed or moved"),
        (change("/digests", 5, n_rows=2), "of /digests"),
        (removed_digest, "of /digests were altered, removed or moved"),
    ],
)
def test_what_was_altered_is_named(
    session: Path, spoil: Callable[[h5py.File], None], words: str
) -> None:
    with h5py.File(session / "part-0002.h5", "r+") as file:
        spoil(file)
    problems = verify(session).problems
    assert any(words in line for line in problems), problems


def test_an_altered_digest_does_not_accuse_the_rows(session: Path) -> None:
    with h5py.File(session / "part-0001.h5", "r+") as file:
        change("/digests", 7, digest=b"f" * 64)(file)
    assert [line for line in verify(session).problems if "not those that were" in line] == []


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
    assert any("digests.txt: part-0002.h5 was closed with another digest" in p for p in problems)


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


def test_only_the_kept_digest_shows_a_chain_that_was_written_anew(session: Path) -> None:
    kept = verify(session).closing_digest
    assert verify(session, digest=kept).whole
    with h5py.File(session / "part-0001.h5", "r+") as file:
        one_sample(file)
    forged = rewrite_digests(session)
    assert verify(session).problems == []
    assert verify(session, digest=forged).whole
    (problem,) = verify(session, digest=kept).problems
    assert problem.startswith(f"the closing digest is {forged}, not {kept}")


def test_the_digest_of_an_earlier_closing_proves_what_it_closed(tmp_path: Path) -> None:
    digests = []
    for sitting, trial in enumerate(plan().trials[:2]):
        with Recorder(tmp_path, header(), PROTOCOL, RIG, resume=sitting > 0) as rec:
            rec.begin_part("start", trial.texture)
            SyntheticRig(rec, 10_000 * sitting).trial(trial)
        digests.append(rec.closing_digest)
    report = verify(tmp_path, digest=digests[0])
    assert report.whole
    assert any("that of part-0001.h5: the session is proved up to there" in n for n in report.notes)
    assert verify(tmp_path, digest=digests[1]).whole
    assert report.closing_digest == digests[1]


@pytest.mark.parametrize("outcome", list(SessionOutcome))
def test_how_a_session_ended_is_told(tmp_path: Path, outcome: SessionOutcome) -> None:
    rec = building.recorder(tmp_path)
    rec.begin_part("start", "A")
    SyntheticRig(rec).trial(plan().trials[0])
    rec.close(outcome)
    report = verify(tmp_path)
    assert (report.whole, report.outcome) == (True, outcome.value)


def test_a_session_that_was_cut_short_is_told_from_a_stopped_one(session: Path) -> None:
    with h5py.File(session / "part-0002.h5", "r+") as file:
        file["/events"].resize(len(file["/events"]) - 1, axis=0)
    report = verify(session)
    assert (report.whole, report.outcome, report.closing_digest) == (False, "cut short", "")


def replace_word(line: int, old: str, new: str) -> Callable[[list[str]], None]:
    def spoil(lines: list[str]) -> None:
        assert old in lines[line]
        lines[line] = lines[line].replace(old, new)

    return spoil


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (replace_word(0, "opened", "0pened"), "line 1 is not one that a recording wrote"),
        (replace_word(0, "00000000", "00000001"), "part-0001.h5 began with another digest"),
        (replace_word(3, "finished 8/8", "stopped 7/8"), "was closed as stopped 7/8, the part"),
        (replace_word(1, "continues", "failed"), "was closed as failed 4/8, the part says"),
        (
            replace_word(0, "12:00:00", "12:00:01"),
            "part-0001.h5 was opened at 2026-11-21T12:00:00Z, not",
        ),
        (replace_word(3, "2026", "2027"), "part-0002.h5 was closed at 2026-11-21T12:00:02Z, not"),
        (list.pop, "does not say that part-0002.h5 was closed"),
        (lambda lines: lines.pop(0), "does not say that part-0001.h5 was opened"),
    ],
)
def test_a_wrong_line_of_the_digests_is_named(
    session: Path, spoil: Callable[[list[str]], object], words: str
) -> None:
    lines = (session / "digests.txt").read_text().splitlines()
    spoil(lines)
    (session / "digests.txt").write_text("\n".join(lines) + "\n")
    problems = verify(session).problems
    assert any(line.startswith("digests.txt: ") and words in line for line in problems), problems


def test_texts_beside_the_parts_must_be_those_of_the_first_part(session: Path) -> None:
    (session / "protocol.toml").write_text(PROTOCOL.replace("40", "41"))
    (session / "rig.toml").unlink()
    report = verify(session)
    assert report.problems == [
        "protocol.toml: was changed since the recording, part-0001.h5 contains the text that was "
        "used"
    ]
    assert "rig.toml: is missing, part-0001.h5 contains it" in report.notes


def without_digests(folder: Path) -> None:
    """Make a session as the program recorded it before there were digests."""
    (folder / "digests.txt").unlink()
    for path in folder.glob("part-*.h5"):
        with h5py.File(path, "r+") as file:
            del file[DIGESTS.path], file.attrs["previous_digest"]
            kept = [row for row in file["/events"][:] if row["kind"] != b"session_end"]
            file["/events"].resize(len(kept), axis=0)
            file["/events"][:] = np.array(kept, file["/events"].dtype)


def test_an_older_session_is_whole_with_a_note(session: Path) -> None:
    without_digests(session)
    report = verify(session)
    assert report.whole
    assert [note for note in report.notes if "before there were digests" in note] == [
        f"part-000{number}.h5: recorded before there were digests: alterations of its rows cannot "
        "be seen"
        for number in (1, 2)
    ]
    assert not verify(session, digest="0" * 64).whole


def test_digests_cannot_be_taken_out_of_one_part(session: Path) -> None:
    with h5py.File(session / "part-0001.h5", "r+") as file:
        del file[DIGESTS.path]
    assert not verify(session).whole


def test_an_older_session_is_resumed_with_digests(session: Path) -> None:
    without_digests(session)
    with Recorder(session, header(), PROTOCOL, RIG, resume=True) as rec:
        rec.begin_part("start", "A")
    report = verify(session, digest=rec.closing_digest)
    assert report.problems == []


def test_the_command_compares_and_prints_the_digest(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", str(session)]) == 0
    *_, answer, line = capsys.readouterr().out.splitlines()
    assert answer.endswith(" lost, finished")
    digest = line.removeprefix("digest: ")
    assert main(["verify", str(session), "--digest", f" {digest.upper()}"]) == 0
    assert "note: the closing digest is the one given" in capsys.readouterr().out
    assert main(["verify", str(session), "--json", "--digest", "a" * 64]) == 1
    plain = json.loads(capsys.readouterr().out)
    assert (plain["closing_digest"], plain["outcome"]) == (digest, "finished")


@pytest.mark.parametrize("text", ["", "xyz", "a" * 63, "a" * 65, "٣" * 64])
def test_what_is_no_digest_is_refused(
    session: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", str(session), "--digest", text]) == 2
    assert "is not a digest: give the 64 hexadecimal digits" in capsys.readouterr().err


def test_a_recovery_explains_altered_rows_and_does_not_prove_them(session: Path) -> None:
    kept = verify(session).closing_digest
    with h5py.File(session / "part-0002.h5", "r+") as file:
        one_sample(file)
    assert main(["recover", str(session)]) == 0
    report = verify(session)
    assert report.whole
    assert any("trial 6, attempt 1, as a recovery file says" in note for note in report.notes)
    assert verify(session, digest=kept).problems == [
        "the digest given does not prove part-0002.h5: recovery files say what is missing or "
        "altered there"
    ]
    with h5py.File(session / "part-0002.h5", "r+") as file:
        file["/taxels/samples"][501, 3] ^= 1  # later damage of the same rows is another one
    assert not verify(session).whole
