"""``rigctl verify`` passes an intact session and names each fault of a damaged one."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.cli import create_parser
from rigctl.cli import verify as command
from rigctl.errors import SessionError
from rigctl.session.recorder import Recorder
from rigctl.session.verify import verify
from rigctl.values import Gap, Verdict
from tests.session.building import (
    PROTOCOL,
    RIG,
    SyntheticRig,
    block,
    header,
    plan,
    record_plan,
    recorder,
)
from tests.session.forging import rewrite_digests
from tests.session.spoiling import Spoil, set_array, set_row


def run(*words: str) -> int:
    return command.run(create_parser(["verify"]).parse_args(["verify", *words]))


def test_a_complete_session_has_no_problem(drum: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(str(drum)) == 0
    assert "is whole: 8 trials committed" in capsys.readouterr().out
    assert run(str(drum), "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["whole"], answer["problems"], answer["lost_samples"]) == (True, [], 0)


def test_a_folder_without_a_session_is_wrong_use(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match=r"is not a session: it contains no part-0001\.h5"):
        run(str(tmp_path))
    with pytest.raises(SessionError, match="is not a session: there is no such folder"):
        run(str(tmp_path / "none"))


def cut(path: str, length: int) -> Spoil:
    return lambda file: file[path].resize(length, axis=0)


def no_unit(file: h5py.File) -> None:
    del file["/taxels/samples"].attrs["unit"]


def no_columns(file: h5py.File) -> None:
    file["/trials"].attrs["columns"] = 1e308


def other_seed(file: h5py.File) -> None:
    file.attrs["seed"] = 99


def again(file: h5py.File) -> None:
    """Commit the first trial a second time."""
    rows = file["/trials"]
    first = rows[0]
    rows.resize(rows.shape[0] + 1, axis=0)
    rows[-1] = first


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (cut("/taxels/samples", 500), "per-sample data sets differ in length"),
        (set_array("/taxels/counter", slice(100, 101), 99), "counter decreases at row 100"),
        (cut("/events", 0), "of /events were removed or altered, the table is shorter"),
        (set_row("/trials", 0, first_sample=7), "row 7 is not the first sample from"),
        (set_row("/trials", 0, count=200), "it has 200 samples, the plan has 300"),
        (set_row("/trials", 0, first_sample=10**6), "is not among the"),
        (set_row("/trials", 0, speed_mm_s=41), "trial 5 is not in the plan"),
        (set_row("/trials", 0, ended_s=-1), "it ended before it began"),
        (set_row("/trials", 0, first_counter=-1), "it is committed without a window"),
        (set_row("/trials", 1, trial_id=5), "trial 5 is committed 2 times"),
        (again, "trials 5 and 5 overlap"),
        (set_array("/taxels/flags", slice(60, 70), 0), "the sync line was low in 10 samples"),
        (set_array("/taxels/edges", slice(0, 90), 0), "does not begin at a rise"),
        (set_row("/taxels/arrivals", 3, arrived_s=0), "/taxels/arrivals goes back in time"),
        (set_row("/taxels/arrivals", 3, first_row=5), "/taxels/arrivals does not ascend"),
        (set_row("/loadcell", 2, sequence=0), "holds a conversion twice"),
        (set_row("/drum", 1, at_s=0), "/drum goes back in time"),
        (no_unit, "/taxels/samples has no attribute unit"),
        (no_columns, "/trials does not describe its columns"),
        (other_seed, "has another seed than the first part"),
    ],
)
def test_each_damage_is_named(session: Path, spoil: Spoil, words: str) -> None:
    with h5py.File(session / "part-0002.h5", "r+") as file:
        spoil(file)
    report = verify(session)
    assert not report.whole
    assert any(words in line for line in report.problems), report.problems
    assert run(str(session)) == 1


@pytest.mark.parametrize("rows", [1, 50, 313])
def test_findings_do_not_depend_on_the_read_size(
    session: Path, rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with h5py.File(session / "part-0002.h5", "r+") as file:
        set_array("/taxels/flags", slice(60, 70), 0)(file)
        set_array("/taxels/edges", slice(0, 90), 0)(file)
        set_row("/trials", 1, first_sample=7)(file)
    at_once = verify(session)
    monkeypatch.setattr("rigctl.session.part.READ_AHEAD_ROWS", rows)
    assert verify(session) == at_once
    assert len(at_once.problems) > 3


def test_progress_rises_to_the_end(drum: Path) -> None:
    steps: list[tuple[float, str]] = []
    verify(drum, lambda share, step: steps.append((share, step)))
    shares = [share for share, _ in steps]
    assert shares == sorted(shares)
    assert steps[0] == (0.0, "part 1 of 2")
    assert (0.5, "part 2 of 2") in steps
    assert steps[-1] == (1.0, "the plan")


def test_a_missing_part_a_truncated_part_and_a_foreign_file_are_named(session: Path) -> None:
    part = session / "part-0001.h5"
    whole = part.read_bytes()
    part.write_bytes(whole[: len(whole) // 2])
    assert "part-0001.h5 is damaged" in verify(session).problems[0]
    part.unlink()
    assert "part-0001.h5 is missing; its trials are left out" in verify(session).problems[0]
    with h5py.File(part, "w") as file:
        file["x"] = 1
    assert "not a part of a rigctl session" in verify(session).problems[0]


def test_gaps_must_be_listed(tmp_path: Path) -> None:
    for name, gap in (
        ("listed", Gap(110, 5, "crc")),
        ("missing", None),
        ("wrong", Gap(110, 4, "")),
    ):
        with recorder(tmp_path / name) as rec:
            rec.begin_part("start", "A")
            rec.add_block(block(100))
            rec.add_block(block(115, gap=gap))
    assert verify(tmp_path / "listed").whole
    assert verify(tmp_path / "listed").lost_samples == 5
    problems = verify(tmp_path / "missing").problems
    assert problems == [
        "part-0001.h5: 5 samples from counter 110 are missing at row 10, not in /gaps"
    ]
    problems = verify(tmp_path / "wrong").problems
    assert "/gaps lists 4 lost samples from counter 110, the samples do not" in problems[0]


def test_gaps_before_the_first_sample_of_a_part_are_ignored(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        rec.add_block(block(100, gap=Gap(90, 10, "while the part was changed")))
    assert verify(tmp_path / "s").whole


def test_a_session_being_written_is_incomplete(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        rec.wait_written()
        assert verify(tmp_path / "s").problems == ["part-0001.h5: is still being written"]
    report = verify(tmp_path / "s")
    assert report.whole
    assert "8 of 8 planned trials are not committed" in report.notes


def test_a_resumed_session_is_complete(session: Path) -> None:
    """Its first part was written by a killed process."""
    with h5py.File(session / "part-0001.h5", "r+") as file:
        file["/events"].resize(0, axis=0)
    rewrite_digests(session)
    report = verify(session)
    assert report.whole
    note = "part-0001.h5: was not closed properly, a later part continues the session"
    assert note in report.notes


def test_rejected_attempts_are_kept_and_do_not_count(tmp_path: Path) -> None:
    trial = plan().trials[0]
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        bench = SyntheticRig(rec)
        bench.trial(trial, Verdict.REJECTED, attempt=1)
        bench.trial(trial, attempt=2)
        bench.trial(trial, Verdict.ABORTED, attempt=3)
    with h5py.File(tmp_path / "s" / "part-0001.h5", "r+") as file:
        set_row("/trials", 2, first_counter=-1)(file)
    rewrite_digests(tmp_path / "s")
    report = verify(tmp_path / "s")
    assert report.whole
    assert report.trials_committed == 1
    assert "part-0001.h5: rises of the sync line that belong to no trial: 1" in report.notes


def test_another_plan_hash_is_found(tmp_path: Path) -> None:
    wrong = {**{name: getattr(header(), name) for name in type(header()).__slots__}}
    wrong["plan_hash"] = "0" * 32
    with Recorder(tmp_path / "s", type(header())(**wrong), PROTOCOL, RIG) as rec:
        rec.begin_part("start", "A")
    assert any(
        "plan hash does not match the session's protocol" in line
        for line in verify(tmp_path / "s").problems
    )


def test_a_session_without_a_sync_wire_is_reported(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    for path in (tmp_path / "s").glob("part-*.h5"):
        with h5py.File(path, "r+") as file:
            file["/taxels/flags"][:] = np.uint8(0)
    rewrite_digests(tmp_path / "s")
    report = verify(tmp_path / "s")
    assert report.whole
    assert any("the sync line was never high" in note for note in report.notes)
