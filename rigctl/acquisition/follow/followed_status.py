"""The status message of a followed session of the drum, from the newest rows of its files."""

from __future__ import annotations

from typing import Any

from rigctl.acquisition.follow.followed_growth import FollowedGrowth
from rigctl.acquisition.follow.growing_reader import finite
from rigctl.acquisition.follow.growing_session import NewRows
from rigctl.acquisition.health.rate_meter import age_s
from rigctl.acquisition.rpc.messages import CurrentTrial, EngineStatus, RunStatus
from rigctl.session.session import EARLY_END_KIND, Session, ended_early
from rigctl.wire.drum.codes import Status
from rigctl.wire.drum.states import FAULT_TEXT, STATE_TEXT, Fault, State


class FollowedStatus:
    """Builds the status of one session. Ages count from the look that brought the newest rows."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._growth = FollowedGrowth(session)
        self._poll: Any = None
        self._polled_s: float | None = None
        self._ended_early = len(ended_early(session))

    @property
    def newest_s(self) -> float:
        """Loop time of the recorder at the newest row, s."""
        return self._growth.newest_s

    @property
    def has_ended(self) -> bool:
        """Whether the session was closed in order, at the last look."""
        return self._growth.has_ended

    def update(self, rows: NewRows, now_s: float) -> None:
        """Take note of new rows that were read at ``now_s``."""
        if len(rows.polls):
            self._poll, self._polled_s = rows.polls[-1], now_s
            self._growth.see(finite(self._poll["at_s"]))
        if any(event.kind == EARLY_END_KIND for event in rows.events):
            self._ended_early = len(ended_early(self._session))
        self._growth.update(rows.part, sum(map(len, rows.blocks)), rows.events, now_s)

    def build(self, now_s: float) -> EngineStatus:
        """Return the status; ``now_s`` is the clock of :meth:`update`."""
        header, growth = self._session.header, self._growth
        sampled_s, polled_s = growth.sample_age_s(now_s), age_s(self._polled_s, now_s)
        return EngineStatus(
            at_s=self.newest_s,
            rig=f"following {self._session.path.name}",
            simulated=header.simulated,
            taxels_connected=growth.is_growing(sampled_s),
            frame_rate_hz=growth.rate_hz,
            lost_samples=growth.lost_samples,
            gaps=growth.gaps,
            lost_age_s=growth.lost_age_s(now_s),
            last_block_age_s=sampled_s,
            poll_age_s=polled_s,
            loadcell_age_s=polled_s,
            sensor_layout=self._session.sensor_layout,
            reading=self._session.header.encoder_parameters.reading,
            wiring=self._session.header.wiring,
            recording=growth.recording(now_s),
            run=self._run(),
            **self._drum(growth.is_growing(polled_s)),
        )

    def _drum(self, is_growing: bool) -> dict[str, Any]:
        poll = self._poll
        if poll is None:
            return {"state_words": "no poll of the drum yet"}
        state = State._value2member_map_.get(int(poll["state"]))
        fault = Fault._value2member_map_.get(int(poll["fault"]))
        bits = int(poll["status_bits"])
        return {
            "drum_connected": is_growing,
            "state": state,
            "state_words": STATE_TEXT[state] if isinstance(state, State) else "unknown state",
            "fault": int(poll["fault"]),
            "fault_words": FAULT_TEXT[fault] if isinstance(fault, Fault) else "unknown fault",
            "tared": bool(bits >> Status.TARED & 1),
            "homed": bool(bits >> Status.HOMED & 1),
            "steps": int(poll["steps"]),
            "actuator_position_um": int(poll["actuator_position_um"]),
            **{
                name: finite(poll[name])
                for name in (
                    *("force_g", "force_set_g", "speed_mm_s", "speed_set_mm_s", "angle_deg"),
                )
            },
        }

    def _run(self) -> RunStatus:
        session, growth = self._session, self._growth
        last = session.trials[-1] if len(session.trials) else None
        return RunStatus(
            state=growth.state,
            reasons=growth.run.reasons,
            trial_id=None if last is None else int(last["trial_id"]),
            trials_planned=session.header.trials_planned,
            trials_committed=growth.trials_committed,
            trials_rejected=growth.trials_rejected,
            trials_ended_early=self._ended_early,
            current=None if last is None else _trial(last),
            prompt=growth.run.prompt,
            session=str(session.path),
        )


def _trial(row: Any) -> CurrentTrial:
    """Return the latest attempt, the newest that a session's folder tells of."""
    return CurrentTrial(
        str(row["texture"]),
        finite(row["speed_mm_s"]),
        finite(row["force_g"]),
        int(row["repeat"]),
        int(row["mount"]),
    )
