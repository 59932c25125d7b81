"""The session of what is done by hand: a protocol without trials, whose only step says so."""

from __future__ import annotations

import json
from pathlib import Path

from rigctl.acquisition.protocol.run_request import RunContext, check_disk_space, open_recorder
from rigctl.errors import WrongUse
from rigctl.protocol.loader import parse_protocol
from rigctl.session.recorder import Recorder

NAME = "by-hand"
NEEDED_BYTES = 10_000_000
"""Room for the first minutes; the disk is watched from then on."""


def protocol_text(note: str) -> str:
    """Return the protocol that a session by hand stores, with the operator's note."""
    told = json.dumps(note or "no note", ensure_ascii=False).replace("\x7f", "\\u007f")
    return (
        f'name = "{NAME}"\ndescription = {told}\n\n'
        '[[steps]]\nat = "start"\nkind = "message"\ntext = "operated by hand"\n'
    )


def open_manual_session(folder: Path, note: str, context: RunContext) -> Recorder:
    """Return the recorder of a new session by hand.

    Raises WrongUse where the folder is no whole path, SessionError where it holds something,
    DiskFault where it has no room.
    """
    if not folder.is_absolute():
        raise WrongUse(f"{folder} is no whole path: choose the folder to save in")
    plan = parse_protocol(protocol_text(note), NAME, context.rig.config).plan()
    check_disk_space(folder, NEEDED_BYTES)
    return open_recorder(folder, plan, context, resume=False)
