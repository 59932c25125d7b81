"""Fixtures that run the same tests on both kinds of simulated boards."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from rigctl.rig import FIRMWARE, VIRTUAL, open_rig
from tests.contract.operator import Operator
from tests.firmware.building import all_built

SEED = 5


@pytest.fixture(scope="session")
def images() -> Path:
    """Return the folder of both boards' firmware images, built where they are out of date."""
    return all_built()


@pytest.fixture(scope="module", params=[VIRTUAL, FIRMWARE])
def operator(request: pytest.FixtureRequest) -> Iterator[Operator]:
    """Return the operator of a rig of each kind, both boards connected; one rig per file."""
    if request.param == FIRMWARE:
        request.getfixturevalue("images")
    rig = open_rig(request.param, seed=SEED, paced=False)
    asyncio.set_event_loop(rig.loop)
    operator = Operator(rig)
    operator.run(operator.connect())
    yield operator
    asyncio.set_event_loop(None)
    rig.close()
