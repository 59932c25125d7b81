"""NumPy files from a stranger are refused before they get memory."""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from rigctl.errors import WrongUse
from rigctl.session.files.numpy_file import read_numpy

ROWS = np.arange(12.0).reshape(4, 3)


def header(shape: str, descr: str = "'<f8'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}}}\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def test_arrays_and_archives_are_read(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", ROWS)
    np.savez_compressed(tmp_path / "a.npz", x=ROWS, y=ROWS.T)
    np.save(tmp_path / "table.npy", np.array([(1, 2.0)], [("é", "i4"), ("b", "f8")]))
    np.testing.assert_array_equal(read_numpy(tmp_path / "a.npy")[""], ROWS)
    arrays = read_numpy(tmp_path / "a.npz")
    assert list(arrays) == ["x", "y"]
    np.testing.assert_array_equal(arrays["y"], ROWS.T)
    assert read_numpy(tmp_path / "table.npy")[""].dtype.names == ("é", "b")


@pytest.mark.parametrize(
    "content",
    [
        header("(1000000000000, 3)") + ROWS.tobytes(),
        header("(-1, 3)") + ROWS.tobytes(),
        header("(4611686018427387904, 4)") + ROWS.tobytes(),
        header("(1000000000000,)", "'V0'"),
        header("(1,)", "'|O'") + b"\x80\x04N.",
        header("(1,)", "[('a', '|O')]") + b"\x80\x04N.",
        header("(" * 9_000),
        header("(4, 3)") + ROWS.tobytes()[:-1],
        b"\x93NUMPY",
        b"",
        b"PK\x03\x04 no archive",
    ],
)
def test_impossible_headers_are_refused_in_a_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.npy"
    path.write_bytes(content)
    with pytest.raises(WrongUse, match="is not a NumPy file of plain numbers") as caught:
        read_numpy(path)
    assert len(str(caught.value)) < 400


def test_an_archive_that_unpacks_to_much_more_than_its_size_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", header("(37500000,)") + bytes(300_000_000))
    with pytest.raises(WrongUse, match="1 arrays of 3000"):
        read_numpy(path)


def test_a_member_that_claims_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    content = io.BytesIO()
    np.savez(content, x=ROWS)
    damaged = bytearray(content.getvalue())
    at = damaged.index(b"(4, 3)")
    damaged[at : at + 6] = b"(9, 9)"
    path = tmp_path / "a.npz"
    path.write_bytes(damaged)
    with pytest.raises(WrongUse, match="is not a NumPy file"):
        read_numpy(path)


def test_a_pipe_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.npy")
    with pytest.raises(WrongUse, match="it is a pipe"):
        read_numpy(tmp_path / "a.npy")
