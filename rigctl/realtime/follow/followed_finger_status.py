"""The status message of a followed session of the moving finger, from the rows of its files."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from rigctl.acquisition.follow.followed_growth import FollowedGrowth
from rigctl.acquisition.follow.growing_reader import finite
from rigctl.acquisition.health.rate_meter import age_s
from rigctl.errors import RigctlError
from rigctl.protocol.finger_plan import FingerProtocol, parse_finger_protocol
from rigctl.realtime.follow.growing_finger_session import NewFingerRows
from rigctl.realtime.latency import KINDS, LatencyLog
from rigctl.realtime.messages import (
    NOMINAL_QUALITY,
    CurrentScan,
    FingerEngineStatus,
    FingerRunStatus,
)
from rigctl.realtime.scan.contact_meter import ContactMeter
from rigctl.session.finger_session import FingerSession
from rigctl.session.layout import PROTOCOL_FILE
from rigctl.session.part import StructuredArray
from rigctl.values import Event, Verdict
from rigctl.wire.finger.messages import SampleFlag, VelocitySource


class FollowedFingerStatus:
    """Builds the status of one session. Ages count from the look that brought the newest rows."""

    def __init__(self, session: FingerSession) -> None:
        self._session = session
        self._growth = FollowedGrowth(session)
        self._protocol = _protocol_of(session)
        self._contact, self._latencies = ContactMeter(), LatencyLog()
        self._position: Any = None
        self._positioned_s: float | None = None
        self._late = self._dropouts = self._outliers = 0
        self._stage = self._texture = self._profile = ""
        self._is_scanning = False
        self._named: dict[str, dict[str, int]] = {}
        self.velocity_mm_s = 0.0

    @property
    def newest_s(self) -> float:
        """Loop time of the recorder at the newest row, s."""
        return self._growth.newest_s

    @property
    def has_ended(self) -> bool:
        """Whether the session was closed in order, at the last look."""
        return self._growth.has_ended

    def update(self, rows: NewFingerRows, now_s: float) -> None:
        """Take note of new rows that were read at ``now_s``."""
        for block, _ in rows.blocks:
            self._contact.add(block.readings)
            self._is_scanning = bool(block.flags[-1] & SampleFlag.IN_SCAN)
        if len(rows.track):
            self._position, self._positioned_s = rows.track[-1], now_s
            self._growth.see(finite(self._position["at_s"]))
        for row in rows.latencies:
            if row["kind"] in KINDS and np.isfinite(row["ms"]):
                self._latencies.add(str(row["kind"]), float(row["ms"]))
        self._count_batches(rows.batches)
        for event in rows.events:
            self._take_task(event)
        samples = sum(len(block.counters) for block, _ in rows.blocks)
        self._growth.update(rows.part, samples, rows.events, now_s)
        self._named = self._confusion()

    def build(self, now_s: float) -> FingerEngineStatus:
        """Return the status; ``now_s`` is the clock of :meth:`update`."""
        growth, header = self._growth, self._session.header
        sampled_s, position_s = growth.sample_age_s(now_s), age_s(self._positioned_s, now_s)
        return FingerEngineStatus(
            at_s=self.newest_s,
            rig=f"following {self._session.path.name}",
            simulated=header.simulated,
            finger_connected=growth.is_growing(sampled_s),
            tracker_connected=growth.is_growing(position_s),
            tracker=str(header.tracker.get("name", "tracker")),
            sample_rate_hz=growth.rate_hz,
            lost_samples=growth.lost_samples,
            lost_age_s=growth.lost_age_s(now_s),
            block_age_s=sampled_s,
            velocity_mm_s=self.velocity_mm_s,
            in_contact=self._contact.touches,
            late_velocities=self._late,
            dropouts=self._dropouts,
            outliers=self._outliers,
            latency_p99_ms=self._latencies.percentiles(99.0),
            recording=growth.recording(now_s),
            run=self._run(),
            **_place(self._position, position_s),
        )

    def _count_batches(self, batches: StructuredArray) -> None:
        late = (batches["velocity_source"] != VelocitySource.RECEIVED) & (batches["sent_s"] > 0)
        self._late += int(np.sum(late))
        self._dropouts += int(batches["dropouts"].sum())
        self._outliers += int(batches["outliers"].sum())

    def _take_task(self, event: Event) -> None:
        if event.kind == "stage":
            self._stage = str(event.data.get("stage", ""))
        elif event.kind == "instruction":
            self._texture = str(event.data.get("texture", "?"))
            self._profile = str(event.data.get("profile", ""))

    def _run(self) -> FingerRunStatus:
        growth, known = self._growth, self._protocol
        planned = self._session.header.trials_planned
        state = growth.state
        return FingerRunStatus(
            state=state,
            text="the session has ended" if growth.has_ended else "",
            reasons=growth.run.reasons,
            trials_planned=planned,
            trials_committed=growth.trials_committed,
            trials_rejected=growth.trials_rejected,
            scan=None if growth.has_ended else self._scan(),
            prompt=growth.run.prompt,
            session=str(self._session.path),
            textures=() if known is None else known.textures,
            classified=sum(sum(named.values()) for named in self._named.values()),
            correct=sum(named.get(true, 0) for true, named in self._named.items()),
            confusion=self._named,
            quality=NOMINAL_QUALITY if known is None else known.quality,
        )

    def _scan(self) -> CurrentScan | None:
        if not self._texture:
            return None
        trials = self._session.trials
        same = (trials["texture"] == self._texture) & (trials["profile"] == self._profile)
        tried = trials[same & (trials["stage"] == self._stage)]
        done = int(np.sum(tried["verdict"] == Verdict.COMMITTED.value))
        attempt = 1 + int(tried["attempt"][-1]) if _last_failed(tried) else 1
        return CurrentScan(
            self._stage, self._texture, self._profile, done + 1, attempt, self._is_scanning
        )

    def _confusion(self) -> dict[str, dict[str, int]]:
        """Return the committed scans by true and named texture."""
        trials = self._session.trials
        known = () if self._protocol is None else self._protocol.textures
        named: dict[str, dict[str, int]] = {true: dict.fromkeys(known, 0) for true in known}
        for row in trials[self._session.committed()]:
            true, predicted = str(row["texture"]), str(row["predicted"])
            if predicted:
                counts = named.setdefault(true, {})
                counts[predicted] = counts.get(predicted, 0) + 1
        return named


def _last_failed(tried: StructuredArray) -> bool:
    return bool(len(tried) and tried["verdict"][-1] != Verdict.COMMITTED.value)


def _protocol_of(session: FingerSession) -> FingerProtocol | None:
    """Return the session's protocol, None for one that this program cannot read."""
    with suppress(RigctlError):
        return parse_finger_protocol(session.protocol_text, PROTOCOL_FILE)
    return None


def _place(position: Any, position_s: float | None) -> dict[str, Any]:
    """Return the fields of the newest position."""
    if position is None:
        return {}
    names = ("along_mm", "across_mm", "height_mm")
    is_valid = bool(position["valid"]) and all(np.isfinite(position[name]) for name in names)
    places = {name: finite(position[name]) for name in names}
    return {"position_age_s": position_s, "position_valid": is_valid, **places}
