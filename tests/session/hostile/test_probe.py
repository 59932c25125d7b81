"""Metadata that kills HDF5, with its checksums right, kills another process and not this one."""

from __future__ import annotations

import gzip
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import pytest

from rigctl.errors import SessionError
from rigctl.session.format.data_sets import LIBVER
from rigctl.session.hdf5 import probe, probe_child
from rigctl.session.hdf5.hdf5_file import Hdf5File
from rigctl.session.hdf5.probe import ProbeHelper
from tests.fuzz.mutations.checksums import find_blocks, repair

B_TREE = b"BTHD"
DATA = Path(__file__).parent / "data"
DIES = "dies of it"
WITH_A_THREAD = """
import os, sys, threading
from pathlib import Path
from rigctl.session.hdf5 import probe, probe_child
from rigctl.session.hdf5.hdf5_file import Hdf5File
os.fork = None  # it warns of threads since Python 3.12
stop = threading.Event()
threading.Thread(target=stop.wait).start()
Hdf5File(Path(sys.argv[1])).close()
stop.set()
print(probe._helper()._process.pid)
"""


def many_attributes(path: Path) -> bytes:
    """Write a file with so many attributes that HDF5 finds them through a B-tree."""
    with h5py.File(path, "w", libver=LIBVER) as file:
        for number in range(20):
            file.attrs[f"attribute {number}"] = number
    return path.read_bytes()


def request(path: Path) -> dict[str, Any]:
    return {"kind": "hdf5", "path": str(path), "processor_s": 0.5, "head": "", "options": {}}


def mutants(path: Path) -> Iterator[None]:
    """Write the file again and again, with another byte of its B-tree changed each time."""
    whole = many_attributes(path)
    block = next(b for b in find_blocks(whole) if whole[b.start : b.start + 4] == B_TREE)
    for at in range(block.start + 4, block.checksum):
        data = bytearray(whole)
        data[at] ^= 0x55
        repair(data, block)
        path.write_bytes(data)
        yield


@pytest.fixture
def helper() -> Iterator[ProbeHelper]:
    """Yield a helper of the test's own."""
    opened = ProbeHelper()
    yield opened
    opened.close()


def pid_of(helper: ProbeHelper) -> int:
    assert helper._process is not None
    return helper._process.pid


def test_no_byte_of_a_b_tree_ends_the_process(tmp_path: Path) -> None:
    path, refusals = tmp_path / "file.h5", []
    for _ in mutants(path):
        try:
            with Hdf5File(path) as file:
                file.attributes()
        except SessionError as error:
            refusals.append(str(error))
    assert len(refusals) > 5 and all(str(path) in text for text in refusals)
    assert any(DIES in text for text in refusals)


def test_attributes_that_cannot_be_listed_are_refused_before_they_are_read(tmp_path: Path) -> None:
    """HDF5 frees the same memory twice where it gets none for a node of 256 MB."""
    path = tmp_path / "file.h5"
    data = bytearray(many_attributes(path))
    block = next(b for b in find_blocks(bytes(data)) if data[b.start : b.start + 4] == B_TREE)
    node_size, records = block.start + 6, block.start + 26
    data[node_size : node_size + 4] = (0x10000200).to_bytes(4, "little")
    data[records : records + 2] = (0x8021).to_bytes(2, "little")
    repair(data, block)
    path.write_bytes(data)
    with pytest.raises(SessionError, match=DIES):
        Hdf5File(path)


def test_an_index_that_names_a_removed_attribute_is_refused(tmp_path: Path) -> None:
    """HDF5 reads what stood there before, and frees what it never got."""
    path = tmp_path / "file.h5"
    many_attributes(path)
    with h5py.File(path, "r+", libver=LIBVER) as file:
        del file.attrs["attribute 19"]
    data = bytearray(path.read_bytes())
    block = next(b for b in find_blocks(bytes(data)) if data[b.start : b.start + 4] == B_TREE)
    data[block.start + 24] = 20
    repair(data, block)
    path.write_bytes(data)
    with pytest.raises(SessionError, match=DIES):
        Hdf5File(path)


