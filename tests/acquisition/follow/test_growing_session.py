"""A session that grows is read row by row, each once, over plates and a writer that went away."""

from __future__ import annotations

import numpy as np

from rigctl.acquisition.follow.followed_live import FollowedLive
from rigctl.acquisition.follow.followed_status import FollowedStatus
from rigctl.acquisition.follow.growing_session import GrowingSession, NewRows
from rigctl.acquisition.live_buffer import LiveReader, LiveWriter
from rigctl.errors import SessionError
from rigctl.session.session import Session
from tests.acquisition.engine_harness import EngineHarness


def followed(harness: EngineHarness) -> tuple[list[NewRows], FollowedStatus]:
    """Record two plates; return what a follower reads from the first trial on, and its status."""
    rows: list[NewRows] = []
    statuses: list[FollowedStatus] = []

    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: harness.engine.status().run.trials_committed > 0)
        growing = GrowingSession(run.folder)
        status = FollowedStatus(growing.session)
        statuses.append(status)
        while not harness.has_ended():
            take(growing, status, rows)
            await harness.wait(0.5)
        take(growing, status, rows)
        assert status.build(0.0).run.state == "done"
        growing.close()

    harness.run(scenario, harness.request())
    return rows, statuses[0]


def take(growing: GrowingSession, status: FollowedStatus, rows: list[NewRows]) -> None:
    """Take new rows, unless the part's writer is between a row and its flush.

    Only here are both in one process, to which HDF5 shows rows that are not on the disk yet.
    """
    try:
        growing.refresh()
    except SessionError as error:
        if "bytes in a file of" not in str(error):
            raise
        return
    for new in growing.take_rows():
        status.update(new, 0.0)
        rows.append(new)


def test_each_row_is_read_once(harness: EngineHarness) -> None:
    rows, _ = followed(harness)
    counters = np.concatenate([block.counters for new in rows for block in new.blocks])
    events = [event.text for new in rows for event in new.events]
    with Session.open(harness.session) as session:
        assert len(session.parts) == 2
        stored = [part.read("/taxels/counter", 0, part.n_samples) for part in session.parts]
        assert counters.tolist() == np.concatenate(stored).tolist()
        assert events == [event.text for event in session.events]
        assert sum(len(new.polls) for new in rows) == sum(
            part.stored_lengths()["/drum"] for part in session.parts
        )


def test_the_status_is_that_of_the_files(harness: EngineHarness) -> None:
    _, status = followed(harness)
    with Session.open(harness.session) as session:
        ended = FollowedStatus(session)
        growing = GrowingSession(harness.session)
        for new in growing.take_rows():
            ended.update(new, 1.0)
        growing.close()
        built = ended.build(1.0)
    assert built.run.trials_committed == built.run.trials_planned == 4
    assert built.run.current is not None and built.run.current.texture in ("A", "L")
    assert built.recording.samples_on_disk == status.build(1.0).recording.samples_on_disk > 0
    assert not built.recording.active and not built.drum_connected
    assert built.rig == "following session" and built.simulated


def test_the_live_views_get_samples_spikes_and_force(harness: EngineHarness) -> None:
    harness.record()
    writer = LiveWriter(harness.folder / "followed.live")
    growing = GrowingSession(harness.session)
    live = FollowedLive(writer, growing.session)
    for new in growing.take_rows():
        for block in new.blocks:
            live.add_block(block)
        live.add_drum(new.polls, new.loadcell)
    reader = LiveReader(writer.path)
    taxels, drum = reader.taxels(1000), reader.drum(1000)
    with Session.open(harness.session) as session:
        part = session.parts[-1]
        last = part.read("/taxels/samples", part.n_samples - 1000, part.n_samples)
    assert taxels.samples.tolist() == last.tolist()
    assert taxels.spikes.sum() > 0
    assert np.all(np.diff(drum.time_s) > 0) and drum.force_g.max() > 400
    assert set(drum.force_set_g.tolist()) == {500.0}
    growing.close()
    reader.close()
    writer.close()
