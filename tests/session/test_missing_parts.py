"""One damaged part hides its own trials only, and is named wherever trials are counted."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.analysis.trial_set import join_sessions
from rigctl.cli import main
from rigctl.errors import SessionError
from rigctl.finger.session import FingerSession
from rigctl.session import writer
from rigctl.session.hdf5_file import write_attributes
from rigctl.session.layout import part_name, part_number
from rigctl.session.part import existing_parts
from rigctl.session.recorder import Recorder
from rigctl.session.session import Session, open_session
from rigctl.session.summary import summarise_session
from rigctl.session.verify import verify
from tests.finger import finger_building
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan, recorder
from tests.session.damage import kill_while_recording, record_four_parts, truncate, zero

Damage = Callable[[Path], Any]
DAMAGE: dict[str, Damage] = {
    **{f"cut at {share}": partial(truncate, share=share) for share in (0.999, 0.9, 0.5, 0.01, 0)},
    "deleted": Path.unlink,
    "zeros": zero,
}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drum") / "s"
    record_four_parts(folder)
    return folder


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
@pytest.mark.parametrize("number", [1, 2, 4])
def test_the_trials_of_the_other_parts_stay_usable(
    session: Path, number: int, damage: Damage
) -> None:
    damage(session / part_name(number))
    with Session.open(session) as opened:
        (missing,) = opened.missing_parts
        assert missing.name == part_name(number)
        assert sorted(set(opened.trials["part"].tolist())) == sorted({1, 2, 3, 4} - {number})
        assert len(opened.committed()) == 6
        assert all(opened.window(index).complete for index in opened.committed())
        (line,) = opened.describe_missing()
        assert line.startswith(f"{part_name(number)} ")
        assert line.endswith("its trials are left out")
    summary = summarise_session(session)
    assert (summary["trials_committed"], summary["missing"]) == (6, [line])
    assert any(line in remark for remark in join_sessions([session]).remarks)
    report = verify(session)
    assert report.trials_committed == 6
    assert line in report.problems


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
@pytest.mark.parametrize("number", [1, 4])
def test_a_resume_records_the_trials_of_the_bad_part_again(
    session: Path, number: int, damage: Damage
) -> None:
    damage(session / part_name(number))
    with Session.open(session) as opened:
        done = set(opened.trials["trial_id"][opened.committed()].tolist())
    with Recorder(session, header(), PROTOCOL, RIG, resume=True) as rec:
        rec.begin_part("resume", "A")
        source = SyntheticRig(rec)
        for trial in plan().trials:
            if trial.trial_id not in done:
                source.trial(trial)
    assert rec.status.part == 5  # never the number of the bad part
    with Session.open(session) as opened:
        ids = opened.trials["trial_id"][opened.committed()].tolist()
        assert ids == list(range(1, 9))
        assert [part.name for part in opened.missing_parts] == [part_name(number)]


@pytest.mark.parametrize("share", [0.999, 0.7, 0.4, 0.05])
@pytest.mark.parametrize("number", [1, 2])
def test_a_session_of_the_finger_stays_usable_too(
    tmp_path: Path, number: int, share: float
) -> None:
    folder = tmp_path / "s"
    record_finger_parts(folder)
    truncate(folder / part_name(number), share)
    with FingerSession.open(folder) as opened:
        assert [part.name for part in opened.missing_parts] == [part_name(number)]
        assert len(opened.committed()) == len(finger_building.plan().trials) // 2
        done = set(opened.trials["trial_id"][opened.committed()].tolist())
        assert all(len(opened.spikes(index)) for index in opened.committed())
    assert summarise_session(folder)["missing"]
    with (
        finger_building.recorder(folder, resume=True) as rec,
        finger_building.SyntheticFinger(rec) as source,
    ):
        rec.begin_part("resume")
        for trial in finger_building.plan().trials:
            if trial.trial_id not in done:
                source.trial(trial)
    assert rec.status.part == 3
    with FingerSession.open(folder) as opened:
        counts = Counter(opened.trials["trial_id"][opened.committed()].tolist())
    assert counts == dict.fromkeys((t.trial_id for t in finger_building.plan().trials), 1)


def record_finger_parts(folder: Path) -> None:
    trials = finger_building.plan().trials
    with (
        finger_building.recorder(folder) as rec,
        finger_building.SyntheticFinger(rec) as source,
    ):
        for number, trial in enumerate(trials):
            if number % (len(trials) // 2) == 0:
                rec.begin_part("start")
            source.trial(trial)


def test_a_copy_of_a_part_is_ignored_and_named(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = session / "part-0002 (copy).h5"
    shutil.copyfile(session / "part-0002.h5", copy)
    (session / "part-03.h5").write_bytes(b"")
    with Session.open(session) as opened:
        assert [part.number for part in opened.parts] == [1, 2, 3, 4]
        assert len(opened.committed()) == 8
    assert main(["info", "--json", str(session)]) == 0
    assert json.loads(capsys.readouterr().out)["ignored"] == [copy.name, "part-03.h5"]
    report = verify(session)
    assert report.whole
    assert any(copy.name in note for note in report.notes)


def test_a_part_under_the_name_of_another_is_left_out(session: Path) -> None:
    shutil.copyfile(session / "part-0002.h5", session / "part-0003.h5")
    with Session.open(session) as opened:
        assert opened.describe_missing() == [
            "part-0003.h5 claims to be part 2: it is a copy or was renamed; its trials are left out"
        ]
        assert len(set(opened.trials["trial_id"][opened.committed()].tolist())) == 6


def test_a_part_of_another_plan_is_left_out(session: Path) -> None:
    with h5py.File(session / "part-0001.h5", "r+") as file:
        write_attributes(file, {"plan_hash": "0" * 32})
    with Session.open(session) as opened:
        assert opened.header.plan_hash == plan().hash
        assert "another plan" in opened.describe_missing()[0]


def test_a_session_without_a_readable_part_is_refused(session: Path) -> None:
    for number in (1, 2, 3, 4):
        zero(session / part_name(number))
    for opening in (Session.open, open_session):
        with pytest.raises(SessionError, match=r"part-0001\.h5 is damaged"):
            opening(session)


def test_the_last_part_is_missed_without_a_list(session: Path) -> None:
    """The part before it says that another one followed."""
    (session / "part-0004.h5").unlink()
    with Session.open(session) as opened:
        (missing,) = opened.missing_parts
        assert missing.name == "part-0004.h5"
        assert "part-0003.h5 says that another part followed it" in missing.reason
        assert not opened.finished
    with Recorder(session, header(), PROTOCOL, RIG, resume=True) as rec:
        rec.begin_part("resume", "A")
    assert rec.status.part == 5


@pytest.mark.parametrize("moment", ["_write_new", "build_part", "describe_part"])
def test_a_part_that_a_kill_kept_from_beginning_is_not_missed(
    tmp_path: Path, moment: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed when the part before it was closed: nothing was recorded into it."""
    folder, killed = tmp_path / "s", tmp_path / "killed"
    step = getattr(writer, moment)

    def copied(*args: object) -> object:
        if (folder / part_name(1)).exists() and not killed.exists():
            shutil.copytree(folder, killed)
        return step(*args)

    monkeypatch.setattr(writer, moment, copied)
    with recorder(folder) as rec:
        rec.begin_part("start", "A")
        SyntheticRig(rec).idle(100)
        rec.begin_part("plate change", "B")
    with Session.open(killed) as opened:
        assert not opened.missing_parts
    with Recorder(killed, header(), PROTOCOL, RIG, resume=True) as rec:
        rec.begin_part("resume", "B")
    assert [path.name for path in existing_parts(killed)] == [part_name(1), part_name(2)]
    assert not verify(killed).problems
    assert not list(killed.glob("*.new"))


