"""Sessions of two sensors are not joined; an older session joins any."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.analysis.trial_set import join_sessions
from rigctl.errors import SessionError
from rigctl.session.sensor_layout import SensorLayout
from tests.analysis.recordings import record

ONE_LAYER = SensorLayout(3, 6, ("skin",))


def session(folder: Path, layout: SensorLayout | None) -> Path:
    return record(folder, "A", travel_mm=12.0, forces=(250,), speeds=(120,), layout=layout)


def test_sessions_of_two_layouts_are_not_joined(tmp_path: Path) -> None:
    older, one = session(tmp_path / "older", None), session(tmp_path / "one", ONE_LAYER)
    two = session(tmp_path / "two", SensorLayout.default(18))
    with pytest.raises(SessionError, match=f"{two} is of a sensor with another layout than {one}"):
        join_sessions([older, one, two])


def test_an_older_session_has_the_layout_of_the_others(tmp_path: Path) -> None:
    older, one = session(tmp_path / "older", None), session(tmp_path / "one", ONE_LAYER)
    assert join_sessions([older, one]).sensor_layout == ONE_LAYER
    assert join_sessions([older]).sensor_layout == SensorLayout.default(18)


def test_names_alone_do_not_keep_sessions_apart(tmp_path: Path) -> None:
    one = session(tmp_path / "one", ONE_LAYER)
    same = session(tmp_path / "same", SensorLayout(3, 6, ("I",)))
    assert len(join_sessions([one, same]).trials) == 2
