"""A protocol on the virtual rig: every trial committed, nothing lost, speed and force true."""

from __future__ import annotations

import numpy as np
from floor import Floor, read


def test_every_trial_is_committed_and_nothing_is_lost(floor: Floor) -> None:
    run = floor.record()
    assert (run.ending, run.complete) == ("done", True)
    with read(floor.session) as session:
        assert session.trials["verdict"].tolist() == ["committed"] * 4
        assert len(session.gaps) == 0
        for index in session.committed():
            window = session.window(int(index))
            assert window.complete
            assert np.all(window.flags & 1)
