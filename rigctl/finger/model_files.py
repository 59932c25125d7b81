"""The model files that an experiment leaves in its sessions' folders."""

from __future__ import annotations

from pathlib import Path

from rigctl.errors import WrongUse
from rigctl.finger.values import ScanKind

SPEED_SCALED = ScanKind.SPEED_SCALED.key
REPRESENTATIONS = tuple(kind.key for kind in ScanKind)


def model_path(path: Path, representation: str) -> Path:
    """Return the model file that a file or a session's folder names. Raises WrongUse."""
    file = path / f"model-{representation}.h5" if path.is_dir() else path
    if file.is_file():
        return file
    raise WrongUse(
        f"there is no model {file}: train one with `rigctl realtime train`, or name its file; an "
        "unfinished training or calibration makes its model at the end of --resume"
    )
