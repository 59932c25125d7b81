"""How far the true force may go beyond the force at which a drum board lifts by itself.

What is travelled beyond it is the board's own figure (register ``overrun_um``): the actuator's full
speed, times the sample that has to come, its delay, a tick, and the actuator's lag. What that
travel weighs is the bench's: how stiff the contact is at that force, and how much faster the
actuator is than the board believes.
"""

from __future__ import annotations

import numpy as np

from rigctl.simulation.bench.contact import ForceTable


def overshoot_g(
    overrun_um: float, most_force_g: float, pressed: ForceTable, actuator_share: float = 1.0
) -> float:
    """Grams beyond ``most_force_g`` at most, wherever on the plate the sensor stands.

    ``actuator_share`` is the actuator's true speed over the one that the board is built for.
    """
    travel_mm = overrun_um * 1e-3 * actuator_share
    slope = np.diff(pressed.force_g, axis=0) / pressed.cell_mm
    reached = np.count_nonzero(pressed.force_g < most_force_g, axis=0)
    rows = np.arange(len(slope))[:, None]
    covered = (rows >= reached - 1) & (rows <= reached + travel_mm / pressed.cell_mm)
    covered[-1] = True  # beyond its last row the table goes on as a line
    return travel_mm * float(slope.max(where=covered, initial=0.0))


def linear(stiffness_g_mm: float) -> ForceTable:
    """A contact whose force is in proportion to the travel."""
    return ForceTable(np.array([[0.0], [stiffness_g_mm]], np.float32), 1.0, 0.0)
