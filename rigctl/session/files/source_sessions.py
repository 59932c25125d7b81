"""The sessions that a model or a file of spikes was made from, as it remembers them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py

from rigctl.errors import SessionError
from rigctl.session.format.annotated_arrays import take_text
from rigctl.session.read.folder import attributes

HOLDERS = {"rigctl-model": "training/inputs", "rigctl-spikes": "inputs"}
"""Where files of these layouts name their sessions."""


def read_inputs(path: Path) -> tuple[dict[str, Any], ...]:
    """A plain mapping for each session. Raises SessionError for another file or a damaged one."""
    try:
        with h5py.File(path, "r") as file:
            return take_inputs(file)
    except (OSError, KeyError, ValueError) as error:
        raise SessionError(f"{path} does not tell which sessions it is made of: {error}") from error


def take_inputs(file: Any) -> tuple[dict[str, Any], ...]:
    """The same of an open file. Raises KeyError or ValueError where it does not hold them."""
    return tuple(json.loads(take_text(file, HOLDERS[str(attributes(file).get("layout"))])))
