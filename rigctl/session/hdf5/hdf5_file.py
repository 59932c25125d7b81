"""Open an HDF5 file that nobody has to trust, and read what its schema declares."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from math import prod
from mmap import mmap
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from h5py import h5d, h5g, h5l
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.hdf5.attributes import read_attribute, read_attributes
from rigctl.session.hdf5.errors import damage, hdf5_errors
from rigctl.session.hdf5.plain_file import plain_file_size
from rigctl.session.hdf5.probe import check_survivable
from rigctl.session.hdf5.schema import DataSetSchema
from rigctl.session.hdf5.storage import CheckedDataSet, check_dataset, check_size

ROOT = "/"
MOST_MEMBERS = MOST_TEXTS = 10_000
MOST_REFERENCES = 100_000
DEEPEST = 4
"""Groups in groups that rigctl writes are fewer."""
READ_BYTES = 256 << 20
"""A read may need this much memory, or twice the size of the file."""


class UnclosedFile(SessionError):
    """A file that a writer has open, or had open when it was killed."""


class Hdf5File:
    """A file open for reading; use it in a ``with`` block, or close it.

    Only hard links are followed, and only data sets that :meth:`check` has accepted can be read.
    ``swmr``: follow a living writer. ``image``: bytes to read in place of the file's, which
    its writer did not close, so that its end may be missing. Every method raises SessionError that
    names the file and the place for whatever is damaged.
    """

    def __init__(
        self,
        path: Path,
        *,
        swmr: bool = False,
        image: mmap | None = None,
        **options: Any,
    ) -> None:
        self.path = path
        self.file_bytes = plain_file_size(path)
        self._is_cut = image is not None
        self._datasets: dict[str, CheckedDataSet] = {}
        self._root_attributes: dict[str, Any] | None = None
        if not swmr:
            check_survivable(path, image, options)
        with hdf5_errors(path, "it"), _tell_unclosed(path):
            self._file = h5py.File(image or path, "r", swmr=swmr, **options)
        self._nodes: dict[str, Any] = {}
        try:
            with hdf5_errors(path, "its root"):
                self._nodes[ROOT] = h5g.open(self._file.id, b"/")
        except SessionError:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._nodes.clear()
        self._datasets.clear()
        with suppress(RuntimeError):  # HDF5 cannot close what is damaged; it was refused before
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_growing(self) -> bool:
        """Whether it was opened to follow a living writer."""
        return bool(self._file.id.get_intent() & h5py.h5f.ACC_SWMR_READ)

    @property
    def is_cut(self) -> bool:
        """Whether its end may be missing: its writer did not close it."""
        return self._is_cut

    def check(self, schemas: Iterable[DataSetSchema]) -> None:
        """Check data sets against what is declared; from now on they can be read."""
        for schema in schemas:
            node = self._find(schema.path)
            if node is None and schema.optional:
                continue
            if not isinstance(node, h5d.DatasetID):
                what = "is missing" if node is None else "is not a data set"
                raise damage(self.path, schema.path, what)
            checked = check_dataset(node, schema, self.path)
            # Later than the shape: a living writer lengthens the file before it claims the rows.
            file_bytes = self.path.stat().st_size
            check_size(checked, self.path, schema.path, file_bytes, self._is_cut)
            self._datasets[schema.path] = checked

    def is_checked(self, path: str) -> bool:
        """Return whether :meth:`check` found a data set of this path."""
        return path in self._datasets

    def has(self, path: str) -> bool:
        """Return whether there is a group or a data set of this path."""
        return self._find(path) is not None

    def is_group(self, path: str) -> bool:
        """Return whether there is a group of this path."""
        return isinstance(self._find(path), h5g.GroupID)

    def members(self, path: str) -> list[str]:
        """Return the names in a group, sorted; empty where there is no such group."""
        group = self._find(path)
        if not isinstance(group, h5g.GroupID):
            return []
        with hdf5_errors(self.path, path):
            if group.get_num_objs() <= MOST_MEMBERS:
                return sorted(name.decode() for name in group)
        raise damage(self.path, path, f"has more than {MOST_MEMBERS} members")

    def attributes(self, path: str = ROOT) -> dict[str, Any]:
        """Return the attributes of the root or of a data set as Python's own types."""
        if path != ROOT:
            return read_attributes(self._datasets[path].dataset.id, self.path, path)
        if self._root_attributes is None:
            self._root_attributes = read_attributes(self._nodes[ROOT], self.path, "the file")
        return dict(self._root_attributes)

    def attribute(self, path: str, name: str) -> Any:
        """Return one attribute of a data set, None without it; others may be of any type."""
        return read_attribute(self._datasets[path].dataset.id, name, self.path, path)

    def references(self, path: str) -> list[str]:
        """Return a path for each object that a data set of references leads to, columns first."""
        if prod(self.shape(path)) > MOST_REFERENCES:
            raise damage(self.path, path, f"has more than {MOST_REFERENCES} references")
        # A single reference is no array.
        references = np.asarray(self._value(path), dtype=object)
        targets = []
        with hdf5_errors(self.path, path):
            for number, reference in enumerate(references.T.ravel(), 1):
                target = f"{path}//{number}"
                self._nodes[target] = h5py.h5r.dereference(reference, self._file.id)
                targets.append(target)
        return targets

    def kind(self, path: str) -> str:
        """Return NumPy's kind of a data set, or that of :mod:`rigctl.session.hdf5.schema`."""
        return self._datasets[path].kind

    def walk(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield path and attributes of each object below the root; groups before their members.

        Data sets that :meth:`check` has not accepted are refused.
        """
        places = [f"/{name}" for name in reversed(self.members(ROOT))]
        while places:
            place = places.pop()
            node = self._find(place)
            if isinstance(node, h5g.GroupID) and place.count("/") <= DEEPEST:
                places += [f"{place}/{name}" for name in reversed(self.members(place))]
            elif place not in self._datasets:
                raise damage(self.path, place, "is nothing that belongs into the file")
            yield place, read_attributes(node, self.path, place)

    def shape(self, path: str) -> tuple[int, ...]:
        """Return the shape of a data set."""
        return self._datasets[path].shape

    def dtype(self, path: str) -> np.dtype[Any]:
        """Return the stored type of a data set."""
        return self._datasets[path].dtype

    def rows(self, path: str, start: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Return rows [start, stop) as stored."""
        stored = self._datasets[path]
        stop = stored.shape[0] if stop is None else min(stop, stored.shape[0])
        self._check_memory(path, max(stop - start, 0) * stored.row_bytes)
        with hdf5_errors(self.path, path):
            rows: NDArray[Any] = stored.dataset[start:stop]
            return rows

    def row(self, path: str, index: int) -> Any:
        """Return one row as stored; a negative ``index`` counts from the end."""
        with hdf5_errors(self.path, path):
            return self._datasets[path].dataset[index]

    def array(self, path: str, dtype: Any = np.float64) -> NDArray[Any]:
        """Return all values in C order as ``dtype``; an integer one must hold them exactly."""
        shape = self._datasets[path].shape
        self._check_memory(path, prod(shape) * np.dtype(dtype).itemsize)
        stored = self._value(path)
        with np.errstate(invalid="ignore", over="ignore"):
            values = np.ascontiguousarray(stored, dtype=dtype).reshape(shape)
        if np.dtype(dtype).kind in "iu" and not np.array_equal(values, stored):
            raise damage(self.path, path, f"has values that are no {np.dtype(dtype).name}")
        return values

    def number(self, path: str) -> float:
        """Return a single finite number."""
        value = float(self._value(path))
        if not np.isfinite(value):
            raise damage(self.path, path, f"is {value}, not a number")
        return value

    def integer(self, path: str) -> int:
        """Return a single integer."""
        value = self.number(path)
        if value != int(value):
            raise damage(self.path, path, f"is {value}, not a whole number")
        return int(self._value(path))

    def text(self, path: str) -> str:
        """Return one text."""
        value = bytes(self._value(path))
        with hdf5_errors(self.path, path):
            return value.decode()

    def texts(self, path: str) -> tuple[str, ...]:
        """Return several texts."""
        if self.shape(path)[0] > MOST_TEXTS:
            raise damage(self.path, path, f"has more than {MOST_TEXTS} texts")
        values = self._value(path)
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
        stored = self._datasets[path]
        if self.is_growing or stored.filters:
            return None
        chunks: list[Any] = []
        with hdf5_errors(self.path, path):
            if stored.chunk:
                stored.dataset.id.chunk_iter(chunks.append)
        rows = np.array([chunk.chunk_offset[0] for chunk in chunks], np.uint64)
        starts = np.array([chunk.byte_offset for chunk in chunks], np.uint64)
        last_start = self.file_bytes - prod(stored.chunk) * stored.dtype.itemsize
        inside = starts <= max(last_start, 0)
        return rows[inside].astype(np.int64), starts[inside].astype(np.int64)

    def _value(self, path: str) -> Any:
        stored = self._datasets[path]
        self._check_memory(path, prod(stored.shape) * stored.dtype.itemsize)
        with hdf5_errors(self.path, path):
            return stored.dataset[()]

    def _check_memory(self, path: str, n_bytes: int) -> None:
        if n_bytes > max(2 * self.file_bytes, READ_BYTES):
            raise SessionError(
                f"{self.path}: {path} would need {n_bytes} bytes of memory, too many for a file of "
                f"{self.file_bytes}: it is damaged, or not from rigctl"
            )

    def _find(self, path: str) -> Any:
        """Return the object that hard links lead to, None where a link is missing."""
        place = f"/{path.strip('/')}"
        if place in self._nodes:
            return self._nodes[place]
        above, _, name = place.rpartition("/")
        group = self._find(above) if above else self._nodes[ROOT]
        if group is None:
            return None
        if not isinstance(group, h5g.GroupID):
            raise damage(self.path, above, "is not a group")
        node = self._open_link(group, name, place)
        if isinstance(node, h5g.GroupID):
            self._nodes[place] = node
        return node

    def _open_link(self, group: Any, name: str, place: str) -> Any:
        with hdf5_errors(self.path, place):
            if not group.links.exists(name.encode()):
                return None
            kind = group.links.get_info(name.encode()).type
        if kind != h5l.TYPE_HARD:
            raise damage(self.path, place, "is a link to another place, which may not be followed")
        with hdf5_errors(self.path, place):
            return h5py.h5o.open(group, name.encode())


@contextmanager
def _tell_unclosed(path: Path) -> Iterator[None]:
    """Raise UnclosedFile where HDF5 refuses a file because of its writer."""
    try:
        yield
    except OSError as error:
        if "already open" not in str(error):
            raise
        raise UnclosedFile(f"{path} was not closed by its writer, or is being written") from error
