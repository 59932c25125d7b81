"""Read and write HDF5: data sets as declared, and each of HDF5's errors as one sentence.

A file may come from anywhere. Its data sets are read after a check of place, type, shape and size;
what lies in another file is not read.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from math import prod
from mmap import mmap
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar
from uuid import uuid4

import h5py
import numpy as np
from h5py import h5d, h5g, h5l, h5o, h5s, h5t
from numpy.typing import NDArray

from rigctl.config.text_file import open_file
from rigctl.errors import SessionError
from rigctl.session.writer_lock import NO_LOCKS

Attributes = dict[str, str | int | float]
T = TypeVar("T")

HDF5_ERRORS = (
    OSError,
    RuntimeError,
    KeyError,
    ValueError,
    TypeError,
    IndexError,
    OverflowError,
    MemoryError,
)
"""h5py chooses one of these by HDF5's own error number; damage can cause any."""
NUMBERS = "biuf"
"""NumPy's kinds of plain numbers: Booleans, signed and unsigned integers, floating point."""
TEXT = "S"
"""NumPy's kind of text of fixed length."""
DEFLATE_RATIO = 1032
"""Deflate cannot expand more than this."""
SHOWN_ERROR = 160
SHOWN_PLACE = 100
MOST_DIGITS = 20
"""Longer integers fit no value of a session, and some take minutes to print."""
_ERRNO = re.compile(r"errno = (\d+)")
_JSON_NAMES: Mapping[type, str] = {dict: "an object", list: "a list"}


class UnclosedFile(SessionError):
    """A file that a writer has open, or had open when it was killed."""


def damage(path: Path, place: str, what: str) -> SessionError:
    """Return the error for a place that is not as declared; ``what`` follows the place."""
    return SessionError(f"{path} is damaged: {shorten(place, SHOWN_PLACE)} {what}")


@contextmanager
def hdf5_errors(path: Path, place: str) -> Iterator[None]:
    """Raise SessionError for all that a call of h5py raises; hold nothing but that call."""
    try:
        yield
    except HDF5_ERRORS as error:
        raise SessionError(
            f"{path} is damaged: HDF5 cannot read {shorten(place, SHOWN_PLACE)}: {describe(error)}"
        ) from error


def system_error(error: BaseException) -> int:
    """Return the system's number of an error, which HDF5 puts into its text; 0 without one."""
    if found := _ERRNO.search(str(error)):
        return int(found[1])
    return (error.errno or 0) if isinstance(error, OSError) else 0


def system_reason(error: BaseException) -> str:
    """Return the system's words for an error, the error's own without a number."""
    code = system_error(error)
    return os.strerror(code) if code else describe(error)


