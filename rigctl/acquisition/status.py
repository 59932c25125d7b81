"""How everything stands, as the message that windows draw ten times a second."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from rigctl.acquisition.health.boards import BoardFigures
from rigctl.acquisition.rpc.messages import BoardStatus, RecordingStatus, RunStatus, StatusData
from rigctl.acquisition.taxels.clock_fit import ClockFit
from rigctl.wire.drum.register_table import Status
from rigctl.wire.drum.states import FAULT_WORDS, Fault, State
from rigctl.wire.reset_causes import reset_words, was_unwanted

if TYPE_CHECKING:
    from rigctl.acquisition.boards import Boards
    from rigctl.values import BoardIdentity

RATE_WINDOW_S = 1.0

STATE_WORDS: dict[State, str] = {
    State.BOOT: "starting",
    State.SELFTEST: "testing itself",
    State.IDLE: "off",
    State.ARMED: "armed, lifted",
    State.POSITION: "moving, lifted",
    State.APPROACH: "pressing down",
    State.HOLD: "in contact, holding the force",
    State.RUN: "in contact, turning",
    State.RETRACT: "lifting off",
    State.FAULT_LIFT: "fault: lifting off",
    State.FAULT_OFF: "fault: switched off",
}


class RateMeter:
    """Samples a second over the last second of loop time."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, int]] = deque()

    def per_s(self, now_s: float, samples: int) -> float:
        """The rate, given how many samples there were up to now."""
        self._seen.append((now_s, samples))
        while len(self._seen) > 2 and now_s - self._seen[1][0] >= RATE_WINDOW_S:
            self._seen.popleft()
        first_s, first = self._seen[0]
        return (samples - first) / (now_s - first_s) if now_s > first_s else 0.0


class StatusBuilder:
    """Gathers the status from those who know it."""

    def __init__(self, rig: str, simulated: bool, boards: Boards) -> None:
        self._rig = rig
        self._simulated = simulated
        self._boards = boards
        self._rate = RateMeter()
        self._loadcell_lost = 0
        boards.watch.watch(lambda state: self._note_lost(state.loadcell_lost))

    def build(
        self, now_s: float, texture: str | None, recording: RecordingStatus, run: RunStatus
    ) -> StatusData:
        """The status at loop time ``now_s``."""
        watch, pump, settings = self._boards.watch, self._boards.pump, self._boards.motion.settings
        state = watch.state
        arrival_s = pump.last_arrival_s
        fault = Fault(state.fault if state else 0)
        known = State(state.state if state else State.BOOT)
        bits = state.status_bits if state else 0
        return StatusData(
            at_s=now_s,
            rig=self._rig,
            simulated=self._simulated,
            texture=texture,
            drum_connected=watch.connected,
            taxels_connected=self._boards.taxels_connected,
            state=int(known),
            state_words=STATE_WORDS[known] if watch.connected else "not connected",
            fault=int(fault),
            fault_words=FAULT_WORDS[fault],
            force_g=state.force_g if state else 0.0,
            force_set_g=settings.get("force_set", 0.0),
            speed_mm_s=state.speed_mm_s if state else 0.0,
            speed_set_mm_s=settings.get("speed_set", 0.0),
            steps=state.steps if state else 0,
            angle_deg=state.angle_deg if state else 0.0,
            actuator_position_um=state.actuator_position_um if state else 0,
            tared=bool(bits >> Status.TARED & 1),
            homed=bool(bits >> Status.HOMED & 1),
            frame_rate_hz=self._rate.per_s(now_s, pump.samples),
            lost_samples=pump.lost_samples,
            gaps=pump.gaps,
            last_block_age_s=None if arrival_s is None else now_s - arrival_s,
            poll_age_s=now_s - state.at_s if state else None,
            poll_retries=watch.drum.retries,
            loadcell_lost=self._loadcell_lost,
            clock_ppm={"drum": _ppm(watch.clock), "taxels": _ppm(pump.clock)},
            boards=self._said_of_themselves(),
            recording=recording,
            run=run,
        )

    def _said_of_themselves(self) -> dict[str, BoardStatus]:
        told = {name: _board(identity) for name, identity in self._boards.identities.items()}
        taxels = self._boards.taxels
        if "taxels" in told and taxels.status is not None:
            millivolts = taxels.status.supply_mv
            told["taxels"]["supply_v"] = millivolts / 1000 if millivolts else None
        if "taxels" in told and taxels.self_test is not None:
            told["taxels"]["self_test"] = taxels.findings
        for name, figures in self._boards.health.figures().items():
            if name in told:
                _add_figures(told[name], figures)
        return told

    def _note_lost(self, count: int) -> None:
        self._loadcell_lost += count


def _board(identity: BoardIdentity) -> BoardStatus:
    return BoardStatus(
        firmware=identity.firmware_version,
        boot_count=identity.boot_count,
        reset=reset_words(identity.reset_cause),
        unwanted=was_unwanted(identity.reset_cause),
        supply_v=None,
        self_test=None,
        late_ticks=None,
        longest_isr_us=None,
        free_stack_bytes=None,
        stack_free_percent=None,
        idle_percent=None,
    )


def _add_figures(told: BoardStatus, figures: BoardFigures) -> None:
    told["late_ticks"] = figures.late_ticks
    told["longest_isr_us"] = figures.longest_isr_us
    told["free_stack_bytes"] = figures.free_stack_bytes
    told["stack_free_percent"] = figures.stack_free_percent
    told["idle_percent"] = figures.idle_percent


def idle_run() -> RunStatus:
    """The run's part of the status while there is none."""
    return RunStatus(
        state="idle",
        text="",
        reasons=[],
        trial_id=None,
        trials_planned=0,
        trials_committed=0,
        trials_rejected=0,
        eta_s=None,
        elapsed_s=0.0,
        current=None,
        prompt=None,
        session=None,
    )


def _ppm(clock: ClockFit) -> float | None:
    estimate = clock.estimate
    return None if estimate is None else estimate.ppm
