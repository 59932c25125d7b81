"""How far the true force may go beyond the force at which a drum board lifts by itself.

What is travelled beyond it is the board's own figure (register ``overrun_um``): the actuator's full
speed, times the sample that has to come, its delay, a tick, and the actuator's lag. What that
travel weighs is the bench's: how stiff the contact is at that force, and how much faster the
actuator is than the board believes.
"""

from __future__ import annotations

import math


def tangent_g_mm(force_g: float, stiffness_g_mm: float, stiffening_per_mm: float) -> float:
    """Slope of force = stiffness · depth · (1 + stiffening · depth) where it weighs ``force_g``."""
    return math.sqrt(stiffness_g_mm**2 + 4 * stiffness_g_mm * stiffening_per_mm * force_g)


def overshoot_g(
    overrun_um: float,
    most_force_g: float,
    stiffness_g_mm: float,
    stiffening_per_mm: float = 0.0,
    actuator_share: float = 1.0,
) -> float:
    """Grams beyond ``most_force_g`` at most.

    ``actuator_share`` is the actuator's true speed over the one that the board is built for.
    """
    travel_mm = overrun_um * 1e-3 * actuator_share
    slope = tangent_g_mm(most_force_g, stiffness_g_mm, stiffening_per_mm)
    return travel_mm * slope + stiffness_g_mm * stiffening_per_mm * travel_mm**2
