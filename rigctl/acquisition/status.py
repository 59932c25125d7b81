"""The status message that clients get ten times a second, built from the engine's parts."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict

from rigctl.acquisition.boards import Boards
from rigctl.acquisition.health.boards import TAXELS, BoardCounters
from rigctl.acquisition.rpc.messages import BoardStatus, EngineStatus, RecordingStatus, RunStatus
from rigctl.acquisition.taxels.clock_fit import ClockFit
from rigctl.values import BoardIdentity
from rigctl.wire.drum.codes import Status, is_abnormal_reset, reset_cause_text
from rigctl.wire.drum.states import FAULT_TEXT, STATE_TEXT, Fault, State

RATE_WINDOW_S = 1.0


class RateMeter:
    """Samples per second over the last second of loop time."""

    def __init__(self) -> None:
        self._counts: deque[tuple[float, int]] = deque()

    def update(self, now_s: float, samples: int) -> float:
        """Return the rate, given the number of samples up to now."""
        self._counts.append((now_s, samples))
        while len(self._counts) > 2 and now_s - self._counts[1][0] >= RATE_WINDOW_S:
            self._counts.popleft()
        first_s, first = self._counts[0]
        return (samples - first) / (now_s - first_s) if now_s > first_s else 0.0


class StatusBuilder:
    """Builds the status message of one engine."""

    def __init__(self, rig: str, simulated: bool, boards: Boards) -> None:
        self._rig = rig
        self._simulated = simulated
        self._boards = boards
        self._rate_meter = RateMeter()
        self._loadcell_lost = 0
        boards.drum_poller.subscribe(lambda state: self._count_lost(state.loadcell_lost))

    def build(
        self, now_s: float, texture: str | None, recording: RecordingStatus, run: RunStatus
    ) -> EngineStatus:
        """Return the status at loop time ``now_s``."""
        boards = self._boards
        poller, pipeline, settings = boards.drum_poller, boards.pipeline, boards.motion.settings
        drum = poller.state
        arrival_s = pipeline.last_arrival_s
        fault = Fault(drum.fault if drum else 0)
        state = State(drum.state if drum else State.BOOT)
        bits = drum.status_bits if drum else 0
        return EngineStatus(
            at_s=now_s,
            rig=self._rig,
            simulated=self._simulated,
            texture=texture,
            drum_connected=poller.connected,
            taxels_connected=boards.taxels_connected,
            state=state,
            state_words=STATE_TEXT[state] if poller.connected else "not connected",
            fault=int(fault),
            fault_words=FAULT_TEXT[fault],
            force_g=drum.force_g if drum else 0.0,
            force_set_g=settings.get("force_set", 0.0),
            speed_mm_s=drum.speed_mm_s if drum else 0.0,
            speed_set_mm_s=settings.get("speed_set", 0.0),
            steps=drum.steps if drum else 0,
            angle_deg=drum.angle_deg if drum else 0.0,
            actuator_position_um=drum.actuator_position_um if drum else 0,
            tared=bool(bits >> Status.TARED & 1),
            homed=bool(bits >> Status.HOMED & 1),
            frame_rate_hz=self._rate_meter.update(now_s, pipeline.sample_count),
            lost_samples=pipeline.lost_samples,
            gaps=pipeline.gap_count,
            last_block_age_s=None if arrival_s is None else now_s - arrival_s,
            poll_age_s=now_s - drum.at_s if drum else None,
            poll_retries=poller.drum.retries,
            loadcell_lost=self._loadcell_lost,
            clock_ppm={"drum": _ppm(poller.clock_fit), "taxels": _ppm(pipeline.clock_fit)},
            boards=self._build_boards(),
            recording=recording,
            run=run,
        )

    def _build_boards(self) -> dict[str, BoardStatus]:
        counters = self._boards.board_health.counters()
        return {
            name: self._build_board(name, identity, counters.get(name))
            for name, identity in self._boards.identities.items()
        }

    def _build_board(
        self, name: str, identity: BoardIdentity, counters: BoardCounters | None
    ) -> BoardStatus:
        taxels, is_taxels = self._boards.taxels, name == TAXELS
        supply_mv = taxels.status.supply_mv if is_taxels and taxels.status else None
        is_tested = is_taxels and taxels.self_test is not None
        return BoardStatus(
            firmware=identity.firmware_version,
            boot_count=identity.boot_count,
            reset=reset_cause_text(identity.reset_cause),
            unwanted=is_abnormal_reset(identity.reset_cause),
            supply_v=supply_mv / 1000 if supply_mv else None,
            self_test=tuple(taxels.findings) if is_tested else None,
            **(asdict(counters) if counters else {}),
        )

    def _count_lost(self, count: int) -> None:
        self._loadcell_lost += count


def _ppm(clock_fit: ClockFit) -> float | None:
    estimate = clock_fit.estimate
    return None if estimate is None else estimate.ppm
