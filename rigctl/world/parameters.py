"""The nominal bench in numbers, each with unit, plausible range and meaning.

This table is the single place of every constant of the simulated world;
``docs/reference/world.md`` is rendered from it. Values are chosen from plausibility alone and
were fixed before any classification was looked at.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

from rigctl.errors import WrongUse


class ParameterInfo(NamedTuple):
    """One row of the table: what a parameter is, and how far tests sweep it."""

    name: str
    value: float
    unit: str
    low: float
    high: float
    doc: str


def _p(value: float, unit: str, low: float, high: float, doc: str) -> Any:
    return dataclasses.field(
        default=value, metadata={"unit": unit, "low": low, "high": high, "doc": doc}
    )


@dataclass(frozen=True, slots=True)
class Plate:
    """A plate of a lab's own in the place of the catalogue's ``name``."""

    name: str
    group: str
    height_mm: float = _p(1.0, "mm", 0.1, 4, "of ridges and waves")
    space_mm: float = _p(6.0, "mm", 1, 20, "from ridge to ridge")
    ridge_share: float = _p(0.5, "", 0.1, 0.9, "share of the spacing that a ridge takes")


@dataclass(frozen=True, slots=True)
class WorldParameters:
    """One bench. The defaults are the nominal one."""

    # Drum
    circumference_mm: float = _p(400.0, "mm", 300, 600, "texture travel of one turn")
    steps_per_turn: float = _p(12800, "steps", 3200, 51200, "200 full steps × 16 × belt 4:1")
    radius_error_ppm: float = _p(0.0, "ppm", -10000, 10000, "true travel over nominal travel")
    start_mm: float = _p(251.0, "mm", 0, 400, "place under the sensor at power-up")
    plate_start_mm: float = _p(10.0, "mm", 5, 20, "start of the plate behind the index mark")
    plate_length_mm: float = _p(370.0, "mm", 300, 385, "texture on the plate; the rest is clamp")
    plate_seating_mm: float = _p(0.2, "mm", 0, 1, "spread of where a plate snaps in")
    index_length_mm: float = _p(2.0, "mm", 1, 5, "length of the index mark, from 0")
    run_out_mm: float = _p(0.05, "mm", 0, 0.1, "amplitude of the drum's eccentricity, once a turn")
    run_out_phase_deg: float = _p(40.0, "°", 0, 360, "place of the eccentricity's rise")

    # Actuator
    actuator_speed_mm_s: float = _p(10.0, "mm/s", 6, 15, "speed at full duty, 24 V")
    actuator_lag_ms: float = _p(30.0, "ms", 15, 50, "first-order lag of its speed")
    dead_band: float = _p(0.08, "duty", 0.02, 0.2, "duty below which nothing moves")
    stiction: float = _p(0.01, "duty", 0, 0.05, "more duty to break loose from rest")
    backlash_mm: float = _p(0.05, "mm", 0, 0.1, "play of the screw")
    drum_weight_g: float = _p(1500.0, "g", 800, 4000, "holds the play on one flank below it")
    actuator_travel_mm: float = _p(50.0, "mm", 40, 60, "from upper to lower end")
    actuator_start_mm: float = _p(5.0, "mm", 0, 30, "position at power-up")
    potentiometer_counts: float = _p(1023.0, "counts", 255, 4095, "position over the full travel")

    # Contact
    contact_mm: float = _p(20.0, "mm", 10, 30, "actuator travel at which the drum touches")
    stiffness_g_mm: float = _p(600.0, "g/mm", 300, 900, "of skin and frame at first touch")
    stiffening_per_mm: float = _p(0.1, "1/mm", 0, 0.3, "relative growth of stiffness with depth")
    ripple_share: float = _p(0.3, "", 0, 1, "share of the footprint's mean height felt as depth")

    # Load cell
    loadcell_rate_hz: float = _p(80.0, "Hz", 80, 80, "conversions a second by its own clock")
    loadcell_clock_ppm: float = _p(8000.0, "ppm", -30000, 30000, "its clock fast by so much")
    loadcell_average_ms: float = _p(10.0, "ms", 5, 12, "span that one conversion averages")
    loadcell_ug_per_count: float = _p(2400.0, "µg", 1000, 5000, "weight of one count")
    loadcell_offset_counts: float = _p(80000.0, "counts", -500000, 500000, "drum's weight, bridge")
    loadcell_noise_g: float = _p(0.3, "g", 0, 1, "noise of one conversion, rms")
    loadcell_drift_g: float = _p(0.5, "g", 0, 3, "amplitude of slow drift")
    loadcell_drift_s: float = _p(3600.0, "s", 600, 20000, "period of slow drift")
    loadcell_creep: float = _p(0.0005, "", 0, 0.002, "share of a lasting load that creeps in")
    loadcell_creep_s: float = _p(60.0, "s", 10, 600, "time constant of creep")
    imbalance_g: float = _p(1.0, "g", 0, 5, "load-cell reading once a turn, from imbalance")
    moved_mass_g: float = _p(300.0, "g", 0, 1500, "mass whose acceleration the cell feels")

    # Clocks of the boards
    drum_clock_ppm: float = _p(1200.0, "ppm", -5000, 5000, "Mega's resonator fast by so much")
    taxel_clock_ppm: float = _p(-900.0, "ppm", -5000, 5000, "Uno's resonator fast by so much")

    # Textures
    base_height_mm: float = _p(1.0, "mm", 0.5, 2, "height of the base ridges and waves")
    base_space_mm: float = _p(6.0, "mm", 4, 8, "spacing of the base ridges and waves")
    ridge_share: float = _p(0.5, "", 0.3, 0.7, "share of the spacing that a ridge takes")
    print_roughness_mm: float = _p(0.02, "mm", 0, 0.05, "height noise of the print, rms")

    # Skin
    taxel_pitch_mm: float = _p(5.0, "mm", 5, 5, "distance of taxel centres")
    taxel_size_mm: float = _p(3.0, "mm", 3, 3, "width of a taxel; sensitive most in its middle")
    sensor_skew_deg: float = _p(3.0, "°", -5, 5, "turn of the sensor against the travel")
    top_blur_mm: float = _p(0.5, "mm", 0.3, 1, "spread of pressure above the top layer, sigma")
    bottom_blur_mm: float = _p(1.5, "mm", 1, 3, "spread of pressure above the bottom layer, sigma")
    top_gain: float = _p(0.9, "1/mm", 0.5, 1.5, "conductance of a top taxel per mm of indentation")
    bottom_gain: float = _p(0.5, "1/mm", 0.2, 1, "conductance of a bottom taxel per mm")
    curvature_share: float = _p(0.7, "", 0, 1, "share of the drum's curve that outer rows miss")
    soft_touch_mm: float = _p(0.15, "mm", 0.05, 0.5, "depth at which half of the texture is felt")
    rest_conductance: float = _p(0.02, "", 0, 0.1, "conductance without load")
    gain_spread: float = _p(0.12, "", 0, 0.3, "spread of gain from taxel to taxel, rms")
    session_spread: float = _p(0.04, "", 0, 0.15, "change of each gain from session to session")
    contact_spread: float = _p(0.01, "", 0, 0.05, "change of each gain from contact to contact")
    contact_shift_mm: float = _p(0.15, "mm", 0, 0.5, "shift of the skin from contact to contact")
    viscous_lag_ms: float = _p(6.0, "ms", 2, 20, "lag of the skin's pressure")
    relaxation: float = _p(0.1, "", 0, 0.3, "share of the pressure that settles slowly")
    relaxation_s: float = _p(1.5, "s", 0.5, 10, "time constant of that share")
    friction_noise_mm: float = _p(0.01, "mm", 0, 0.05, "jitter of indentation while it slides")
    crosstalk: float = _p(0.02, "", 0, 0.1, "share of the other lines' signal in a reading")
    adc_noise_counts: float = _p(0.7, "counts", 0, 3, "noise of one conversion, rms")
    dead_taxels: tuple[int, ...] = ()
    stuck_taxels: tuple[int, ...] = ()
    plates: tuple[Plate, ...] = ()

    @property
    def mm_per_step(self) -> float:
        """Nominal travel of one microstep."""
        return self.circumference_mm / self.steps_per_turn


def table(parameters: WorldParameters | None = None) -> list[ParameterInfo]:
    """Every numeric parameter with its unit, range and meaning, in the order of the class."""
    chosen = parameters or WorldParameters()
    return [
        ParameterInfo(
            field.name,
            float(getattr(chosen, field.name)),
            str(field.metadata["unit"]),
            float(field.metadata["low"]),
            float(field.metadata["high"]),
            str(field.metadata["doc"]),
        )
        for field in dataclasses.fields(WorldParameters)
        if field.metadata
    ]


def checked(parameters: WorldParameters) -> WorldParameters:
    """The same parameters. Raises WrongUse naming one that lies outside its plausible range."""
    for row in table(parameters):
        if not row.low <= row.value <= row.high:
            raise WrongUse(
                f"world parameter {row.name} is {row.value:g} {row.unit}: "
                f"choose {row.low:g} to {row.high:g}"
            )
    return parameters
