"""``rigctl recover`` puts damaged sessions in order and loses nothing."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.cli import main
from rigctl.errors import DiskFault, SessionError
from rigctl.session.format.file_names import part_name
from rigctl.session.open_session import open_session
from rigctl.session.read.recovery_file import damaged_recoveries, read_recoveries
from rigctl.session.read.session import Session
from rigctl.session.recover import replacement
from rigctl.session.recover.recover import recover
from rigctl.session.verify.session import verify
from rigctl.session.write.recorder import Recorder
from tests.session import finger_building
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan, recorder
from tests.session.damage import is_closed, kill_while_recording, record_four_parts, truncate, zero
from tests.session.test_missing_parts import DAMAGE, record_finger_parts

NOW = "2026-11-23T14:00:00Z"


@pytest.fixture(scope="module")
def four_parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("four") / "s"
    record_four_parts(folder)
    return folder


@pytest.fixture(scope="module")
def killed_parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("killed")
    kill_while_recording(folder / "s", 6, folder / "scratch", idle=5000)
    return folder / "s"


@pytest.fixture
def session(four_parts: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(four_parts, tmp_path / "s"))


@pytest.fixture
def killed(killed_parts: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(killed_parts, tmp_path / "killed"))


def readable_trials(folder: Path) -> dict[tuple[int, int], bytes]:
    """Return the samples of each committed attempt that can be read now."""
    found: dict[tuple[int, int], bytes] = {}
    try:
        session = open_session(folder)
    except SessionError:
        return found
    with session:
        for index in session.committed():
            row = session.trials[index]
            samples = session.samples(int(index))
            found[int(row["trial_id"]), int(row["attempt"])] = samples.tobytes()
    return found


def digests_of(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file, by name."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != "writer.lock"]
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }


def check_recovered(folder: Path, before: dict[str, str], readable: dict[Any, bytes]) -> None:
    """Check that no byte and no trial was lost, and that every part opens everywhere."""
    assert set(before.values()) <= set(digests_of(folder).values())
    after = readable_trials(folder)
    assert readable.items() <= after.items()
    for path in folder.glob("part-*.h5"):
        with h5py.File(path) as file:
            assert file.attrs["part"]
        assert is_closed(path)
    report = verify(folder)
    assert report.whole, report.problems


def resume(folder: Path) -> None:
    with Session.open(folder) as opened:
        done = set(opened.trials["trial_id"][opened.committed()].tolist())
    with Recorder(folder, header(), PROTOCOL, RIG, resume=True) as rec:
        rec.begin_part("resume", "A")
        source = SyntheticRig(rec)
        for trial in plan().trials:
            if trial.trial_id not in done:
                source.trial(trial)


@pytest.mark.parametrize(
    ("number", "how"),
    [*((4, how) for how in DAMAGE), (1, "cut at 0.9"), (1, "deleted"), (3, "zeros")],
)
def test_a_damaged_part_is_put_in_order_and_its_trials_are_recorded_again(
    session: Path, number: int, how: str
) -> None:
    DAMAGE[how](session / part_name(number))
    before, readable = digests_of(session), readable_trials(session)
    found = recover(session, NOW)
    assert found.record is not None
    assert found.record.path.name == "recovery-20261123T140000Z.json"
    check_recovered(session, before, readable)
    resume(session)
    assert set(readable_trials(session)) >= {(n, 1) for n in range(1, 9)}
    assert verify(session).trials_committed == 8
    assert verify(session).whole
    assert recover(session, NOW).findings.is_in_order


def test_a_killed_part_becomes_a_closed_file_of_the_same_bytes(killed: Path) -> None:
    part = killed / "part-0001.h5"
    whole = part.read_bytes()
    with pytest.raises(OSError, match="already open"):
        h5py.File(part)
    readable = readable_trials(killed)
    assert len(readable) == 6
    (outcome,) = recover(killed, NOW).parts
    assert outcome.remedy == "closed copy"
    assert part.read_bytes()[48:] == whole[48:]
    with h5py.File(part) as file:
        assert file["/trials"].shape == (6,)
    (original,) = (killed / "quarantine").iterdir()
    assert original.read_bytes() == whole
    assert readable_trials(killed) == readable
    assert not (killed / "writer.lock").exists()
    assert verify(killed).whole
    assert recover(killed, NOW).findings.is_in_order
    if shutil.which("h5dump"):
        subprocess.run(["h5dump", "-H", part], check=True, capture_output=True)


@pytest.mark.parametrize("share", np.linspace(0.05, 0.99, 7))
def test_what_can_be_read_of_a_truncated_killed_part_is_saved(killed: Path, share: float) -> None:
    truncate(killed / "part-0001.h5", share)
    before, readable = digests_of(killed), readable_trials(killed)
    recover(killed, NOW)
    if not list(killed.glob("part-*.h5")):
        assert not readable
        assert set(before.values()) <= set(digests_of(killed).values())
        return
    check_recovered(killed, before, readable)
    with h5py.File(killed / "part-0001.h5") as file:
        assert bytes(file.attrs["recovered_from"]).startswith(b"quarantine/part-0001.")


def test_a_truncated_closed_part_keeps_the_trials_before_its_end(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    with recorder(folder) as rec:
        rec.begin_part("start", "A")
        source = SyntheticRig(rec)
        for trial in plan().trials:
            source.idle(8000)
            source.trial(trial)
            rec.wait_written()
    whole = readable_trials(folder)
    data = (folder / "part-0001.h5").read_bytes()
    counts = set()
    for share in (0.3, 0.5, 0.7, 0.9, 0.99):
        copy = Path(shutil.copytree(folder, tmp_path / f"{share}"))
        (copy / "part-0001.h5").write_bytes(data[: int(share * len(data))])
        result = recover(copy, NOW)
        saved = readable_trials(copy)
        assert saved.items() <= whole.items()
        if result.parts[0].remedy == "rewritten":
            assert {trial for trial, _ in saved} == set(range(1, 9)) - set(result.not_committed)
        counts.add(len(saved))
    assert counts & set(range(1, 8))


def test_a_session_of_the_finger_is_put_in_order(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    record_finger_parts(folder)
    truncate(folder / "part-0002.h5", 0.97)
    before, readable = digests_of(folder), readable_trials(folder)
    recover(folder, NOW)
    check_recovered(folder, before, readable)
    with finger_building.recorder(folder, resume=True) as rec:
        rec.begin_part("resume")
    assert rec.status.part == 3


def test_strays_and_damaged_logs_go_to_quarantine(session: Path) -> None:
    strays = ["part-0002 (copy).h5", "part-0005.new", "world.h5"]
    for name in strays:
        (session / name).write_bytes(name.encode())
    before = digests_of(session)
    recover(session, NOW)
    assert not any((session / name).exists() for name in strays)
    assert set(before.values()) <= set(digests_of(session).values())
    (record,) = read_recoveries(session)
    assert sorted(moved.name for moved in record.moved) == strays
    assert verify(session).whole


def test_a_dry_run_changes_nothing(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    zero(session / "part-0002.h5")
    before = digests_of(session)
    assert main(["recover", "--dry-run", str(session)]) == 0
    out = capsys.readouterr().out
    assert "part-0002.h5: removed; it is damaged" in out
    assert "not committed: " in out
    assert digests_of(session) == before


def test_the_command_prints_what_was_saved(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truncate(session / "part-0002.h5", 0.99)
    assert main(["recover", str(session)]) == 0
    out = capsys.readouterr().out
    assert "/taxels/samples" in out
    assert "recovery file: " in out
    assert main(["recover", "--json", str(session)]) == 0
    assert json.loads(capsys.readouterr().out)["in_order"]
    assert main(["recover", str(session / "none")]) == 2


def test_a_session_that_is_written_is_refused(tmp_path: Path) -> None:
    with recorder(tmp_path / "s") as rec:
        rec.begin_part("start", "A")
        rec.wait_written()
        with pytest.raises(SessionError, match="is being written by process"):
            recover(tmp_path / "s", NOW)


def test_an_altered_recovery_file_attests_nothing(session: Path) -> None:
    zero(session / "part-0002.h5")
    record = recover(session, NOW).record
    assert record is not None
    text = record.path.read_text()
    record.path.write_text(text.replace("part-0002.h5", "part-0003.h5"))
    assert read_recoveries(session) == ()
    assert "was altered" in damaged_recoveries(session)[0]
    assert not verify(session).whole


STEPS = ("link", "replace", "rename", "unlink", "mkdir")
KILLED = 9


def recover_and_die(folder: Path, steps: int) -> int:
    """Recover in a process that dies after this many calls that change the disk; its exit code."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    calls = 0

    def count(function: Callable[..., Any]) -> Callable[..., Any]:
        def step(*args: Any, **options: Any) -> Any:
            nonlocal calls
            calls += 1
            if calls > steps:
                os._exit(KILLED)
            return function(*args, **options)

        return step

    for name in STEPS:
        setattr(os, name, count(getattr(os, name)))
    recover(folder, NOW)
    os._exit(0)


