"""A session of the moving finger that only its user can read."""

from __future__ import annotations

import os
from dataclasses import replace

from rigctl.config.rig_config import RecordingConfig
from tests.finger.harness import ONE_SCAN, FingerHarness


def test_a_private_finger_session_is_the_users_alone(harness: FingerHarness) -> None:
    harness.rig.config = replace(harness.rig.config, recording=RecordingConfig(private=True))
    before = os.umask(0o022)
    try:
        harness.record(harness.request(protocol=ONE_SCAN))
    finally:
        os.umask(before)
    assert harness.session.stat().st_mode & 0o777 == 0o700
    modes = {path.name: path.stat().st_mode & 0o777 for path in harness.session.iterdir()}
    assert "part-0001.h5" in modes
    assert set(modes.values()) == {0o600}
