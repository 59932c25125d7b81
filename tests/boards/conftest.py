"""A loop whose time jumps, for drivers on links in memory."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from tests.boards.memory_link import JumpingLoop


@pytest.fixture
def loop() -> Iterator[JumpingLoop]:
    """Return the loop in which a test that is a coroutine runs."""
    loop = JumpingLoop()
    asyncio.set_event_loop(loop)
    yield loop
    asyncio.set_event_loop(None)
    loop.close()
