"""Damage to HDF5 files by HDF5 itself: each file stays valid and is no longer what it should be."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np

from tests.fuzz.kind import Mutation
from tests.fuzz.mutations.bytes import BYTES

SENTINEL = "outside/secret.bin"
"""A file outside the case's folder, relative to its parent, which nothing may read or write."""
ODD_NAMES = ("../../x", "/etc/passwd", "a\0b", "\x1b[2J", "\u202etxt", "x" * 300, "")
ODD_NUMBERS = (0, -1, 1, 2**31 - 1, 2**31, 2**62, -(2**63), 1e308, float("nan"), float("inf"))

_MOST_ROWS = 2**20
"""Only these rows are changed, and none of more bytes: HDF5 keeps no more than 2³² chunks, and a
write behind them harms this process."""

Change = Callable[[Random, Any], str]


def on_hdf5(change: Change) -> Mutation:
    """Return a change of an open file as a mutation of the file (NEEDS_WHOLE_FILE)."""

    def change_whole_file(random: Random, path: Path) -> str:
        try:
            with h5py.File(path, "r+", libver=("v110", "v110")) as file:
                return change(random, file)
        except (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError) as error:
            return f"{change.__name__} was not possible: {error}"

    return change_whole_file


def remove_attribute(random: Random, file: Any) -> str:
    """Remove an attribute."""
    node = _node(random, file)
    names = list(node.attrs)
    if not names:
        return "no attribute to remove"
    name = random.choice(names)
    del node.attrs[name]
    return f"attribute {name} of {node.name} removed"


def replace_attribute(random: Random, file: Any) -> str:
    """Give an attribute another type or another value."""
    node = _node(random, file)
    names = list(node.attrs)
    if not names:
        return "no attribute to replace"
    name = random.choice(names)
    values: list[Any] = [
        *(random.choice(ODD_NUMBERS), random.choice(ODD_NUMBERS), ""),
        *(random.choice(ODD_NAMES).replace("\0", ""), b"\xff\xfe", "é", "[" * 5000, '{"a": 1}'),
        *(np.zeros(0), np.zeros((2, 3)), np.array([b"a", b"b"]), h5py.Empty("f"), file.ref),
        *("[null]", '[{"name": 1}]', "NaN", "[1e999]", "1" * 5000),
    ]
    value = random.choice(values)
    node.attrs[name] = value
    return f"attribute {name} of {node.name} is {value!r:.60}"


def remove_node(random: Random, file: Any) -> str:
    """Remove a data set or a group."""
    node = _node(random, file, root=False)
    name = node.name
    del file[name]
    return f"{name} removed"


def replace_by_group(random: Random, file: Any) -> str:
    """Put a group in the place of a data set."""
    name = _node(random, file, root=False).name
    del file[name]
    file.create_group(name)
    return f"{name} is a group"


def replace_by_type(random: Random, file: Any) -> str:
    """Put a named type in the place of a data set."""
    name = _node(random, file, root=False).name
    del file[name]
    file[name] = np.dtype("f8")
    return f"{name} is a type"


def link(random: Random, file: Any) -> str:
    """Put a soft or external link in the place of a data set: to itself, elsewhere, outside."""
    name = _node(random, file, root=False).name
    outside = str(Path(file.filename).resolve().parent.parent / SENTINEL)
    targets: list[Any] = [
        h5py.SoftLink(name),
        h5py.SoftLink("/nowhere"),
        h5py.SoftLink("/"),
        h5py.SoftLink(random.choice(list(file))),
        h5py.ExternalLink(outside, "/x"),
        h5py.ExternalLink(Path(file.filename).name, name),
    ]
    del file[name]
    file[name] = target = random.choice(targets)
    return f"{name} links to {target.path}"


def store_outside(random: Random, file: Any) -> str:
    """Store a data set's values in another file."""
    node = _data_set(random, file)
    name, shape, dtype = node.name, node.shape, node.dtype
    attributes = dict(node.attrs)
    del file[name]
    outside = str(Path(file.filename).resolve().parent.parent / SENTINEL)
    size = max(1, int(np.prod(shape)) * dtype.itemsize)
    new = file.create_dataset(name, shape, dtype, external=[(outside, 0, size)])
    new.attrs.update(attributes)
    return f"{name} is stored outside"


def make_virtual(random: Random, file: Any) -> str:
    """Make a data set a view of one in another file."""
    node = _data_set(random, file)
    name, shape, dtype = node.name, node.shape, node.dtype
    attributes = dict(node.attrs)
    del file[name]
    outside = str(Path(file.filename).resolve().parent.parent / SENTINEL)
    layout = h5py.VirtualLayout(shape, dtype)
    layout[...] = h5py.VirtualSource(outside, "x", shape)
    new = file.create_virtual_dataset(name, layout)
    new.attrs.update(attributes)
    return f"{name} is virtual"


def other_type(random: Random, file: Any) -> str:
    """Store a data set with another type."""
    node = _data_set(random, file)
    name, shape, attributes = node.name, node.shape, dict(node.attrs)
    types: list[Any] = [
        *("f4", ">f8", "i1", "u8", "S3", "c16", "?", "V7"),
        h5py.string_dtype(),
        h5py.vlen_dtype("i4"),
        h5py.ref_dtype,
        h5py.enum_dtype({"A": 1}, "i4"),
        np.dtype([("a", "i4"), ("b", h5py.string_dtype())]),
        np.dtype(("i4", (3,))),
    ]
    dtype = random.choice(types)
    chunks = tuple(max(1, n) for n in shape) if shape else None
    del file[name]
    new = file.create_dataset(name, shape, dtype, chunks=chunks)
    new.attrs.update(attributes)
    return f"{name} has the type {dtype}"


