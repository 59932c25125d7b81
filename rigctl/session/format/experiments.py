"""The layout of each experiment, and the refusal of a session of the other."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigctl.errors import SessionError
from rigctl.session.format.data_sets import SessionLayout
from rigctl.session.format.finger_layout import FINGER_EXPERIMENT, FINGER_LAYOUT
from rigctl.session.format.layout import DRUM_EXPERIMENT, DRUM_LAYOUT

_LAYOUTS = {each.experiment: each for each in (DRUM_LAYOUT, FINGER_LAYOUT)}
_NAMES = {DRUM_EXPERIMENT: "the drum", FINGER_EXPERIMENT: "the moving finger"}
_COMMANDS = {
    DRUM_EXPERIMENT: "`rigctl run` resumes and `rigctl analyse` reads it",
    FINGER_EXPERIMENT: "`rigctl realtime` resumes and `rigctl analyse --experiment realtime` "
    "reads it",
}


def layout_of(attributes: Mapping[str, Any], path: Path) -> SessionLayout:
    """Return the layout of a part with these attributes; a part without experiment is the drum's.

    Raises SessionError for an experiment that this program does not know.
    """
    experiment = attributes.get("experiment", DRUM_EXPERIMENT)
    if not isinstance(experiment, str) or experiment not in _LAYOUTS:
        raise SessionError(
            f"{path} is of experiment {experiment}, which this program does not know: use the "
            "rigctl that recorded it"
        )
    return _LAYOUTS[experiment]


def check_experiment(folder: Path, found: SessionLayout, wanted: SessionLayout) -> None:
    """Raise SessionError where a session is of another experiment than the one wanted."""
    if found.experiment != wanted.experiment:
        raise SessionError(
            f"{folder} is a session of {_NAMES[found.experiment]}, not of "
            f"{_NAMES[wanted.experiment]}: {_COMMANDS[found.experiment]}"
        )
