"""Refuses what would mix taxels up: sessions, models, C and ranges of two orders of taxels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rigctl.errors import SessionError
from rigctl.session.files.source_sessions import read_inputs
from rigctl.session.format.wiring import agree, in_words, wiring_of_source
from rigctl.session.read.session import Session

Sources = Sequence[Mapping[str, Any]]
"""A plain mapping for each session, with its ``path`` and its ``wiring``."""


def check_alike(first: Mapping[str, Any], other: Mapping[str, Any]) -> None:
    """Raise SessionError where two sessions have their taxels in another order."""
    ours, theirs = wiring_of_source(other), wiring_of_source(first)
    if not agree(ours, theirs):
        raise SessionError(
            f"{other['path']} has its taxels in another order than {first['path']} "
            f"({in_words(ours, theirs)}): use them apart"
        )


def check_learnt(file: Path | str, learnt: Sources, sessions: Sources) -> None:
    """Raise SessionError where a session has another order than those that ``file`` is made of."""
    for session in sessions:
        for source in learnt:
            ours, theirs = wiring_of_source(session), wiring_of_source(source)
            if not agree(ours, theirs):
                raise SessionError(
                    f"{session['path']} has its taxels in another order than the sessions of "
                    f"{file} ({in_words(ours, theirs)}): make one from sessions in that order"
                )


def check_file(file: Path, sessions: Sequence[Path]) -> None:
    """Raise SessionError where a session has another order than those of a model or spikes.h5."""
    check_learnt(file, read_inputs(file), [_source(path) for path in sessions])


def _source(path: Path) -> Mapping[str, Any]:
    with Session.open(path) as session:
        return {"path": str(path), "wiring": session.wiring}
