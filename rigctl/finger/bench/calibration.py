"""The passport of a virtual finger's sensor, as a calibration on the smooth plate finds it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rigctl.bench.contact import Mounting
from rigctl.bench.parameters import WorldParameters
from rigctl.config.rig_config import PAPER_ARRAY
from rigctl.encoder.reading import Reading
from rigctl.finger.bench.skin import TOP_LAYER, FingerSkin
from rigctl.finger.values import MARKS_MM
from rigctl.session.sensor_passport import SensorPassport, TaxelResponse

SMOOTH_PLATE = "A"
FORCES_G = np.linspace(75.0, 1200.0, 20)
"""Forces of the protocol ``sensor``, up and down."""
STEP_MS, SETTLING_MS = 50, 25
ANOTHER_DAY = 999
"""The sensor is calibrated in a session of its own: its gains have changed a little since."""


@lru_cache(maxsize=16)
def sensor_passport(parameters: WorldParameters, seed: int) -> SensorPassport:
    """Return each taxel's mean counts at each force, and the error by the force's direction."""
    skin = FingerSkin(parameters, 1000 * seed + ANOTHER_DAY)
    skin.begin_slide(0, SMOOTH_PLATE, Mounting(0.0, 0.0, 0.0, np.ones(PAPER_ARRAY.count)))
    pressed_g = np.concatenate([FORCES_G, FORCES_G[::-1]]).repeat(STEP_MS)
    readings = skin.advance(np.linspace(*MARKS_MM, len(pressed_g)), pressed_g)[:, TOP_LAYER]
    steps = readings.reshape(-1, STEP_MS, len(TOP_LAYER))[:, SETTLING_MS:].mean(axis=1)
    both = np.stack([steps[: len(FORCES_G)], steps[len(FORCES_G) :][::-1]])
    curves = both.mean(axis=0)
    shown_g = np.interp(both.sum(axis=2), np.maximum.accumulate(curves.sum(axis=1)), FORCES_G)
    errors = np.sqrt(np.mean(np.square(shown_g / FORCES_G - 1.0), axis=0))
    return SensorPassport(
        sensor=f"virtual finger {seed}",
        begun_utc="",
        session_digest="",
        simulated=True,
        reading=Reading.COUNTS,
        force_g=tuple(FORCES_G.tolist()),
        force_error=tuple(errors.tolist()),
        taxels=tuple(TaxelResponse(tuple(c.tolist()), float(np.ptp(c))) for c in curves.T),
    )
