"""JSON files with a digest of their own, for what is added to a session after its record.

The last member, ``sha256``, is the SHA-256 of the canonical JSON (sorted keys, no spaces, UTF-8) of
the others.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigctl.config.text_file import read_bytes, refuse_link_outside
from rigctl.errors import SessionError


def sealed_text(members: Mapping[str, Any]) -> str:
    """Return the text of a file with these members and their digest."""
    return json.dumps({**members, "sha256": _sha256(members)}, ensure_ascii=False, indent=1) + "\n"


def read_sealed(path: Path, max_bytes: int, remedy: str) -> dict[str, Any]:
    """Return the members of a file without their digest.

    Raises SessionError for a damaged, altered or linked one; ``remedy`` ends its sentence.
    """
    refuse_link_outside(path, SessionError)
    data = read_bytes(path, max_bytes, SessionError)
    try:
        members = json.loads(data.decode())
    except (ValueError, RecursionError):
        members = None
    if not isinstance(members, dict) or members.pop("sha256", None) != _sha256(members):
        raise SessionError(f"{path} is damaged or was altered, its digest does not match: {remedy}")
    return members


def _sha256(members: Mapping[str, Any]) -> str:
    canonical = json.dumps(members, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(canonical.encode(errors="surrogatepass")).hexdigest()
