"""Metadata that kills HDF5, with its checksums right, kills a child process and not this one."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import pytest

from rigctl.errors import SessionError
from rigctl.session.format.data_sets import LIBVER
from rigctl.session.hdf5 import probe
from rigctl.session.hdf5.hdf5_file import Hdf5File
from tests.fuzz.mutations.checksums import find_blocks, repair

B_TREE = b"BTHD"
DIES = "dies of it"


def many_attributes(path: Path) -> bytes:
    """Write a file with so many attributes that HDF5 finds them through a B-tree."""
    with h5py.File(path, "w", libver=LIBVER) as file:
        for number in range(20):
            file.attrs[f"attribute {number}"] = number
    return path.read_bytes()


def test_no_byte_of_a_b_tree_ends_the_process(tmp_path: Path) -> None:
    path, refusals = tmp_path / "file.h5", []
    whole = many_attributes(path)
    block = next(b for b in find_blocks(whole) if whole[b.start : b.start + 4] == B_TREE)
    for at in range(block.start + 4, block.checksum):
        data = bytearray(whole)
        data[at] ^= 0x55
        repair(data, block)
        path.write_bytes(data)
        try:
            with Hdf5File(path) as file:
                file.attributes()
        except SessionError as error:
            refusals.append(str(error))
    assert len(refusals) > 5 and all(str(path) in text for text in refusals)
    assert any(DIES in text for text in refusals)


def test_a_file_that_came_through_is_tried_again_after_a_change(tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    many_attributes(path)
    Hdf5File(path).close()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fork", lambda: pytest.fail("a known file was tried again"))
        Hdf5File(path).close()
    with h5py.File(path, "r+") as file:
        file.attrs["more"] = 1
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(probe, "survives", lambda work, processor_s: False)
        with pytest.raises(SessionError, match=DIES):
            Hdf5File(path)


def test_hard_links_in_a_circle_are_walked_once(tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    with h5py.File(path, "w", libver=LIBVER) as file:
        file["group/up"] = file["/"]
    with Hdf5File(path) as opened:
        assert opened.members("/group") == ["up"]
