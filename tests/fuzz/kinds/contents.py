"""What HDF5 files say: every value, type, shape and attribute, by path."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np


def hdf5_content(path: Path) -> dict[str, str]:
    """Return a digest of each data set and each attribute of a file, by its path."""
    found: dict[str, str] = {}
    with h5py.File(path, "r") as file:
        _add(found, "/", file)
        file.visititems(lambda name, node: _add(found, f"/{name}", node))
    return found


def folder_content(folder: Path, hdf5: str = "*.h5") -> dict[str, str]:
    """Return the content of all HDF5 files of a folder, and the digest of each other file."""
    found = {}
    for path in sorted(folder.iterdir()):
        if path.match(hdf5):
            found.update({f"{path.name}{k}": v for k, v in hdf5_content(path).items()})
        elif path.is_file():
            found[path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def _add(found: dict[str, str], name: str, node: Any) -> None:
    for key, value in node.attrs.items():
        found[f"{name}@{key}"] = f"{np.asarray(value).dtype} {value!r}"
    if isinstance(node, h5py.Dataset):
        digest = hashlib.sha256(np.asarray(node[()]).tobytes()).hexdigest()
        found[name] = f"{node.dtype} {node.shape} {digest}"
