"""How far a setup has come, in a file beside ``rig.toml``, so that it can be left and continued."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from rigctl.config.rig_config import RigConfig
from rigctl.config.toml_edit import replace_file
from rigctl.errors import WrongUse
from rigctl.values import BoardIdentity

MAX_BYTES = 1 << 18
COMMISSION = "commission"
NOT_COMMISSIONED = (
    "the board is not commissioned for its present settings, as after another program, another "
    "board or an erased EEPROM: check what has changed, and commission it again"
)
Kept = dict[str, dict[str, Any]]


class PassedStep(msgspec.Struct, frozen=True):
    """A step that has passed: on which day, what was found, what it wrote into ``rig.toml``."""

    day: str
    found: str
    kept: Kept = {}


class SetupFile(msgspec.Struct, frozen=True):
    """The file: how often the drum board had booted, and the steps that have passed."""

    boots: int
    passed: dict[str, PassedStep] = {}


@dataclass
class Progress:
    """The steps that have passed. ``path``: None for a simulated rig, which is not remembered.

    ``remarks``: one sentence for each step that has lost its pass since.
    """

    path: Path | None = None
    passed: dict[str, PassedStep] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    def save(self, board: BoardIdentity) -> None:
        """Write the file, bound to this drum board. Raises DiskFault."""
        if self.path is not None:
            _write(self.path, SetupFile(board.boot_count, self.passed))


def progress_path(rig_file: Path) -> Path:
    """Return where the progress of a rig's setup lies."""
    return rig_file.with_suffix(".setup.json")


def renew_kept(passed: dict[str, PassedStep], kept: Mapping[str, Mapping[str, Any]]) -> None:
    """Let each step that wrote one of these keys before agree with what ``rig.toml`` says now."""
    for name, step in passed.items():
        newer = {
            table: {key: kept.get(table, {}).get(key, value) for key, value in keys.items()}
            for table, keys in step.kept.items()
        }
        passed[name] = msgspec.structs.replace(step, kept=newer)


def note_calibration(rig_file: Path, table: str, keys: Mapping[str, Any]) -> None:
    """Let the progress beside ``rig.toml`` agree with a calibration, so that no part is repeated.

    Raises WrongUse where the file is damaged, DiskFault.
    """
    path = progress_path(rig_file)
    if path.is_file():
        file = _read(path)
        renew_kept(file.passed, {table: keys})
        _write(path, file)


def load_progress(
    rig_file: Path | None, board: BoardIdentity, config: RigConfig, is_commissioned: bool
) -> Progress:
    """Return the progress beside ``rig.toml``, with a remark for each step that no longer counts.

    ``is_commissioned``: for the settings that the board has now. Raises WrongUse where the file
    is damaged, or belongs to another drum board.
    """
    if rig_file is None:
        return Progress()
    path = progress_path(rig_file)
    progress = Progress(path)
    if not path.is_file():
        return progress
    file = _read(path)
    if board.boot_count < file.boots:
        raise WrongUse(
            f"{path} belongs to another drum board (its count of boots was {file.boots}, this one "
            f"has {board.boot_count}): connect that one, or delete the file to begin again"
        )
    for name, step in file.passed.items():
        if remark := _contradiction(step.kept, config, rig_file.name):
            progress.remarks.append(f"{name}: {remark}; it is checked again")
        else:
            progress.passed[name] = step
    if COMMISSION in progress.passed and not is_commissioned:
        del progress.passed[COMMISSION]
        progress.remarks.append(f"{COMMISSION}: {NOT_COMMISSIONED}")
    return progress


def _read(path: Path) -> SetupFile:
    try:
        with path.open("rb") as file:
            return msgspec.json.decode(file.read(MAX_BYTES), type=SetupFile)
    except (OSError, msgspec.DecodeError) as error:
        raise WrongUse(
            f"{path} cannot be read ({error}): delete it to begin the setup again"
        ) from error


def _write(path: Path, file: SetupFile) -> None:
    text = json.dumps(msgspec.to_builtins(file), ensure_ascii=False, indent=1)
    replace_file(path, text + "\n")


def _contradiction(kept: Mapping[str, Mapping[str, Any]], config: RigConfig, name: str) -> str:
    """Return where ``rig.toml`` says something else than a step wrote, empty where it does not."""
    for table, keys in kept.items():
        for key, value in keys.items():
            now = getattr(getattr(config, table), key)
            now = list(now) if isinstance(now, tuple) else now
            if now != value:
                return f"{name} says [{table}] {key} = {now}, setup had found {value}"
    return ""
