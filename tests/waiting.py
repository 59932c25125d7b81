"""Wait for another process without taking the processor from it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

LOOK_S = 0.01
_Answer = TypeVar("_Answer")


def until(look: Callable[[], _Answer]) -> _Answer:
    """Look a hundred times a second; return the first answer that is true."""
    while not (answer := look()):
        time.sleep(LOOK_S)
    return answer