def test_a_recovery_that_is_killed_at_any_step_is_finished_by_the_next(
    four_parts: Path, tmp_path: Path
) -> None:
    damaged = Path(shutil.copytree(four_parts, tmp_path / "damaged"))
    truncate(damaged / "part-0002.h5", 0.99)
    zero(damaged / "part-0004.h5")
    (damaged / "part-0002 (copy).h5").write_bytes(b"copy")
    before, readable = digests_of(damaged), readable_trials(damaged)
    folder, steps = tmp_path / "s", 0
    while True:
        shutil.copytree(damaged, folder)
        if recover_and_die(folder, steps) != KILLED:
            break
        assert set(before.values()) <= set(digests_of(folder).values())
        recover(folder, NOW)
        assert set(before.values()) <= set(digests_of(folder).values())
        assert len(list(folder.glob("part-*.h5"))) == 3
        assert len(read_recoveries(folder)) == 1
        assert not list(folder.glob("*.new")) + list(folder.glob("*.recovered"))
        shutil.rmtree(folder)
        steps += 1
    check_recovered(folder, before, readable)
    assert steps >= 9


def test_what_a_recovery_left_that_had_moved_nothing_is_removed(session: Path) -> None:
    zero(session / "part-0002.h5")
    before, readable = digests_of(session), readable_trials(session)
    (session / "recovery-20261123T130000Z.json.new").write_text('{"kind": "rigctl-rec')
    (session / "part-0002.h5.recovered").write_bytes(b"half")
    recover(session, NOW)
    check_recovered(session, before, readable)
    assert not list(session.glob("*.new")) + list(session.glob("*.recovered"))


