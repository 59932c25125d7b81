"""One-time notices to a user: an empty order of taxels has changed its meaning.

A shown notice is recorded in the user's state folder, so that the next start does not repeat it.
Where that folder cannot be written, it appears again.
"""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import platformdirs

from rigctl.config.rig_config import load_config
from rigctl.errors import ConfigError


def wiring_notice(rig: str) -> str:
    """Return the notice for a rig, empty where none applies or it was shown before.

    ``rig`` is as :func:`rigctl.rig.open_rig` takes it; a simulated one has no wires to solder.
    """
    path = Path(rig)
    try:
        config = load_config(path) if path.is_file() else None
    except ConfigError:
        return ""  # opening the rig reports more than this
    if config is None or config.ports.simulate or config.taxels.wiring:
        return ""
    if not _is_first_time(f"empty wiring: {path.resolve()}"):
        return ""
    taxels = config.taxels
    ranges = ", and low and high, which count places, must be calibrated again"
    return (
        f"{path}: [taxels] wiring is empty, which means the order of the wiring drawing, "
        f"{list(taxels.order)}, and no longer that of the wire: a sensor soldered to suit the old "
        f"order needs wiring = {list(range(taxels.count))}{ranges if taxels.low else ''}; "
        f"rigctl calibrate --rig {path} wiring finds the true one (shown once)"
    )


def _is_first_time(notice: str) -> bool:
    """Record a notice as shown; return whether it was not recorded before."""
    state_folder = platformdirs.user_state_path("rigctl", appauthor=False)
    record = state_folder / "told" / sha256(notice.encode()).hexdigest()[:16]
    try:
        record.parent.mkdir(parents=True, exist_ok=True)
        with record.open("x", encoding="utf-8") as file:
            file.write(notice + "\n")
    except FileExistsError:
        return False
    except OSError:
        return True
    return True
