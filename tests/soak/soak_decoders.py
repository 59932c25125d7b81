"""Ten million bytes through each decoder of a byte stream, disturbed, against the truth.

``make fuzz`` runs it and prints the table; a short form is ``tests/boards/test_disturbed.py``.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.boards.disturbance import DISTURBANCES, Disturbance
from tests.boards.disturbed_boards import HEADING, Judgement, run_finger, run_taxels
from tests.boards.disturbed_drum import run_drum
from tests.boards.disturbed_trackers import run_tracker

N_BYTES = 10_000_000
BOOT_SAMPLES = 50_000
SEED = 18
EACH = pytest.mark.parametrize("how", DISTURBANCES, ids=lambda how: how.name)


@pytest.fixture(scope="module", autouse=True)
def heading() -> None:
    print(f"\n{HEADING}")


@EACH
@pytest.mark.parametrize("run", [run_taxels, run_finger])
def test_boards_that_stream(
    run: Callable[[Disturbance, int, int, int], Judgement], how: Disturbance
) -> None:
    judgement = run(how, N_BYTES, SEED, BOOT_SAMPLES)
    print(judgement)
    assert judgement.holds
    assert judgement.samples > 0.98 * judgement.intact


# These decoders share the bytes among the mixtures: their world has a clock that must pass.
@EACH
def test_the_drum(how: Disturbance) -> None:
    judgement = run_drum(how, N_BYTES // len(DISTURBANCES), SEED)
    print(judgement)
    assert judgement.holds


@EACH
@pytest.mark.parametrize("kind", ["lines", "datagrams", "IMU"])
def test_trackers(kind: str, how: Disturbance) -> None:
    judgement = run_tracker(kind, how, N_BYTES // len(DISTURBANCES), SEED)
    print(judgement)
    assert judgement.holds
