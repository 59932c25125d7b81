"""Prepare a session's folder for a writer: create, resume or refuse it, then lock it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigctl.config.text_file import refuse_link_outside
from rigctl.errors import DiskFault, SessionError
from rigctl.session.format import file_names
from rigctl.session.format.experiments import check_experiment, layout_of
from rigctl.session.format.metadata.header import SessionHeader
from rigctl.session.format.metadata.sensor_layout import describe_difference, layouts_match
from rigctl.session.format.metadata.wiring import describe_mismatch, session_wiring, wirings_match
from rigctl.session.format.writer_lock import WriterLock
from rigctl.session.hdf5_file import text
from rigctl.session.read.missing_parts import highest_number, open_parts
from rigctl.session.read.part_file import open_part, part_paths


def prepare_folder(
    folder: Path, header: SessionHeader, texts: tuple[str, str], resume: bool
) -> WriterLock:
    """Create the folder, lock it and write the protocol and rig ``texts`` into it.

    Raises SessionError if the folder holds a session or other texts (without ``resume``), or holds
    none, one of another plan or one of another order of taxels (with ``resume``), or has a living
    writer;
    DiskFault if it is not writable.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise SessionError(f"{folder} is a file: give the path of a folder") from error
    except OSError as error:
        raise DiskFault(f"cannot make {folder}: {error.strerror}; choose another folder") from error
    lock = WriterLock(folder)
    try:
        _check_contents(folder, header, resume)
        for name, text in zip((file_names.PROTOCOL_FILE, file_names.RIG_FILE), texts, strict=True):
            _write_once(folder / name, text, resume)
    except BaseException:
        lock.release()
        raise
    return lock


def check_same_world(folder: Path, recorded: Mapping[str, Any], current: Mapping[str, Any]) -> None:
    """Compare the ``world`` of a session's ``simulation`` header with that of the connected rig.

    Both map parameter names to values; a real rig has none. Raises SessionError that names the
    first parameter that differs.
    """
    there = recorded.get("world")
    here = json.loads(json.dumps(current.get("world")))  # turns tuples into lists
    if there == here:
        return
    if there is None or here is None:
        raise SessionError(
            f"{folder} does not say in which simulated world it was recorded: start a new session"
        )
    name = next(n for n in {**there, **here} if there.get(n) != here.get(n))
    raise SessionError(
        f"{folder} was recorded in another world, {name} is {_format(there, name)} there and "
        f"{_format(here, name)} here: resume it in its own world (`rigctl world {folder}` prints "
        "it), or start a new session"
    )


def _format(world: Mapping[str, Any], name: str) -> str:
    return json.dumps(world[name]) if name in world else "absent"


def _write_once(path: Path, text: str, resume: bool) -> None:
    """Write a text beside the parts; a resumed session keeps the first one.

    Raises SessionError where a new session would keep that of a run without parts.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as error:
        if not resume and path.read_text(encoding="utf-8", errors="replace") != text:
            raise SessionError(
                f"{path} is there already and is not that of this run: choose another folder, or "
                "move the file away"
            ) from error
    except OSError as error:
        raise DiskFault(
            f"cannot write {path}: {error.strerror}; make room or choose another disk"
        ) from error


def _check_contents(folder: Path, header: SessionHeader, resume: bool) -> None:
    refuse_link_outside(folder / file_names.DIGEST_LINES_FILE, SessionError)
    if resume:
        _check_plan(_last_readable(folder), header)
    elif highest_number(folder):
        raise SessionError(
            f"{folder} already holds a session: continue it with --resume, or choose another folder"
        )


def _last_readable(folder: Path) -> Path:
    """Return the last part that can be read. Raises SessionError if none can."""
    paths = part_paths(folder)
    parts, damaged = open_parts(paths)
    for part in parts:
        part.close()
    if not parts:
        raise SessionError(f"{paths[0]} {damaged[file_names.part_number(paths[0])]}")
    return parts[-1].path


def _check_plan(path: Path, header: SessionHeader) -> None:
    with open_part(path) as file:
        attributes = file.attributes()
        found, wanted = layout_of(attributes, path), layout_of(header.to_attributes(), path)
        check_experiment(path.parent, found, wanted)
        recorded = SessionHeader.from_attributes(attributes, path)
        file.check([text("/rig_toml")])
        wiring = session_wiring(recorded, file.text("/rig_toml"))
    if (recorded.plan_hash, recorded.n_taxels) != (header.plan_hash, header.n_taxels):
        raise SessionError(
            f"{path.parent} was recorded with another protocol or seed: resume it with its own "
            f"{file_names.PROTOCOL_FILE}, or start a new session"
        )
    if recorded.reference_um_per_s != header.reference_um_per_s:
        raise SessionError(
            f"{path.parent} has a reference speed of {recorded.reference_um_per_s} µm/s, not of "
            f"{header.reference_um_per_s}: resume it with its own, or start a new session"
        )
    if not layouts_match(recorded.sensor_layout, header.sensor_layout):
        raise SessionError(
            f"{path.parent} is of a sensor with another layout than this rig has "
            f"({describe_difference(recorded.sensor_layout, header.sensor_layout)}): resume it "
            "with its own [taxels], or start a new session"
        )
    if not wirings_match(header.wiring, wiring):
        raise SessionError(
            f"{path.parent} has its taxels in another order than this rig has "
            f"({describe_mismatch(wiring, header.wiring)}): resume it with its own wiring, "
            "or start a new session"
        )