def test_deadly_files_leave_the_helper_alive(tmp_path: Path, helper: ProbeHelper) -> None:
    sound, deadly = tmp_path / "sound.h5", tmp_path / "deadly.h5"
    many_attributes(sound)
    assert helper.survives(request(sound))
    pid = pid_of(helper)
    assert not all(helper.survives(request(deadly)) for _ in mutants(deadly))
    assert helper.survives(request(sound)) and pid_of(helper) == pid


def test_a_helper_that_was_killed_is_started_again(tmp_path: Path, helper: ProbeHelper) -> None:
    many_attributes(tmp_path / "file.h5")
    assert helper.survives(request(tmp_path / "file.h5"))
    before = pid_of(helper)
    os.kill(before, signal.SIGKILL)
    assert helper.survives(request(tmp_path / "file.h5"))
    assert pid_of(helper) != before


def test_without_a_helper_no_file_is_refused(
    tmp_path: Path, helper: ProbeHelper, monkeypatch: pytest.MonkeyPatch
) -> None:
    many_attributes(tmp_path / "file.h5")
    for program in (str(tmp_path / "absent"), "/bin/true"):
        monkeypatch.setattr(sys, "executable", program)
        assert helper.survives(request(tmp_path / "file.h5"))


def test_where_even_a_sound_file_kills_nothing_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where the system's libraries do not stand a fork."""
    monkeypatch.setattr(probe_child, "survives", lambda work, processor_s: False)
    assert probe_child._judge(request(tmp_path / "file.h5")) == probe_child.USELESS
    monkeypatch.setattr(ProbeHelper, "_ask", lambda self, line: probe_child.USELESS)
    assert ProbeHelper().survives(request(tmp_path / "file.h5"))


def test_a_fork_has_a_helper_of_its_own(tmp_path: Path, helper: ProbeHelper) -> None:
    many_attributes(tmp_path / "file.h5")
    assert helper.survives(request(tmp_path / "file.h5"))
    pipes = helper._process
    helper.forget()  # as in a fork, whose copies of the pipes it closes
    assert pipes is not None and pipes.stdin is not None and pipes.stdin.closed
    os.waitpid(pipes.pid, 0)
    assert helper.survives(request(tmp_path / "file.h5")) and pid_of(helper) != pipes.pid


def test_a_process_with_threads_opens_a_file_and_leaves_no_helper(tmp_path: Path) -> None:
    many_attributes(tmp_path / "file.h5")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", WITH_A_THREAD, str(tmp_path / "file.h5")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    with pytest.raises(ProcessLookupError):
        os.kill(int(done.stdout), 0)


def test_a_file_that_came_through_is_tried_again_after_a_change(tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    many_attributes(path)
    Hdf5File(path).close()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(probe, "survives", lambda *_, **__: pytest.fail("it was tried again"))
        Hdf5File(path).close()
    with h5py.File(path, "r+") as file:
        file.attrs["more"] = 1
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(probe, "survives", lambda *_, **__: False)
        with pytest.raises(SessionError, match=DIES):
            Hdf5File(path)


def test_hard_links_in_a_circle_are_walked_once(tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    with h5py.File(path, "w", libver=LIBVER) as file:
        file["group/up"] = file["/"]
    with Hdf5File(path) as opened:
        assert opened.members("/group") == ["up"]


def test_a_group_that_cannot_be_listed_kills_the_helper_and_not_this_process(
    tmp_path: Path,
) -> None:
    """HDF5 refuses to list the group, and dies of a name that is looked up in it."""
    path = tmp_path / "part-0001.h5"
    path.write_bytes(gzip.decompress((DATA / "unlisted_group.h5.gz").read_bytes()))
    with pytest.raises(SessionError, match=DIES):
        Hdf5File(path)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no fork")
def test_a_helper_that_was_started_before_reads_the_first_file(tmp_path: Path) -> None:
    path = tmp_path / "sound.h5"
    many_attributes(path)
    helper = ProbeHelper()
    helper.start()
    started = helper._process
    helper.start()
    assert started is not None and helper._process is started
    assert helper.survives(request(path)) and helper._process is started
    helper.close()
    helper.start()
    assert helper._process is not None
    os.kill(helper._process.pid, signal.SIGKILL)
    assert helper.survives(request(path)), "one that died before its first file is replaced"
    helper.close()
