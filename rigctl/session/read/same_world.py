"""Whether a session would be gone on with in the simulated world that it was begun in."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigctl.errors import SessionError


def check_same_world(folder: Path, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Compare the ``world`` of what a session's header holds with that of the rig at hand.

    Both are parameters by name; of a real rig there is none. Raises SessionError naming the first
    parameter that differs.
    """
    there, here = found.get("world"), json.loads(json.dumps(wanted.get("world")))  # no tuples
    if there == here:
        return
    if there is None or here is None:
        raise SessionError(
            f"{folder} does not say in which simulated world it was begun: start a new session"
        )
    name = next(n for n in {**there, **here} if there.get(n) != here.get(n))
    raise SessionError(
        f"{folder} was begun in another world, {name} is {_said(there, name)} there and "
        f"{_said(here, name)} here: go on in its own, which `rigctl world {folder}` prints, or "
        "start a new session"
    )


def _said(world: Mapping[str, Any], name: str) -> str:
    return json.dumps(world[name]) if name in world else "absent"
