"""Recorded sessions that no test changes, and a copy of one to damage."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.finger import finger_building
from tests.session import building
from tests.session.block_session import record_in_blocks


@pytest.fixture(scope="session")
def drum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of the drum: every trial of the plan, in two parts."""
    folder = tmp_path_factory.mktemp("drum") / "s"
    building.record_plan(folder)
    return folder


@pytest.fixture(scope="session")
def finger(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of the moving finger."""
    folder = tmp_path_factory.mktemp("finger") / "s"
    finger_building.record_plan(folder)
    return folder


@pytest.fixture(scope="session")
def in_blocks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of two parts with several blocks of rows in each table."""
    folder = tmp_path_factory.mktemp("blocks") / "s"
    record_in_blocks(folder)
    return folder


@pytest.fixture
def recorded(drum: Path) -> Path:
    """The session that ``session`` copies; a module may name another one."""
    return drum


@pytest.fixture
def session(recorded: Path, tmp_path: Path) -> Path:
    """A copy of the recorded session to damage."""
    return Path(shutil.copytree(recorded, tmp_path / "s"))
