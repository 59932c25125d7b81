"""An engine on the virtual rig, for every test of this folder that asks for one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.acquisition.floor import Floor, open_floor


@pytest.fixture
def floor(tmp_path: Path) -> Iterator[Floor]:
    """An engine on a virtual rig, not yet serving."""
    with open_floor(tmp_path) as opened:
        yield opened