def test_altered_rows_are_listed_and_their_trials_recorded_again(session: Path) -> None:
    with Session.open(session) as opened:
        row = opened.trials[np.flatnonzero(opened.trials["part"] == 2)[0]]
        first, trial_id = int(row["first_sample"]), int(row["trial_id"])
    with h5py.File(session / "part-0002.h5", "r+") as file:
        file["/taxels/samples"][first + 5, 3] ^= 1
    before = digests_of(session)
    assert not verify(session).whole
    record = recover(session, NOW).record
    assert record is not None
    assert trial_id in {trial.trial_id for trial in record.left_out}
    assert before.items() <= digests_of(session).items()  # the part stays
    report = verify(session)
    assert report.whole, report.problems
    with Session.open(session) as opened:
        left_out = set(opened.trials["trial_id"][list(opened.left_out)].tolist())
        assert trial_id in left_out
        assert trial_id not in opened.trials["trial_id"][opened.committed()]
        assert any("/taxels/samples" in line for line in opened.describe_missing())
    resume(session)
    report = verify(session)
    assert report.whole, report.problems
    assert report.trials_committed == 8
    assert recover(session, NOW).findings.is_in_order
    with h5py.File(session / "part-0002.h5", "r+") as file:
        file["/taxels/samples"][first + 5, 3] ^= 2
    assert not verify(session).whole  # further damage is told apart


def test_without_hard_links_the_original_is_moved(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "no hard links")

    monkeypatch.setattr(os, "link", refuse)
    truncate(session / "part-0002.h5", 0.99)
    before, readable = digests_of(session), readable_trials(session)
    recover(session, NOW)
    check_recovered(session, before, readable)


def test_a_full_disk_loses_nothing(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    truncate(session / "part-0002.h5", 0.99)
    before = digests_of(session)
    usage = shutil.disk_usage(session)
    with monkeypatch.context() as patch:
        full = type(usage)(usage.total, usage.total, 0)
        patch.setattr(replacement.shutil, "disk_usage", lambda _: full)
        with pytest.raises(DiskFault, match="make room"):
            recover(session, NOW)
    assert digests_of(session) == before
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left")))
        with pytest.raises(DiskFault, match="originals are unchanged"):
            recover(session, NOW)
    assert digests_of(session) == before
    recover(session, NOW)
    assert verify(session).whole
