"""Which reading of the taxel wire each column of a session's samples holds, and whether two agree.

Columns are the sensor's places, layer by layer. Where two wirings differ, taxel 4 of one session
is another taxel than taxel 4 of the other, so nothing may be made of both.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

from rigctl.errors import SessionError
from rigctl.session.format.header import IMPORTED, SessionHeader

Wiring = tuple[int, ...]


def wiring_of(header: SessionHeader, rig_text: str) -> Wiring:
    """The reading at each place; empty for an import, whose columns its map has put in order.

    An older part lacks the attribute: it holds what ``rig_text`` says, and where that says
    nothing the readings in the order of the wire. Raises SessionError for a text that is no TOML.
    """
    if header.wiring or header.rig == IMPORTED:
        return header.wiring
    try:
        written = tomllib.loads(rig_text).get("taxels", {}).get("wiring", [])
    except tomllib.TOMLDecodeError as error:
        raise SessionError(f"the session's description of its rig is damaged: {error}") from error
    return tuple(written) or tuple(range(header.n_taxels))


def wiring_of_source(source: Mapping[str, Any]) -> Wiring:
    """The same of a session as a model or a file of spikes remembers it.

    An older file does not tell it: its sessions count as in the order of the wire, which was the
    default then.
    """
    told = source.get("wiring")
    if told is not None or source.get("rig") == IMPORTED:
        return tuple(told or ())
    return tuple(range(int(source.get("n_taxels", 0))))


def agree(one: Wiring, other: Wiring) -> bool:
    """Whether both have each taxel at the same place, as far as is told."""
    return not one or not other or one == other


def in_words(one: Wiring, other: Wiring) -> str:
    """Both orders for a sentence, as ``rig.toml`` writes them."""
    return f"[taxels] wiring = {list(one)}, not {list(other)}"
