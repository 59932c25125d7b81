"""``rigctl verify`` tells how a session ended, and compares its closing digest and texts."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import pytest

from rigctl.cli import main
from rigctl.session.layout import DIGESTS, SessionOutcome
from rigctl.session.recorder import Recorder
from rigctl.session.verify import verify
from tests.session import building
from tests.session.block_session import spoil_one_sample
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan
from tests.session.forging import rewrite_digests


@pytest.fixture
def recorded(in_blocks: Path) -> Path:
    return in_blocks


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


def test_texts_beside_the_parts_must_be_those_of_the_first_part(session: Path) -> None:
    (session / "protocol.toml").write_text(PROTOCOL.replace("40", "41"))
    (session / "rig.toml").unlink()
    report = verify(session)
    assert report.problems == [
        "protocol.toml: was changed since the recording, part-0001.h5 contains the text that was "
        "used"
    ]
    assert "rig.toml: is missing, part-0001.h5 contains it" in report.notes


def test_a_part_without_digests_is_refused_with_the_version_that_reads_it(session: Path) -> None:
    for path in session.glob("part-*.h5"):
        with h5py.File(path, "r+") as file:
            del file[DIGESTS.path], file.attrs["previous_digest"]
    (problem,) = verify(session).problems
    assert "recorded before 2026-11-23: read it with commit 62bff220 of rigctl" in problem


def test_digests_cannot_be_taken_out_of_one_part(session: Path) -> None:
    with h5py.File(session / "part-0001.h5", "r+") as file:
        del file[DIGESTS.path]
    assert not verify(session).whole


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