def test_trials_beyond_the_end_of_a_killed_part_are_left_out_one_by_one(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    kill_while_recording(folder, 6, tmp_path / "scratch", idle=5000)
    part = folder / "part-0001.h5"
    whole = part.read_bytes()
    counts = set()
    for share in np.linspace(0.2, 1, 30):
        part.write_bytes(whole[: int(share * len(whole))])
        try:
            with Session.open(folder) as opened:
                committed = opened.committed()
                counts.add(len(committed))
                assert all(opened.window(index).complete for index in committed)
                left_out = opened.trials["trial_id"][list(opened.left_out)].tolist()
                lines = opened.describe_missing()
                assert all(any(f"{n}" in line for line in lines) for n in left_out)
                n_rows = 6 - opened.parts[0].cut_rows.get("/trials", 0)
                assert len(committed) + len(left_out) == n_rows
        except SessionError as error:
            assert "part-0001.h5" in str(error)
    assert max(counts) == 6
    assert counts & {1, 2, 3, 4, 5}


def test_numbers_are_never_used_again(tmp_path: Path) -> None:
    assert part_number(Path("part-00001.h5")) == part_number(Path("part-0001.h5.h5")) == 0
    assert part_number(Path("part-12345.h5")) == 12345
    assert part_number(Path("part-99999.h5")) == 0
    folder = tmp_path / "s"
    record_four_parts(folder)
    (folder / "part-0004.h5").unlink()
    with Recorder(folder, header(), PROTOCOL, RIG, resume=True) as rec:
        rec.begin_part("resume", "A")
    assert rec.status.part == 5
