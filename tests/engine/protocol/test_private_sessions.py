"""A rig whose sessions are private, and one whose sessions have the system's permissions."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from rigctl.config.rig_config import RecordingConfig, RigConfig
from rigctl.engine.run_request import RunRequest
from rigctl.session.verify import verify
from tests.engine.engine_harness import open_harness, until_ended

PRIVATE = RigConfig(recording=RecordingConfig(private=True))


@pytest.fixture(autouse=True)
def usual_umask() -> Iterator[None]:
    """Begin with the umask of most systems and give the test's own one back."""
    before = os.umask(0o022)
    yield
    os.umask(before)


def modes(folder: Path) -> dict[str, int]:
    """Return the permissions of a session's folder and files by name."""
    paths = {".": folder, **{path.name: path for path in folder.iterdir()}}
    return {name: path.stat().st_mode & 0o777 for name, path in paths.items()}


def require_private(folder: Path) -> None:
    found = modes(folder)
    assert found.pop(".") == 0o700
    assert {"part-0001.h5", "protocol.toml", "rig.toml", "world.h5"} <= set(found)
    assert set(found.values()) == {0o600}


def test_a_private_session_is_the_users_alone(tmp_path: Path) -> None:
    with open_harness(tmp_path, config=PRIVATE) as harness:
        harness.record()
        require_private(harness.session)
        assert verify(harness.session).whole


def test_a_folder_that_is_there_becomes_private(tmp_path: Path) -> None:
    with open_harness(tmp_path, config=PRIVATE) as harness:
        harness.session.mkdir()
        harness.record()
        require_private(harness.session)


def test_without_the_setting_the_umask_decides(tmp_path: Path) -> None:
    with open_harness(tmp_path) as harness:
        harness.record()
        assert set(modes(harness.session).values()) == {0o755, 0o644}


def test_an_open_session_becomes_private_when_it_is_resumed(tmp_path: Path) -> None:
    with open_harness(tmp_path) as harness:

        async def abort(opened: object) -> None:
            await harness.until(lambda: harness.engine.status().run.trials_committed > 0)
            assert harness.engine.run is not None
            harness.engine.run.control.abort("the test is over")
            await until_ended(harness)

        harness.run(abort, harness.request())
    again = tmp_path / "again"
    again.mkdir()
    with open_harness(again, config=PRIVATE) as harness:
        harness.run(until_ended, RunRequest(resume=str(tmp_path / "session"), yes=True))
    require_private(tmp_path / "session")
