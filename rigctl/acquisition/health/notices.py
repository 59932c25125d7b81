"""What somebody is told once: that an empty order of taxels means another one than it did.

What was said is remembered for the user, below ``$XDG_STATE_HOME`` or ``~/.local/state``, so that
a second start is quiet. Where that cannot be written, it is said again.
"""

from __future__ import annotations

import os
from hashlib import sha256
from pathlib import Path

from rigctl.config.rig_config import load_config
from rigctl.errors import ConfigError
from rigctl.values import DRAWN_WIRING, N_TAXELS


def state_folder() -> Path:
    """Where it is remembered what a user was told."""
    base = os.environ.get("XDG_STATE_HOME", "")
    return (Path(base) if base else Path.home() / ".local" / "state") / "rigctl"


def wiring_notice(rig: str) -> str:
    """The sentence for whoever opens this rig: empty where there is none, or it was said before.

    ``rig`` is as :func:`rigctl.rig.open_rig` takes it; a simulated one has no wires to solder.
    """
    path = Path(rig)
    try:
        config = load_config(path) if path.is_file() else None
    except ConfigError:
        return ""  # whoever opens it is told more than this
    if config is None or config.ports.simulate or config.taxels.wiring:
        return ""
    if not _first_time(f"empty wiring: {path.resolve()}"):
        return ""
    ranges = ", and low and high, which count places, have to be taken again"
    return (
        f"{path}: [taxels] wiring is empty, which means the order of the wiring drawing, "
        f"{list(DRAWN_WIRING)}, and no longer that of the wire: a sensor soldered to suit the old "
        f"order needs wiring = {list(range(N_TAXELS))}{ranges if config.taxels.low else ''}; "
        f"rigctl calibrate --rig {path} wiring finds the true one (said once)"
    )


def _first_time(what: str) -> bool:
    """Whether this user was not told so yet; from now on they were."""
    mark = state_folder() / "told" / sha256(what.encode()).hexdigest()[:16]
    try:
        mark.parent.mkdir(parents=True, exist_ok=True)
        with mark.open("x", encoding="utf-8") as file:
            file.write(what + "\n")
    except FileExistsError:
        return False
    except OSError:
        return True
    return True
