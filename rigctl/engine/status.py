"""The status message that clients get ten times a second, built from the engine's parts."""

from __future__ import annotations

from collections import deque
from statistics import fmean, pstdev
from typing import Any

from rigctl.boards.drum_codes import Status
from rigctl.boards.drum_registers import SHOWN
from rigctl.boards.drum_states import FAULT_TEXT, STATE_TEXT, Fault, State
from rigctl.engine.calibration import Calibration
from rigctl.engine.calibrator import READINGS
from rigctl.engine.contact import contact_words, has_status
from rigctl.engine.health import RateMeter, age_s
from rigctl.engine.rig import Rig
from rigctl.engine.rig_boards import RigBoards
from rigctl.engine.rpc.messages import (
    EngineStatus,
    LslScope,
    QueueStatus,
    RecordingStatus,
    RunStatus,
)
from rigctl.engine.setup.served_setup import ServedSetup
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import DrumState

RATE_WINDOW_S = 1.0


class StatusBuilder:
    """Builds the status message of one engine."""

    def __init__(
        self, rig: Rig, boards: RigBoards, calibration: Calibration, setup: ServedSetup
    ) -> None:
        self._rig, self._setup = rig, setup
        self._calibration = calibration
        self._raw_counts: deque[int] = deque(maxlen=READINGS)
        self._layout = SensorLayout.of_rig(rig.config.taxels)
        self._boards = boards
        self._frame_rate = RateMeter(RATE_WINDOW_S)
        self._loadcell_lost = 0
        self._loadcell_lost_s: float | None = None
        self._loadcell_s: float | None = None
        boards.drum_poller.subscribe(self._watch_loadcell)

    def build(
        self,
        now_s: float,
        texture: str | None,
        recording: RecordingStatus,
        run: RunStatus,
        queue: QueueStatus,
        lsl: LslScope,
    ) -> EngineStatus:
        """Return the status at loop time ``now_s``."""
        boards = self._boards
        poller, pipeline, settings = boards.drum_poller, boards.pipeline, boards.motion.settings
        drum = poller.state
        self._frame_rate.update(now_s, pipeline.sample_count)
        fault = Fault(drum.fault if drum else 0)
        state = State(drum.state if drum else State.BOOT)
        return EngineStatus(
            at_s=now_s,
            rig=self._rig.kind,
            simulated=self._rig.simulated,
            texture=texture,
            wrong_wirings=self._rig.wirings,
            drum_connected=poller.connected,
            taxels_connected=boards.taxels_connected,
            state=state,
            state_words=_state_words(drum) if poller.connected and drum else "not connected",
            fault=int(fault),
            fault_words=FAULT_TEXT[fault],
            force_set_g=settings.get("force_set", 0.0),
            speed_set_mm_s=settings.get("speed_set", 0.0),
            is_moved_by_hand=boards.motion.is_moved_by_hand,
            frame_rate_hz=self._frame_rate.per_s,
            lost_samples=pipeline.lost_samples,
            gaps=pipeline.gap_count,
            lost_age_s=age_s(pipeline.last_gap_s, now_s),
            last_block_age_s=age_s(pipeline.last_arrival_s, now_s),
            loadcell_age_s=age_s(self._loadcell_s, now_s),
            poll_retries=poller.drum.modbus.retries,
            loadcell_lost=self._loadcell_lost,
            loadcell_lost_age_s=age_s(self._loadcell_lost_s, now_s),
            clock_ppm={"drum": poller.clock_fit.ppm, "taxels": pipeline.clock_fit.ppm},
            boards=boards.board_health.statuses(),
            sensor_layout=self._layout,
            reading=boards.encoder.parameters.reading,
            wiring=self._rig.config.taxels.order,
            taxel_inputs=self._rig.config.taxels.inputs,
            full_scale=self._rig.config.taxels.full_scale,
            axis_mm=None if self._rig.axis is None else self._rig.axis.height_mm,
            limits=self._rig.config.limits,
            has_taxel_range=boards.has_taxel_range,
            range_from=self._rig.config.taxels.range_from,
            loadcell_calibrated=self._rig.config.loadcell.calibrated,
            scale_ug_per_count=self._rig.config.loadcell.scale_ug_per_count,
            has_taxel_order=self._calibration.has_taxel_order,
            calibration=self._calibration.status(),
            setup=self._setup.status(),
            recording=recording,
            run=run,
            queue=queue,
            lsl=lsl,
            **(self._raw_reading() if self._raw_counts else {}),
            **(_drum_fields(drum, now_s) if drum else {}),
        )

    def _watch_loadcell(self, drum: DrumState) -> None:
        if drum.loadcell_lost:
            self._loadcell_lost += drum.loadcell_lost
            self._loadcell_lost_s = drum.at_s
        if drum.loadcell:
            self._loadcell_s = drum.at_s
            self._raw_counts.extend(sample.raw_counts for sample in drum.loadcell)

    def _raw_reading(self) -> dict[str, Any]:
        """Return mean and spread of the last second of the load cell."""
        return {
            "loadcell_counts": fmean(self._raw_counts),
            "loadcell_sd_counts": pstdev(self._raw_counts),
        }


def _state_words(drum: DrumState) -> str:
    """Return the state and, for a drum that is switched off, whether it still presses."""
    return ", ".join(filter(None, (STATE_TEXT[State(drum.state)], contact_words(drum))))


def _drum_fields(drum: DrumState, now_s: float) -> dict[str, Any]:
    """Return the fields that come from the newest poll."""
    return {
        "force_g": drum.force_g,
        "speed_mm_s": drum.speed_mm_s,
        "steps": drum.steps,
        "angle_deg": drum.angle_deg,
        "actuator_position_um": drum.actuator_position_um,
        "tared": has_status(drum, Status.TARED),
        "commissioned": has_status(drum, Status.COMMISSIONED),
        "homed": has_status(drum, Status.HOMED),
        "contact_may_stand": has_status(drum, Status.CONTACT_MAY_STAND),
        "estop_pressed": not has_status(drum, Status.ESTOP_CLOSED),
        "poll_age_s": now_s - drum.at_s,
        "registers": {entry.name: drum.values[entry.name] for entry in SHOWN},
    }
