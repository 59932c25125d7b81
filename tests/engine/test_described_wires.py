"""A simulated rig has the wires of its description, the emergency stop included."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.config.rig_config import Inverted, RigConfig, Signals
from rigctl.errors import ConfigError
from rigctl.rig import open_rig
from tests.engine.engine_harness import TINY, open_harness


@pytest.mark.parametrize("kind", ["virtual", "firmware"])
def test_a_rig_without_an_emergency_stop_runs(tmp_path: Path, kind: str) -> None:
    config = RigConfig(signals=Signals(estop=False))
    protocol = TINY.replace('"A", "L"', '"A"').replace("100, 120", "120")
    with open_harness(tmp_path, rig_kind=kind, config=config) as harness:
        assert harness.record(protocol).complete


def test_a_stop_that_closes_when_it_is_pressed_is_refused_in_a_sentence() -> None:
    config = RigConfig(inverted=Inverted(estop=True))
    with pytest.raises(ConfigError, match=r"leave \[inverted\] estop out"):
        open_rig("virtual", config=config)
