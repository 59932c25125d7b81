"""The status message of a followed session, from the newest rows of its files."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigctl.acquisition.follow.growing_session import NewRows
from rigctl.acquisition.health.rate_meter import RateMeter
from rigctl.acquisition.rpc.messages import (
    CurrentTrial,
    EngineStatus,
    RecordingStatus,
    RunStatus,
)
from rigctl.session.format import layout
from rigctl.session.read.session import Session
from rigctl.wire.drum.codes import Status
from rigctl.wire.drum.states import FAULT_TEXT, STATE_TEXT, Fault, State

RATE_WINDOW_S = 1.0
QUIET_S = 3.0
"""Without new rows for this long the recorder is said to write nothing."""
_ENDED = {"finished": "done", "stopped": "aborted", "failed": "failed"}


class FollowedStatus:
    """Builds the status of one session. Ages count from the look that brought the newest rows."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._rate = RateMeter(RATE_WINDOW_S)
        self._poll: Any = None
        self._samples = 0
        self._sampled_s: float | None = None
        self._polled_s: float | None = None
        self._outcome = ""
        self.newest_s = 0.0
        """Loop time of the recorder at the newest row, s."""

    def update(self, rows: NewRows, now_s: float) -> None:
        """Take note of new rows that were read at ``now_s``."""
        count = sum(map(len, rows.blocks))
        self._samples += count
        self._rate.update(now_s, self._samples)
        if count:
            self._sampled_s = now_s
        if len(rows.polls):
            self._poll, self._polled_s = rows.polls[-1], now_s
        for event in rows.events:
            self.newest_s = max(self.newest_s, event.at_s)
            ended = event.kind == layout.SESSION_END_KIND
            self._outcome = str(event.data.get("outcome")) if ended else self._outcome
        if self._poll is not None:
            self.newest_s = max(self.newest_s, float(self._poll["at_s"]))

    def build(self, now_s: float) -> EngineStatus:
        """Return the status; ``now_s`` is the clock of :meth:`update`."""
        header = self._session.header
        age_s = _age(self._sampled_s, now_s)
        polled_s = _age(self._polled_s, now_s)
        return EngineStatus(
            at_s=self.newest_s,
            rig=f"following {self._session.path.name}",
            simulated=header.simulated,
            taxels_connected=self._is_growing(age_s),
            frame_rate_hz=self._rate.per_s,
            lost_samples=int(self._session.gaps["count"].sum()),
            gaps=len(self._session.gaps),
            last_block_age_s=age_s,
            poll_age_s=polled_s,
            loadcell_age_s=polled_s,
            sensor_layout=self._session.sensor_layout,
            recording=self._recording(age_s),
            run=self._run(),
            **self._drum(self._is_growing(polled_s)),
        )

    def _is_growing(self, age_s: float | None) -> bool:
        return not self._session.finished and age_s is not None and age_s < QUIET_S

    def _drum(self, is_growing: bool) -> dict[str, Any]:
        poll = self._poll
        if poll is None:
            return {"state_words": "no poll of the drum yet"}
        state = State._value2member_map_.get(int(poll["state"]))
        fault = Fault(int(poll["fault"]))
        bits = int(poll["status_bits"])
        return {
            "drum_connected": is_growing,
            "state": state,
            "state_words": STATE_TEXT[state] if isinstance(state, State) else "unknown state",
            "fault": int(fault),
            "fault_words": FAULT_TEXT[fault],
            "tared": bool(bits >> Status.TARED & 1),
            "homed": bool(bits >> Status.HOMED & 1),
            "steps": int(poll["steps"]),
            "actuator_position_um": int(poll["actuator_position_um"]),
            **{
                name: float(poll[name])
                for name in (
                    *("force_g", "force_set_g", "speed_mm_s", "speed_set_mm_s", "angle_deg"),
                )
            },
        }

    def _recording(self, age_s: float | None) -> RecordingStatus:
        grows = self._is_growing(age_s)
        return RecordingStatus(
            active=grows,
            samples_on_disk=self._session.n_samples,
            samples_last_s=round(self._rate.per_s) if grows else 0,
            folder=str(self._session.path),
        )

    def _run(self) -> RunStatus:
        session = self._session
        rejected = int(np.sum(session.trials["verdict"] == "rejected"))
        state = _ENDED.get(self._outcome, "aborted") if session.finished else "running"
        last = session.trials[-1] if len(session.trials) else None
        return RunStatus(
            state=state,
            trial_id=None if last is None else int(last["trial_id"]),
            trials_planned=session.header.trials_planned,
            trials_committed=len(session.committed()),
            trials_rejected=rejected,
            current=None if last is None else _trial(last),
            session=str(session.path),
        )


def _age(seen_s: float | None, now_s: float) -> float | None:
    return None if seen_s is None else max(0.0, now_s - seen_s)


def _trial(row: Any) -> CurrentTrial:
    """Return the latest attempt, the newest that a session's folder tells of."""
    return CurrentTrial(
        str(row["texture"]),
        float(row["speed_mm_s"]),
        float(row["force_g"]),
        int(row["repeat"]),
        int(row["mount"]),
    )