def describe(error: BaseException) -> str:
    """Return an outside library's error as one short line."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    line = " ".join(text.split()) or type(error).__name__
    return shorten(line, SHOWN_ERROR)


def shorten(text: str, length: int) -> str:
    """Return a text of a file in at most ``length`` letters, control characters as ``?``.

    ``…`` stands for what is left out.
    """
    shown = "".join(letter if letter.isprintable() else "?" for letter in text[: length + 1])
    return shown if len(shown) <= length else f"{shown[: length - 1]}…"


def parse_json(text: str, wanted: type[T], path: Path, place: str) -> T:
    """Return the value of a JSON text in a file, a ``list`` or a ``dict``.

    Raises SessionError for another type, for text that is not JSON, is nested too deep to parse,
    or contains an integer of more than ``MOST_DIGITS`` digits.
    """
    try:
        value = json.loads(text, parse_int=_parse_int)
    except (ValueError, RecursionError) as error:
        raise damage(path, place, f"is not JSON: {describe(error)}") from error
    if not isinstance(value, wanted):
        raise damage(path, place, f"should be {_JSON_NAMES.get(wanted, wanted.__name__)} in JSON")
    return value


def parse_objects(text: str, path: Path, place: str) -> tuple[dict[str, Any], ...]:
    """Return the objects of a JSON list. Raises SessionError as :func:`parse_json` does."""
    items = parse_json(text, list, path, place)
    if not all(isinstance(item, dict) for item in items):
        raise damage(path, place, "should be a list of objects in JSON")
    return tuple(items)


def _parse_int(digits: str) -> int:
    if len(digits.lstrip("-")) > MOST_DIGITS:
        raise ValueError(f"an integer has {len(digits)} digits")
    return int(digits)


@dataclass(frozen=True, slots=True)
class DataSetSchema:
    """An expected data set.

    ``tail`` has the lengths of all axes but the first; None stands for any lengths. A ``rank`` of 0
    is a single value. ``dtype`` is the exact type, but for columns that are ``optional``; without
    one, ``kinds`` lists NumPy's kinds that are accepted.
    """

    path: str
    rank: int = 0
    kinds: str = NUMBERS
    dtype: np.dtype[Any] | None = None
    tail: tuple[int, ...] | None = None
    optional: frozenset[str] = frozenset()


def text(path: str) -> DataSetSchema:
    """Return the schema of one text."""
    return DataSetSchema(path, 0, TEXT)


class Hdf5File:
    """A file open for reading; use it in a ``with`` block, or close it.

    Only hard links are followed. Rows are read of data sets that :meth:`check` has accepted; what
    is read whole is checked by the way.
    ``swmr``: follow a living writer. ``image``: bytes to read in place of the file's, which
    its writer did not close, so that its end may be missing. Every method raises SessionError that
    names the file and the place for whatever is damaged.
    """

    def __init__(
        self, path: Path, *, swmr: bool = False, image: mmap | None = None, **options: Any
    ) -> None:
        self.path = path
        with open_file(path, SessionError) as file:  # HDF5 would wait for the writer of a pipe
            self.file_bytes = os.fstat(file.fileno()).st_size
        self.is_growing = swmr
        self.is_cut = image is not None
        self._datasets: dict[str, _DataSet] = {}
        self._groups: dict[str, h5py.Group] = {}
        self._root_attributes: dict[str, Any] | None = None
        with hdf5_errors(path, "it"), _tell_unclosed(path):
            self._file = _open_to_read(image or path, swmr=swmr, **options)

    def leave(self) -> None:
        """Let go of all that is open in the file, before it is closed."""
        self._datasets.clear()
        self._groups.clear()

    def close(self) -> None:
        """Close the file."""
        self.leave()
        with suppress(RuntimeError):  # HDF5 cannot close what is damaged; it was refused before
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def h5py_file(self) -> h5py.File:
        """The open file itself."""
        return self._file

    def check(self, schemas: Iterable[DataSetSchema]) -> None:
        """Check data sets against what is declared; from now on they can be read."""
        for schema in schemas:
            node = self._find(schema.path)
            if not isinstance(node, h5d.DatasetID):
                what = "is missing" if node is None else "is not a data set"
                raise damage(self.path, schema.path, what)
            self._datasets[schema.path] = self._check_dataset(node, schema)

    def has(self, path: str) -> bool:
        """Return whether there is a group or a data set of this path."""
        return self._find(path) is not None

    def members(self, path: str) -> list[str]:
        """Return the names in a group, sorted; empty where there is no such group."""
        group = self._find(path)
        with hdf5_errors(self.path, path):
            return sorted(group) if isinstance(group, h5py.Group) else []

    def attributes(self, path: str = "/") -> dict[str, Any]:
        """Return the attributes of the root or of a data set as Python's own types."""
        if path != "/":
            with hdf5_errors(self.path, f"the attributes of {path}"):
                return read_attributes(h5py.Dataset(self._datasets[path].id))
        if self._root_attributes is None:
            with hdf5_errors(self.path, "the attributes of the file"):
                self._root_attributes = read_attributes(self._file)
        return dict(self._root_attributes)

    def shape(self, path: str) -> tuple[int, ...]:
        """Return the shape of a data set."""
        return self._datasets[path].shape

    def dtype(self, path: str) -> np.dtype[Any]:
        """Return the stored type of a data set."""
        return self._datasets[path].dtype

    def rows(self, path: str, start: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Return rows [start, stop) as stored."""
        with hdf5_errors(self.path, path):
            return _read_rows(self._datasets[path].id, self.dtype(path), start, stop)

    def row(self, path: str, index: int) -> Any:
        """Return one row as stored."""
        return self.rows(path, index, index + 1)[0]

    def array(self, path: str, rank: int, dtype: Any = np.float64) -> NDArray[Any]:
        """Return all values in C order as ``dtype``; an integer one must hold them exactly."""
        stored = self._value(DataSetSchema(path, rank))
        with np.errstate(invalid="ignore", over="ignore"):
            values = np.ascontiguousarray(stored, dtype=dtype).reshape(np.shape(stored))
        if np.dtype(dtype).kind in "iu" and not np.array_equal(values, stored):
            raise damage(self.path, path, f"has values that are no {np.dtype(dtype).name}")
        return values

    def number(self, path: str) -> float:
        """Return a single finite number."""
        value = float(self._value(DataSetSchema(path)))
        if not np.isfinite(value):
            raise damage(self.path, path, f"is {value}, not a number")
        return value

    def integer(self, path: str) -> int:
        """Return a single integer."""
        value = self.number(path)
        if value != int(value):
            raise damage(self.path, path, f"is {value}, not a whole number")
        return int(self._value(DataSetSchema(path)))

    def text(self, path: str) -> str:
        """Return one text."""
        value = bytes(self._value(text(path)))
        with hdf5_errors(self.path, path):
            return value.decode()

    def texts(self, path: str) -> tuple[str, ...]:
        """Return several texts."""
        values = self._value(DataSetSchema(path, 1, TEXT))
        with hdf5_errors(self.path, path):
            return tuple(bytes(value).decode() for value in values)

    def chunk_shape(self, path: str) -> tuple[int, ...]:
        """Return the shape of a data set's chunks, empty without any."""
        return self._datasets[path].chunk

    def chunk_addresses(self, path: str) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
        """Return the first row and the byte in the file of each chunk, int64.

        Chunks that the file does not hold to their end are left out. None where a filter or a
        growing file leaves the chunks to HDF5.
        """
        stored, chunk = self._datasets[path], self.chunk_shape(path)
        if self.is_growing or stored.is_filtered:
            return None
        chunks: list[Any] = []
        if chunk:
            with hdf5_errors(self.path, path):
                stored.id.chunk_iter(chunks.append)
        rows = np.array([each.chunk_offset[0] for each in chunks], np.uint64)
        starts = np.array([each.byte_offset for each in chunks], np.uint64)
        last_start = self.file_bytes - prod(chunk) * self.dtype(path).itemsize
        inside = starts <= max(last_start, 0)
        return rows[inside].astype(np.int64), starts[inside].astype(np.int64)

    def _value(self, schema: DataSetSchema) -> Any:
        """Return all that a data set holds, after it was checked."""
        if schema.path not in self._datasets:
            self.check([schema])
        with hdf5_errors(self.path, schema.path):
            return h5py.Dataset(self._datasets[schema.path].id)[()]

    def _find(self, path: str) -> Any:
        """Return the object that hard links lead to, None where a link is missing."""
        place = f"/{path.strip('/')}"
        if place in self._groups:
            return self._groups[place]
        above, _, name = place.rpartition("/")
        group = self._find(above) if above else self._file
        if not isinstance(group, h5py.Group):
            return None
        with hdf5_errors(self.path, place):
            if not group.id.links.exists(name.encode()):
                return None
            kind = group.id.links.get_info(name.encode()).type
        if kind != h5l.TYPE_HARD:
            raise damage(self.path, place, "is a link to another place, which may not be followed")
        with hdf5_errors(self.path, place):
            node = h5o.open(group.id, name.encode())
        if isinstance(node, h5g.GroupID):
            self._groups[place] = h5py.Group(node)
        return self._groups.get(place, node)

    def _check_dataset(self, node: h5d.DatasetID, schema: DataSetSchema) -> _DataSet:
        """Check place, type, shape and size, in this order, before the first read.

        The place comes first: HDF5 opens the sources of a virtual data set to know its shape.
        """
        with hdf5_errors(self.path, schema.path):
            plan = node.get_create_plist()
            layout, is_filtered = plan.get_layout(), bool(plan.get_nfilters())
            is_inside = layout != h5d.VIRTUAL and not plan.get_external_count()
        if not is_inside:
            what = "is stored outside the file, where nothing may be read"
            raise damage(self.path, schema.path, what)
        with hdf5_errors(self.path, schema.path):
            dtype = _found_type(node, schema)
            shape = node.shape
        if dtype is None:
            raise damage(self.path, schema.path, f"is not {_type_name(schema)}")
        tail = () if shape is None else shape[1:]
        if shape is None or schema.rank != len(shape) or schema.tail not in (None, tail):
            raise damage(self.path, schema.path, f"has shape {shape}, not {_shape_name(schema)}")
        # Later than the shape: a living writer lengthens the file before it claims the rows.
        file_bytes = self.path.stat().st_size
        chunk = plan.get_chunk() if layout == h5d.CHUNKED else ()
        n_bytes, spare = prod(shape) * dtype.itemsize, prod(chunk) * dtype.itemsize
        most = file_bytes * (DEFLATE_RATIO if is_filtered else 1) + spare
        if n_bytes > most and not self.is_cut:
            what = f"claims {n_bytes} bytes in a file of {file_bytes}"
            raise damage(self.path, schema.path, what)
        return _DataSet(node, dtype, shape, chunk, is_filtered)


class _DataSet(NamedTuple):
    """A checked data set. ``shape``: when it was checked; ``chunk``: empty without any."""

    id: h5d.DatasetID
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    chunk: tuple[int, ...]
    is_filtered: bool


def _read_rows(
    stored: h5d.DatasetID, dtype: np.dtype[Any], start: int, stop: int | None
) -> NDArray[Any]:
    """Read by HDF5's own calls: h5py translates a table's columns anew for each read."""
    n_rows, *tail = stored.shape
    first, end, _ = slice(start, stop).indices(n_rows)
    rows = np.empty((max(0, end - first), *tail), dtype)
    if rows.size:
        place = stored.get_space()
        place.select_hyperslab((first, *(0 for _ in tail)), rows.shape)
        stored.read(h5s.create_simple(rows.shape), place, rows, mtype=stored.get_type())
    return rows


def _open_to_read(file: Path | mmap, **options: Any) -> h5py.File:
    """Open a file; without its lock where the file system has none, as many network drives."""
    try:
        return h5py.File(file, "r", **options)
    except OSError as error:
        if system_error(error) not in NO_LOCKS:
            raise
        return h5py.File(file, "r", locking=False, **options)


@contextmanager
def _tell_unclosed(path: Path) -> Iterator[None]:
    """Raise UnclosedFile where HDF5 refuses a file because of its writer."""
    try:
        yield
    except OSError as error:
        if "already open" not in str(error):
            raise
        raise UnclosedFile(f"{path} was not closed by its writer, or is being written") from error


def _found_type(node: h5d.DatasetID, schema: DataSetSchema) -> np.dtype[Any] | None:
    """Return the type of a data set, None for another one than declared."""
    # HDF5 compares faster than h5py translates a table's columns.
    if schema.dtype is not None and node.get_type().equal(_stored_type(schema.dtype)):
        return schema.dtype
    found: np.dtype[Any] = node.dtype
    if schema.dtype is None:
        return found if found.kind in schema.kinds else None
    kept = [
        (name, schema.dtype[name])
        for name in schema.dtype.names or ()
        if name not in schema.optional or name in (found.names or ())
    ]
    return found if found in (schema.dtype, np.dtype(kept)) else None


@cache
def _stored_type(dtype: np.dtype[Any]) -> Any:
    return h5t.py_create(dtype, logical=True)


def _type_name(schema: DataSetSchema) -> str:
    if schema.dtype is None:
        return "text of fixed length" if schema.kinds == TEXT else "plain numbers"
    table = "a table of its layout's columns: read an older one with the rigctl that wrote it"
    return table if schema.dtype.names else f"of type {schema.dtype}"


def _shape_name(schema: DataSetSchema) -> str:
    axes = ["n"] * schema.rank
    if schema.tail is not None:
        axes[1:] = map(str, schema.tail)
    return f"({', '.join(axes)})"


def open_image(image: bytes) -> h5py.File:
    """Open a copy of a file's bytes in memory, to read and to change it."""
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_fapl_core(backing_store=False)
    access.set_file_image(image)
    access.set_libver_bounds(h5py.h5f.LIBVER_V110, h5py.h5f.LIBVER_V110)
    # HDF5 knows files in memory by name, and two threads may each open one.
    return h5py.File(h5py.h5f.open(f"image {uuid4()}".encode(), h5py.h5f.ACC_RDWR, access))


def read_attributes(node: Any, names: Sequence[str] = ()) -> dict[str, Any]:
    """Return the attributes of a file, group or data set as Python's own types; all without names.

    Raises what h5py raises, and ValueError for what is no number, no text and no list of these.
    """
    stored = node.attrs  # for a file, each use of attrs opens its root anew
    # Not by items(): it holds h5py's lock until its end, and an error here leaves it without one.
    return {name: _to_python(name, stored[name]) for name in names or list(stored)}


def write_attributes(node: Any, attributes: Attributes) -> None:
    """Write attributes; text becomes fixed-length UTF-8."""
    for name, value in attributes.items():
        node.attrs.create(name, text_scalar(value) if isinstance(value, str) else value)


def text_scalar(text: str) -> NDArray[np.bytes_]:
    """Return ``text`` as a zero-dimensional fixed-length string that HDF5 marks as UTF-8."""
    data = text.encode()
    return np.array(data, dtype=h5py.string_dtype("utf-8", max(1, len(data))))


def write_array(
    group: Any, name: str, values: NDArray[Any] | float, unit: str, doc: str, shape: str = ""
) -> None:
    """Write numbers; ``shape`` names the axes, empty for a single value."""
    attributes: Attributes = {
        "unit": unit or "none",
        "doc": doc,
        "shape": f"({shape})" if shape else "()",
    }
    write_attributes(group.create_dataset(name, data=values), attributes)


def write_text(group: Any, name: str, text: str, doc: str) -> None:
    """Write one text, UTF-8 of fixed length."""
    dataset = group.create_dataset(name, data=text_scalar(text))
    write_attributes(dataset, {"doc": doc, "shape": "()"})


def write_texts(group: Any, name: str, texts: Sequence[str], doc: str, shape: str) -> None:
    """Write several texts, UTF-8 of one fixed length."""
    encoded = [text.encode() for text in texts]
    width = max([1, *map(len, encoded)])
    array = np.array(encoded, dtype=h5py.string_dtype("utf-8", width))
    dataset = group.create_dataset(name, data=array)
    write_attributes(dataset, {"doc": doc, "shape": f"({shape})"})


def read_text(group: Any, name: str) -> str:
    """Return one stored text. Raises KeyError where there is none."""
    return bytes(group[name][()]).decode()


def _to_python(name: str, value: Any) -> Any:
    if isinstance(value, np.bytes_ | bytes):
        return value.decode().rstrip("\0")
    if isinstance(value, np.ndarray) and value.ndim == 1:
        return [_to_python(name, item) for item in value]
    plain = value.item() if isinstance(value, np.generic) else value
    if not isinstance(plain, str | int | float):
        raise ValueError(f"{name} is neither a number nor a text")
    return plain
