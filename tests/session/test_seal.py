"""A model or a file of spikes that changed after it was made is refused."""

from __future__ import annotations

from pathlib import Path

import h5py
import pytest

from rigctl.errors import SessionError
from rigctl.session.files.seal import SEAL_BYTES, SEALED
from tests.fuzz.kind import Kind
from tests.fuzz.kinds.analysis import ANALYSIS_KINDS, FILE

SEALED_KINDS = [kind for kind in ANALYSIS_KINDS if kind.name != "cache-entry"]


@pytest.mark.parametrize("kind", SEALED_KINDS, ids=lambda kind: kind.name)
def test_every_altered_byte_is_noticed(tmp_path: Path, kind: Kind) -> None:
    kind.build(tmp_path)
    path = tmp_path / FILE
    whole = path.read_bytes()
    for at in range(0, len(whole), len(whole) // 6):
        data = bytearray(whole)
        data[at] ^= 1
        path.write_bytes(data)
        with pytest.raises(SessionError, match="damaged"):
            kind.doors[0](tmp_path)
    path.write_bytes(whole[:-SEAL_BYTES])
    with pytest.raises(SessionError, match="damaged: its bytes are not those"):
        kind.doors[0](tmp_path)


@pytest.mark.parametrize("kind", SEALED_KINDS, ids=lambda kind: kind.name)
def test_a_file_from_before_there_were_seals_is_read(tmp_path: Path, kind: Kind) -> None:
    kind.build(tmp_path)
    said = repr(kind.doors[0](tmp_path))
    with h5py.File(tmp_path / FILE, "r+") as file:
        del file.attrs[SEALED]
    assert repr(kind.doors[0](tmp_path)) == said


def test_a_change_by_another_program_is_noticed(tmp_path: Path) -> None:
    kind = SEALED_KINDS[0]
    kind.build(tmp_path)
    with h5py.File(tmp_path / FILE, "r+") as file:
        file["pca/mean"][0] += 1e-9
    with pytest.raises(SessionError, match="damaged: its bytes are not those"):
        kind.doors[0](tmp_path)
