"""A session without a part is awaited only where a recorder has prepared its folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.acquisition.follow.awaited_session import (
    NOTHING_YET,
    AwaitedSession,
    follows_finger,
    is_awaited,
)
from rigctl.acquisition.follow.followed_drum import FollowedDrum
from rigctl.acquisition.follow.growing_session import GrowingSession
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.errors import WrongUse
from tests.acquisition.engine_harness import EngineHarness

DRUM = 'name = "d"\ntextures = ["A"]\nspeeds_mm_s = [40]\nforces_g = [500]\n'
FINGER = 'name = "f"\ntextures = ["A"]\nprofiles = ["medium"]\n'


@pytest.mark.parametrize(("protocol", "is_finger"), [(DRUM, False), (FINGER, True)])
def test_the_protocol_of_a_prepared_folder_names_the_experiment(
    tmp_path: Path, protocol: str, is_finger: bool
) -> None:
    (tmp_path / "protocol.toml").write_text(protocol)
    assert not is_awaited(tmp_path)
    with pytest.raises(WrongUse, match="is not a session"):
        follows_finger(tmp_path)
    (tmp_path / "writer.lock").write_text("1\n")
    assert is_awaited(tmp_path)
    assert follows_finger(tmp_path) is is_finger


def test_the_session_comes_with_its_first_part(harness: EngineHarness, tmp_path: Path) -> None:
    harness.record()
    folder, writer = tmp_path / "awaited", LiveWriter(tmp_path / "followed.live")
    folder.mkdir()
    for name in ("protocol.toml", "writer.lock"):
        (folder / name).write_text(DRUM)
    waiting = EngineStatus(state_words=NOTHING_YET)
    awaited = AwaitedSession(folder, lambda: FollowedDrum(GrowingSession(folder), writer), waiting)
    awaited.refresh()
    assert [event.text for events in awaited.take(0.0) for event in events] == [NOTHING_YET]
    awaited.refresh()
    assert list(awaited.take(0.0)) == [] and awaited.status(0.0) is waiting
    for part in sorted(harness.session.glob("part-*.h5")):
        (folder / part.name).write_bytes(part.read_bytes())
    awaited.refresh()
    assert any(awaited.take(0.0)) and awaited.newest_s > 0
    assert awaited.status(0.0).run.trials_committed == 4
    awaited.close()
    writer.close()
