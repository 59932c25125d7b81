"""A session reads no file outside its folder through a link; links inside it are followed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rigctl.analysis.trial_set import join_sessions
from rigctl.cli import main
from rigctl.errors import RigctlError, SessionError
from rigctl.session.analysis_file import content_digest
from rigctl.session.summary import summarise_session
from rigctl.session.verify import verify
from rigctl.session.writer_lock import WriterLock, is_being_written, lock_owner_pid
from tests.session.building import record_plan
from tests.session.test_truth_log import write_log

FILES = ("part-0001.h5", "part-0002.h5", "world.h5", "protocol.toml", "rig.toml")
READERS: tuple[Callable[[Path], object], ...] = (
    verify,
    summarise_session,
    lambda folder: join_sessions([folder]),
    content_digest,
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "s"
    record_plan(folder)
    write_log(folder, 2_000)
    return folder


def link_outside(path: Path) -> Path:
    """Move a file out of the session's folder, and leave a link to it."""
    target = path.parent.parent / f"outside-{path.name}"
    path.rename(target)
    path.symlink_to(target)
    return target


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Iterator[set[str]]:
    """The files that are opened, as the system resolves them."""
    paths: set[str] = set()
    real = os.open

    def watched(path: str | bytes | os.PathLike[str], *args: int, **options: int) -> int:
        paths.add(os.path.realpath(os.fsdecode(path)))
        return real(path, *args, **options)

    monkeypatch.setattr(os, "open", watched)
    yield paths


@pytest.mark.parametrize("name", FILES)
def test_no_file_outside_is_read_and_verify_says_so(
    session: Path, name: str, opened: set[str]
) -> None:
    target = link_outside(session / name)
    target.chmod(0)  # who is not root could not even open it
    opened.clear()
    problems = verify(session).problems
    sentences = [line for line in problems if "is a link to a file outside its folder" in line]
    assert len(sentences) == 1 and name in sentences[0]
    for read in READERS[1:]:
        try:
            read(session)
        except RigctlError as error:
            assert "\n" not in str(error)
    assert str(target) not in opened


def test_info_and_analyse_say_one_sentence(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in FILES[:2]:
        link_outside(session / name)
    for command in (["info"], ["verify"], ["analyse", "--out", str(tmp_path / "report")]):
        assert main([*command, str(session)]) in (1, 2)
        printed = capsys.readouterr()
        assert "is a link to a file outside its folder" in printed.out + printed.err
        assert "Traceback" not in printed.err


def test_links_inside_the_folder_and_a_linked_folder_are_followed(
    session: Path, tmp_path: Path
) -> None:
    (session / "storage").mkdir()
    for name in FILES:
        (session / name).rename(session / "storage" / name)
        (session / name).symlink_to(Path("storage") / name)
    linked = tmp_path / "linked"
    linked.symlink_to(session)
    for folder in (session, linked):
        report = verify(folder)
        assert report.whole, report.problems
        for read in READERS:
            read(folder)


def test_a_lock_that_is_a_link_is_not_emptied(session: Path, tmp_path: Path) -> None:
    target = tmp_path / "precious"
    target.write_text("1")
    (session / "writer.lock").symlink_to(target)
    with pytest.raises(SessionError, match=r"writer\.lock is a link, not a file"):
        WriterLock(session)
    assert lock_owner_pid(session) is None
    assert not is_being_written(session)
    assert target.read_text() == "1"


def test_no_lock_is_waited_for(session: Path) -> None:
    os.mkfifo(session / "writer.lock")
    with pytest.raises(SessionError, match=r"writer\.lock is a pipe"):
        WriterLock(session)
    assert not is_being_written(session)