def other_columns(random: Random, file: Any) -> str:
    """Rename, drop, or retype a column of a table."""
    node = _data_set(random, file)
    if node.dtype.names is None:
        return other_type(random, file)
    rows, attributes, name = node[()], dict(node.attrs), node.name
    chosen = random.choice(node.dtype.names)
    done = random.choice(("dropped", "renamed", "f8", "S1", "i1", "subarray"))
    fields = []
    for column in node.dtype.names:
        kind: Any = node.dtype[column]
        if column == chosen and done == "dropped":
            continue
        if column == chosen and done in ("f8", "S1", "i1"):
            kind = done
        if column == chosen and done == "subarray":
            kind = ("i4", (2,))
        fields.append((column + "x" * (column == chosen and done == "renamed"), kind))
    new_rows = np.zeros(rows.shape, fields)
    for column in set(new_rows.dtype.names or ()) & set(node.dtype.names):
        if new_rows.dtype[column].kind == node.dtype[column].kind:
            new_rows[column] = rows[column]
    del file[name]
    new = file.create_dataset(name, data=new_rows, maxshape=(None,), chunks=True)
    new.attrs.update(attributes)
    return f"column {chosen} of {name}: {done}"


def other_shape(random: Random, file: Any) -> str:
    """Give a data set another rank or another length, up to rows that no disk holds."""
    node = _data_set(random, file)
    name, dtype, attributes = node.name, node.dtype, dict(node.attrs)
    shapes: list[tuple[int, ...]] = [
        *((), (0,), (1,), (2**40,), (2**62,), (3, 0), (2, 3, 4), (2**31, 2**31)),
        (*node.shape, 1),
        node.shape[1:],
        tuple(n + 1 for n in node.shape),
        tuple(2**33 if axis == 0 else n for axis, n in enumerate(node.shape)),
    ]
    shape = random.choice(shapes)
    chunks = tuple(max(1, min(n, 16)) for n in shape) if shape else None
    if random.random() < 0.3 and node.chunks and len(shape) == len(node.shape):
        node.resize(shape)
        return f"{name} resized to {shape}"
    del file[name]
    new = file.create_dataset(name, shape, dtype, chunks=chunks)
    new.attrs.update(attributes)
    return f"{name} has the shape {shape}"


def change_values(random: Random, file: Any) -> str:
    """Change a few values."""
    node = _data_set(random, file)
    if not node.shape or not node.shape[0] or h5py.check_ref_dtype(node.dtype):
        return change_scalar(random, node)
    if node.dtype.itemsize * math.prod(node.shape[1:]) > _MOST_ROWS:
        return f"a row of {node.name} is too long to change"
    row = random.randrange(min(node.shape[0], _MOST_ROWS))
    raw = bytearray(np.asarray(node[row]).tobytes())
    at = random.randrange(len(raw))
    size = random.choice((1, 4, 8))
    raw[at : at + size] = random.choice((b"\xff", b"\0", b"\x7f", random.randbytes(1))) * min(
        size, len(raw) - at
    )
    node[row] = np.frombuffer(bytes(raw), node.dtype).reshape(node.shape[1:])
    return f"row {row} of {node.name}: bytes {at} to {at + size} changed"


def change_scalar(random: Random, node: Any) -> str:
    """Change a single value."""
    if node.shape:
        return f"{node.name} has no value"
    raw = bytearray(np.asarray(node[()]).tobytes())
    at = random.randrange(len(raw))
    raw[at] ^= 1 << random.randrange(8)
    node[()] = np.frombuffer(bytes(raw), node.dtype)[0]
    return f"{node.name}: byte {at} changed"


MOST_ROWS = 1 << 20
"""HDF5 2.0 cannot write far behind the rows that exist: it fails later, when it lets go of them."""


def exchange_rows(random: Random, file: Any) -> str:
    """Exchange, repeat or drop rows of a data set."""
    node = _data_set(random, file)
    if not node.shape or node.shape[0] < 2:
        return f"{node.name} has too few rows"
    if node.shape[0] > MOST_ROWS:
        return f"{node.name} has too many rows"
    a, b = random.sample(range(node.shape[0]), 2)
    first, second = node[a], node[b]
    how = random.choice(("exchanged", "repeated", "dropped"))
    if how == "dropped":
        node.resize(node.shape[0] - 1, axis=0)
        return f"last row of {node.name} dropped"
    node[a] = second
    if how == "exchanged":
        node[b] = first
    return f"rows {a} and {b} of {node.name} {how}"


def add_node(random: Random, file: Any) -> str:
    """Add something that no layout has."""
    name = random.choice(("extra", "\x1b[31mred", "x" * 5000, "é\u202e"))
    kind = random.randrange(3)
    if kind == 0:
        file.create_dataset(name, (2**40,), "f8", chunks=(1024,))
    elif kind == 1:
        file.create_group(name)
    else:
        file.attrs[name] = "\x1b]0;title\x07"
    return f"{name!r:.40} added"


def _node(random: Random, file: Any, root: bool = True) -> Any:
    names: list[str] = []
    file.visit(names.append)
    return random.choice(
        ([file] * (1 + len(names) // 3) if root else []) + [file[n] for n in names]
    )


def _data_set(random: Random, file: Any) -> Any:
    found: list[Any] = []
    file.visititems(lambda _, node: found.append(node) if isinstance(node, h5py.Dataset) else None)
    return random.choice(found)


CHANGES: tuple[Change, ...] = (
    *(remove_attribute, replace_attribute, replace_attribute, remove_node, replace_by_group),
    *(replace_by_type, link, store_outside, make_virtual, other_type, other_columns),
    *(other_shape, change_values, change_values, exchange_rows, add_node),
)
HDF5: tuple[Mutation, ...] = (*BYTES, *map(on_hdf5, CHANGES))
