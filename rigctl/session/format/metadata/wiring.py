"""Wiring of a session: the reading of the taxel wire in each column of its samples.

Columns are the sensor's places, layer by layer. If two wirings differ, taxel 4 of one session is
not taxel 4 of the other, so the program never combines the two.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.config.rig_config import MAX_TAXELS
from rigctl.config.toml_reader import TomlText
from rigctl.errors import SessionError
from rigctl.session.format.metadata.header import IMPORTED, SessionHeader

Wiring = tuple[int, ...]


def session_wiring(header: SessionHeader, rig_text: str) -> Wiring:
    """Return the reading at each place; empty for an import, whose mapping orders its columns.

    Older parts lack the attribute: the wiring in ``rig_text`` applies to them or, if that has
    none, the order of the wire. Raises SessionError for a text that is not TOML.
    """
    if header.wiring or header.rig == IMPORTED:
        return header.wiring
    rig = TomlText("the session's description of its rig", rig_text, SessionError)
    wiring = rig.root.table("taxels").integers("wiring", (), low=0, high=MAX_TAXELS)
    return wiring or tuple(range(header.n_taxels))


def source_wiring(source: Mapping[str, Any]) -> Wiring:
    """Return the wiring of a source session that a model or a file of spikes lists.

    Older files have none: their sessions have the order of the wire, the default at that time.
    """
    wiring = source.get("wiring")
    if wiring is not None or source.get("rig") == IMPORTED:
        return tuple(wiring or ())
    return tuple(range(int(source.get("n_taxels", 0))))


def wirings_match(one: Wiring, other: Wiring) -> bool:
    """Return whether both have each taxel at the same place; an empty wiring matches any."""
    return not one or not other or one == other


def describe_mismatch(one: Wiring, other: Wiring) -> str:
    """Return both orders for an error message, in the syntax of ``rig.toml``."""
    return f"[taxels] wiring = {list(one)}, not {list(other)}"
