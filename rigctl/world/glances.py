"""What polls of the virtual drum would show, without the bytes: at many instants at once."""

from __future__ import annotations

from typing import NamedTuple

from rigctl.wire.drum_map import Status
from rigctl.wire.registers import register
from rigctl.world.drum_actuator import END_MM
from rigctl.world.virtual_drum import VirtualDrum

_CHANGING = ~(
    1 << Status.FORCE_SETTLED | 1 << Status.INDEX_HIGH | 1 << Status.END_UP | 1 << Status.END_DOWN
)
_ANGLE, _SPEED, _FORCE = (register(name).scale for name in ("angle", "speed", "force"))


class Shot(NamedTuple):
    """What changes from one millisecond to the next: the rest holds from event to event.

    ``sequence`` numbers the newest conversion of the load cell.
    """

    at_us: int
    sequence: int
    rod_mm: float
    force_g: float
    duty: float
    settled: bool
    index_high: bool


class Glance(NamedTuple):
    """One poll. Times are the world's and the board's own, not wrapped."""

    at_us: int
    board_time_us: int
    state: int
    fault: int
    fault_bits: int
    steps: int
    angle_deg: float
    speed_mm_s: float
    force_g: float
    actuator_position_um: int
    actuator_drive_permille: int
    sync_count: int
    sync_high: bool
    sync_rise_us: int
    sync_fall_us: int
    index_count: int
    status_bits: int
    sequence: int


def shot_of(board: VirtualDrum, at_us: int) -> Shot:
    """The board and the bench as they are."""
    brain, plant = board.controller, board.bench.plant
    cell, settled = brain.cell, brain.presser.settled
    duty = brain.actuator.duty
    return Shot(at_us, cell.sequence, plant.rod_mm, cell.force_g, duty, settled, plant.index_high)


def glances(board: VirtualDrum, shots: list[Shot]) -> list[Glance]:
    """Polls at these instants, between which and now nothing happened on the board."""
    fault_bits = sum(1 << cause for cause in set(board.controller.causes))
    status = board.status_bits & _CHANGING
    return [_glance(board, shot, fault_bits, status) for shot in shots]


def _glance(board: VirtualDrum, shot: Shot, fault_bits: int, status: int) -> Glance:
    brain, turner = board.controller, board.controller.turner
    steps = turner.steps(shot.at_us)
    speed = turner.speed_set_mm_s(shot.at_us, board.registers.settings)
    position_mm = board.bench.plant.potentiometer_at(shot.rod_mm) * brain.actuator.mm_per_count
    status |= shot.settled << Status.FORCE_SETTLED | shot.index_high << Status.INDEX_HIGH
    status |= (shot.rod_mm <= END_MM) << Status.END_UP
    status |= (shot.rod_mm >= brain.actuator.travel_mm - END_MM) << Status.END_DOWN
    return Glance(
        at_us=shot.at_us,
        board_time_us=brain.board_us(shot.at_us),
        state=int(brain.state),
        fault=int(brain.fault),
        fault_bits=fault_bits,
        steps=steps,
        angle_deg=int(36000 * (steps % turner.turn_steps) / turner.turn_steps) * _ANGLE,
        speed_mm_s=round(100 * speed) * _SPEED,
        force_g=max(-32768, min(32767, round(10 * shot.force_g))) * _FORCE,
        actuator_position_um=round(1e3 * position_mm),
        actuator_drive_permille=round(1e3 * shot.duty),
        sync_count=turner.sync_count,
        sync_high=turner.sync_high,
        sync_rise_us=brain.board_us(turner.sync_rise_us),
        sync_fall_us=brain.board_us(turner.sync_fall_us),
        index_count=turner.index_count,
        status_bits=status,
        sequence=shot.sequence,
    )
