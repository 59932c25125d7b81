"""``rigctl verify`` tells how a session ended, and compares its closing digest and texts."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.cli import main
from rigctl.session.format.data_sets import DIGESTS
from rigctl.session.format.layout import SessionOutcome
from rigctl.session.verify.session import verify
from rigctl.session.write.recorder import Recorder
from tests.session import building
from tests.session.block_session import record_in_blocks, spoil_one_sample
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan
from tests.session.forging import rewrite_digests


@pytest.fixture(scope="module")
def drum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of two parts with several blocks of rows in each table."""
    folder = tmp_path_factory.mktemp("drum") / "s"
    record_in_blocks(folder)
    return folder


@pytest.fixture
def session(drum: Path, tmp_path: Path) -> Path:
    """A copy of the drum's session to damage."""
    return Path(shutil.copytree(drum, tmp_path / "s"))


def test_only_the_kept_digest_shows_a_chain_that_was_written_anew(session: Path) -> None:
    kept = verify(session).closing_digest
    assert verify(session, digest=kept).whole
    with h5py.File(session / "part-0001.h5", "r+") as file:
        spoil_one_sample(file)
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
        (replace_word(1, "4/8", "5/8"), "with 5/8 trials committed, the parts up to it have 4/8"),
        (replace_word(1, "4/8", "1000000/8"), "closed with 1000000/8 trials committed"),
        (replace_word(1, "4/8", "4/9"), "closed with 4/9 trials committed"),
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
        spoil_one_sample(file)
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
