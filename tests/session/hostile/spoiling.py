"""Make each kind of hostile HDF5 file out of a good one by changing one data set."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rigctl.session.layout import LIBVER

Spoil = Callable[[Any, str, Any], None]
"""Takes an open file, a path and the data set that was there; puts another object there."""
SECRET = b"root:x:0:0:a secret of this computer\n" * 5_000
MANY = 1 << 40


def spoil(file: Path, path: str, change: Spoil) -> None:
    """Replace the data set ``path`` by what ``change`` makes of it."""
    shutil.copy(file, file.with_name("other.h5"))
    with h5py.File(file, "r+", libver=LIBVER) as opened:
        original = opened[path]
        del opened[path]
        change(opened, path, original)


def _nothing(file: Any, path: str, was: Any) -> None:
    pass


def _group(file: Any, path: str, was: Any) -> None:
    file.create_group(path)


def _link_to_itself(file: Any, path: str, was: Any) -> None:
    file[path] = h5py.SoftLink(path)


def _soft_link(file: Any, path: str, was: Any) -> None:
    file["elsewhere"] = was
    file[path] = h5py.SoftLink("/elsewhere")


def _external_link(file: Any, path: str, was: Any) -> None:
    file[path] = h5py.ExternalLink(_other_file(file), path)


def _external_storage(file: Any, path: str, was: Any) -> None:
    secret = Path(file.filename).with_name("secret")
    secret.write_bytes(SECRET)
    plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plan.set_external(str(secret).encode(), 0, max(1, was.size) * was.dtype.itemsize)
    shape = tuple(max(1, n) for n in was.shape)
    space = h5py.h5s.create_simple(shape) if shape else h5py.h5s.create(h5py.h5s.SCALAR)
    h5py.h5d.create(file.id, path.encode(), was.id.get_type(), space, plan)


def _virtual(file: Any, path: str, was: Any) -> None:
    shape = tuple(max(1, n) for n in was.shape)
    layout = h5py.VirtualLayout(shape, was.dtype)
    layout[...] = h5py.VirtualSource(_other_file(file), path, shape)
    file.create_virtual_dataset(path, layout)


def _another_rank(file: Any, path: str, was: Any) -> None:
    file.create_dataset(path, (1, *was.shape), was.dtype)


def _no_value(file: Any, path: str, was: Any) -> None:
    file[path] = h5py.Empty(was.dtype)


def _texts_of_any_length(file: Any, path: str, was: Any) -> None:
    file.create_dataset(path, was.shape, h5py.string_dtype())


def _columns_of_any_length(file: Any, path: str, was: Any) -> None:
    names = was.dtype.names or ("value",)
    columns = [(name, h5py.string_dtype()) for name in names]
    file.create_dataset(path, was.shape, np.dtype(columns))


def _references(file: Any, path: str, was: Any) -> None:
    file.create_dataset(path, was.shape, h5py.ref_dtype)


def _opaque(file: Any, path: str, was: Any) -> None:
    file.create_dataset(path, was.shape, np.dtype("V16"))


def _rows_in_rows(file: Any, path: str, was: Any) -> None:
    file.create_dataset(path, was.shape, np.dtype([("inner", [("a", "i4")]), ("b", "f4", (3,))]))


def _too_many_rows(file: Any, path: str, was: Any) -> None:
    tail = was.shape[1:]
    chunks = (1024, *tail) if was.shape else None
    shape = (MANY, *tail) if was.shape else (MANY,)
    file.create_dataset(path, shape, was.dtype, chunks=chunks)


HOSTILE: dict[str, Spoil] = {
    "missing": _nothing,
    "a group": _group,
    "a soft link to itself": _link_to_itself,
    "a soft link": _soft_link,
    "an external link": _external_link,
    "external storage": _external_storage,
    "a virtual data set": _virtual,
    "another rank": _another_rank,
    "no value": _no_value,
    "texts of any length": _texts_of_any_length,
    "columns of any length": _columns_of_any_length,
    "references": _references,
    "opaque bytes": _opaque,
    "rows in rows": _rows_in_rows,
    "2^40 rows": _too_many_rows,
}
"""Changes by name."""


def _other_file(file: Any) -> str:
    """Return a whole file, so that what a link leads to would be accepted."""
    return str(Path(file.filename).with_name("other.h5"))
