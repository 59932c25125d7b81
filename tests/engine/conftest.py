"""A fixture for all tests of this folder: an engine on the virtual rig."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.engine.engine_harness import EngineHarness, open_harness


@pytest.fixture
def harness(tmp_path: Path) -> Iterator[EngineHarness]:
    """Return an engine on a virtual rig that does not serve yet."""
    with open_harness(tmp_path) as opened:
        yield opened
