"""Checks that sessions, models, C and taxel ranges have their taxels in the same order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from rigctl.errors import SessionError
from rigctl.session.analysis_file import load_inputs
from rigctl.session.header import (
    SensorLayout,
    describe_difference,
    describe_mismatch,
    layouts_match,
    source_wiring,
    wirings_match,
)
from rigctl.session.session import Session

Sources = Sequence[Mapping[str, Any]]
"""For each session a mapping with its ``path`` and its ``wiring``."""


def check_same_wiring(first: Mapping[str, Any], other: Mapping[str, Any]) -> None:
    """Raise SessionError where two sessions have their taxels in another order."""
    _check(other, first, first["path"], "analyse them separately")


def check_same_sensor(paths: Sequence[Path], layouts: Sequence[SensorLayout | None]) -> None:
    """Raise SessionError where the last session's sensor has another layout than one before."""
    for path, layout in zip(paths, layouts, strict=False):
        if not layouts_match(layout, layouts[-1]):
            raise SessionError(
                f"{paths[len(layouts) - 1]} is of a sensor with another layout than {path} "
                f"({describe_difference(layouts[-1], layout)}): analyse them separately"
            )


def check_source_wiring(file: Path | str, sources: Sources, sessions: Sources) -> None:
    """Raise SessionError where a session has another order than the sources of ``file``."""
    for session, source in product(sessions, sources):
        remedy = "make one from sessions in that order"
        _check(session, source, f"the sessions of {file}", remedy)


def check_file_wiring(file: Path, sessions: Sequence[Path]) -> None:
    """Raise SessionError where a session has another order than a model or a spikes.h5."""
    check_source_wiring(file, load_inputs(file), [_source(path) for path in sessions])


def _check(session: Mapping[str, Any], other: Mapping[str, Any], name: str, remedy: str) -> None:
    ours, theirs = source_wiring(session), source_wiring(other)
    if not wirings_match(ours, theirs):
        raise SessionError(
            f"{session['path']} has its taxels in another order than {name} "
            f"({describe_mismatch(ours, theirs)}): {remedy}"
        )


def _source(path: Path) -> Mapping[str, Any]:
    with Session.open(path) as session:
        return {"path": str(path), "wiring": session.wiring}
