"""The editor's tasks of a worker process: read, check and save a protocol. Without Qt."""

from __future__ import annotations

import re
from pathlib import Path

from gui.protocol.run_tasks import summarise
from gui.protocol.run_values import PLAN_ROWS, CheckedText, ProtocolText, SavedProtocol
from gui.widgets.formatting import duration, grouped, size
from rigctl.config import resources
from rigctl.config.text_file import read_text
from rigctl.config.toml_bounds import MAX_BYTES
from rigctl.config.toml_edit import replace_file
from rigctl.errors import DiskFault, ProtocolError, RigctlError, WrongUse

_LINE = re.compile(r"\bline (\d+)")
OWN_FOLDER = "rigctl-protocols"


def read_protocol(path: str) -> ProtocolText:
    """Return the text of a protocol's file."""
    file = Path(path)
    own = Path.home() / OWN_FOLDER / file.name
    built_in = (resources.protocols().resolve(), resources.finger_protocols().resolve())
    is_built_in = file.parent.resolve() in built_in
    try:
        text = read_text(file, MAX_BYTES, ProtocolError)
    except RigctlError as error:
        return ProtocolText(path, problem=str(error))
    return ProtocolText(path, text, str(own) if is_built_in else path)


def check_text(text: str, rig_toml: str, name: str) -> CheckedText:
    """Return whether a text is a protocol of drum or finger, and the numbers of its plan.

    ``rig_toml`` describes the drum's rig, empty for the nominal one; ``name``: the text's file.
    """
    from rigctl.config.rig_config import parse_config
    from rigctl.protocol.form_content import read_content
    from rigctl.protocol.loader import parse_protocol

    try:
        config = parse_config(rig_toml)
        if read_content(text, config, name).is_finger:
            return CheckedText(text, _finger_summary(text, name))
        plan = parse_protocol(text, name, config).plan()
    except WrongUse as error:
        return CheckedText(
            text, "", str(error), error.key_path, error.reason, _line_of(error, name)
        )
    rows = dict(zip(PLAN_ROWS, summarise(plan).texts, strict=True))
    numbers = (f"{rows[name]} {name.lower()}" for name in ("Trials", "Plate changes"))
    return CheckedText(
        text, f"No errors: {', '.join(numbers)}, {rows['Duration']}, {rows['Disk space']} on disk"
    )


def _line_of(error: WrongUse, name: str) -> int:
    """Return the line of a mistake, 0 for none; the TOML library has it in its sentence only."""
    found = _LINE.search(str(error).removeprefix(name))
    return error.line or (int(found[1]) if found else 0)


def _finger_summary(text: str, name: str) -> str:
    from rigctl.protocol.finger import Stage
    from rigctl.protocol.finger_plan import parse_finger_protocol

    plan = parse_finger_protocol(text, name).plan(list(Stage))
    time, disk = duration(plan.duration_s), size(plan.bytes_estimate)
    return (
        f"No errors: {grouped(len(plan.trials))} scans of the moving finger, {time}, {disk} on disk"
    )


def save_protocol(path: str, text: str, may_replace: bool) -> SavedProtocol:
    """Save a protocol; another file than the one that was opened is never replaced."""
    file = Path(path)
    if not file.is_absolute() or file.suffix != ".toml":
        return SavedProtocol(path, "Save as: give the whole path of a file that ends with .toml")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        if not may_replace and file.exists():
            return SavedProtocol(path, f"{path} exists: choose another name")
        replace_file(file, text)
    except OSError as error:
        return SavedProtocol(path, f"{path} cannot be saved: {error.strerror}")
    except DiskFault as fault:
        return SavedProtocol(path, str(fault))
    return SavedProtocol(path)
