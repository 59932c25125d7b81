"""A trained and calibrated experiment, recorded once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from rigctl.finger.models import calibrate_models, train_models
from tests.boards.conftest import loop
from tests.finger.harness import FingerHarness, open_finger_harness
from tests.session.conftest import drum, finger, recorded, session

__all__ = ["drum", "finger", "loop", "recorded", "session"]  # fixtures of the rooms below

MADE_UTC = "2026-01-02T03:04:05+00:00"


@dataclass(frozen=True)
class Trained:
    """Folders of the training session and of a later session's calibration."""

    training: Path
    calibration: Path

    @property
    def model(self) -> Path:
        """The calibrated model."""
        return self.calibration / "model-speed-scaled.h5"


@pytest.fixture
def harness(tmp_path: Path) -> Iterator[FingerHarness]:
    with open_finger_harness(tmp_path) as opened:
        yield opened


@pytest.fixture
def new_session(tmp_path: Path) -> Iterator[FingerHarness]:
    """An engine in the session of the calibration."""
    with open_finger_harness(tmp_path, session=1) as opened:
        yield opened


@pytest.fixture(scope="session")
def trained(made_once: Callable[[str, Callable[[Path], None]], Path]) -> Trained:
    folder = made_once("trained", _train)
    return Trained(folder / "train" / "session", folder / "calibrate" / "session")


def _train(folder: Path) -> None:
    with open_finger_harness(folder / "train") as harness:
        run = harness.record(harness.request("normalise", "train"))
        assert run.text == "every scan is committed"
        training = harness.session
    train_models(training, 10, MADE_UTC)
    with open_finger_harness(folder / "calibrate", session=1) as harness:
        model = training / "model-speed-scaled.h5"
        harness.record(harness.request("calibrate", model=model))
        calibrate_models(training, harness.session)
