"""Whole sessions, recorded once by each worker; copy them to damage them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.session import building, finger_building
from tests.session.block_session import record_in_blocks


@pytest.fixture(scope="session")
def drum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of the drum, of two parts."""
    folder = tmp_path_factory.mktemp("drum") / "s"
    building.record_plan(folder)
    return folder


@pytest.fixture(scope="session")
def drum_blocks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with several blocks of rows in each table."""
    folder = tmp_path_factory.mktemp("blocks") / "s"
    record_in_blocks(folder)
    return folder


@pytest.fixture(scope="session")
def finger(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of the moving finger, of two parts."""
    folder = tmp_path_factory.mktemp("finger") / "s"
    finger_building.record_plan(folder)
    return folder
