"""An engine on the virtual rig, for every test of this folder that asks for one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.acquisition.engine_harness import EngineHarness, open_harness


@pytest.fixture
def harness(tmp_path: Path) -> Iterator[EngineHarness]:
    """An engine on a virtual rig, not yet serving."""
    with open_harness(tmp_path) as opened:
        yield opened
