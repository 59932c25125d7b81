"""Sketches for the Arduino IDE: a complete folder for each board."""

from __future__ import annotations

from pathlib import Path

from rigctl.config.resources import sketch_sources
from rigctl.config.text_file import read_text
from rigctl.errors import WrongUse

BOARDS = ("drum", "taxels", "finger")
SHARED = {"finger": ("taxels/cobs.cpp", "taxels/cobs.h", "taxels/crc32.cpp", "taxels/crc32.h")}
"""The finger board frames its bytes as the taxel board does."""
MODEL_FILE = "trained_model.h"
"""The name under which the finger's sketch includes a model."""
SUFFIXES = {".ino", ".cpp", ".h"}
MAX_MODEL_BYTES = 4 * 2**20


def write_sketches(folder: Path, model: Path | None = None) -> list[Path]:
    """Write the sketches below ``folder`` and return theirs; ``model``: a header for the finger's.

    Raises WrongUse where one is there already, or for what is no model.
    """
    there = [folder / board for board in BOARDS if (folder / board).exists()]
    if there:
        raise WrongUse(f"{there[0]} exists already: give another folder, or remove it")
    model_text = _model_text(model) if model else None
    sources = sketch_sources()
    try:
        for board in BOARDS:
            (folder / board).mkdir(parents=True)
            paths = [path for path in (sources / board).iterdir() if path.suffix in SUFFIXES]
            for path in (*paths, *(sources / name for name in SHARED.get(board, ()))):
                (folder / board / path.name).write_bytes(path.read_bytes())
        if model_text is not None:
            (folder / "finger" / MODEL_FILE).write_text(model_text, encoding="utf-8")
    except OSError as error:
        raise WrongUse(f"cannot write below {folder}: {error.strerror}") from error
    return [folder / board for board in BOARDS]


def _model_text(path: Path) -> str:
    text = read_text(path, MAX_MODEL_BYTES, WrongUse)
    if "FINGER_CLASSIFIER" not in text:
        raise WrongUse(
            f"{path} is no model of the finger board: write one with "
            "`rigctl realtime board MODEL --out FILE.h`"
        )
    return text
