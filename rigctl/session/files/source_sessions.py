"""The source sessions that a model or a file of spikes lists, as JSON."""

from __future__ import annotations

from typing import Any

from rigctl.config.rig_config import MAX_TAXELS
from rigctl.session.hdf5_file import Hdf5File, damage, parse_objects, text

_TEXTS = ("path", "content", "rig", "plan_hash", "begun_utc")
_INTEGERS = ("seed", "simulation_seed", "trials_committed", "n_taxels")


def read_source_sessions(file: Hdf5File, path: str) -> tuple[dict[str, Any], ...]:
    """Return a mapping for each source session in the text ``path``.

    Raises SessionError for damage and for values of another type than the program uses.
    """
    file.check([text(path)])
    sources = parse_objects(file.text(path), file.path, path)
    for source in sources:
        for name, value in source.items():
            if not _is_valid(name, value):
                raise damage(file.path, path, f"has a wrong {name} of a session")
    return sources


def _is_valid(name: str, value: Any) -> bool:
    """Return whether the program can use a value; it does not use those of other names."""
    if name in _TEXTS:
        return isinstance(value, str)
    if name in _INTEGERS:
        limit = MAX_TAXELS if name == "n_taxels" else None
        return value is None or (type(value) is int and (limit is None or 0 <= value <= limit))
    if name == "wiring":
        return value is None or _is_list(value, int)
    if name == "scaling":
        return isinstance(value, list) and all(_is_list(pair, int, float) for pair in value)
    return True


def _is_list(value: Any, *types: type) -> bool:
    return isinstance(value, list) and all(type(item) in types for item in value)
