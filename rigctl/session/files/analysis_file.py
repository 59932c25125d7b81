"""Open the files that analyses write: models and spikes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from rigctl.errors import SessionError, WrongUse
from rigctl.session.format.annotated_arrays import read_attributes

MODEL_LAYOUT, SPIKES_LAYOUT = "rigctl-model", "rigctl-spikes"
LAYOUT_VERSION = 1


@contextmanager
def open_analysis_file(path: Path, hint: str, *layouts: str) -> Iterator[Any]:
    """Open a file of one of ``layouts``, by default a model or a file of spikes.

    Raises SessionError for a missing, damaged, newer or other file, and for one without what the
    ``with`` block reads. ``hint``: which file to give instead.
    """
    kind = "model" if layouts == (MODEL_LAYOUT,) else "model or a spikes.h5"
    try:
        with h5py.File(path, "r") as file:
            attributes = read_attributes(file)
            if attributes.get("layout") not in (layouts or (MODEL_LAYOUT, SPIKES_LAYOUT)):
                raise SessionError(f"{path} is an HDF5 file, but not a {kind}: {hint}")
            version = attributes.get("layout_version")
            if version != LAYOUT_VERSION:
                raise SessionError(
                    f"{path} has layout version {version}, this program reads {LAYOUT_VERSION}: "
                    "use the rigctl that made it, or make it again"
                )
            yield file
    except SessionError:
        raise
    except FileNotFoundError:
        raise SessionError(f"there is no file {path}: {hint}") from None
    except (OSError, KeyError, ValueError, IndexError, WrongUse) as error:
        raise SessionError(f"{path} is not a {kind}, or is damaged: {error}") from error
