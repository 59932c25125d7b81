"""Compute how far the true force may exceed the force at which a drum board lifts.

The board reports the travel beyond that force in the register ``overrun_um``: the actuator's full
speed times the sum of a sample period, its delay, a tick, and the actuator's lag. The
force of that travel depends on the bench: on the stiffness of its contact, and on how much faster
its actuator is than the board assumes.
"""

from __future__ import annotations

import numpy as np

from rigctl.bench.contact import ForceTable


def overshoot_g(
    overrun_um: float, most_force_g: float, pressed: ForceTable, actuator_share: float = 1.0
) -> float:
    """Return the highest force beyond ``most_force_g``, g, at any place on the plate.

    ``actuator_share`` is the actuator's true speed over the speed that the board assumes.
    """
    travel_mm = overrun_um * 1e-3 * actuator_share
    slope = np.diff(pressed.force_g, axis=0) / pressed.cell_mm
    reached = np.count_nonzero(pressed.force_g < most_force_g, axis=0)
    rows = np.arange(len(slope))[:, None]
    covered = (rows >= reached - 1) & (rows <= reached + travel_mm / pressed.cell_mm)
    covered[-1] = True  # the table is extrapolated beyond its last row
    return travel_mm * float(slope.max(where=covered, initial=0.0))


def linear(stiffness_g_mm: float) -> ForceTable:
    """Return a contact with a force proportional to the travel."""
    return ForceTable(np.array([[0.0], [stiffness_g_mm]], np.float32), 1.0, 0.0)
