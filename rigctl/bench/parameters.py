"""Parameters of the simulated bench, each with unit, plausible range, meaning and source.

This table defines every constant of the simulated world; ``docs/reference/world.md`` is rendered
from it. Values of rig and sensor are as published, those that real recordings show as measured;
unknowns of plate and skin are identified from the paper's Original column and from real skins
(decisions 0018 and 0049); the rest is plausible.
"""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.bench.parameter_fields import ParameterInfo, checked, describe
from rigctl.bench.parameter_fields import parameter as _p
from rigctl.config.rig_config import MAX_TAXELS
from rigctl.errors import WrongUse

PAPER = "published: the paper"
RIG = "published: Chaudhry et al., NER 2023"
SENSOR = "published: Nguyen et al., BioCAS 2018"
RECORDINGS = "measured: recordings of other labs"
IDENTIFIED = "identified"


@dataclass(frozen=True, slots=True)
class Plate:
    """A lab's own plate ``name``; it replaces the catalogue's of that name, if there is one."""

    name: str
    group: str
    height_mm: float = _p(1.0, "mm", 0.1, 4, "height of ridges and waves")
    space_mm: float = _p(6.0, "mm", 1, 20, "distance from ridge to ridge")
    ridge_share: float = _p(0.5, "", 0.1, 0.9, "share of the spacing that a ridge takes")


@dataclass(frozen=True, slots=True)
class WorldParameters:
    """Parameters of one bench. The defaults describe the nominal bench."""

    # Drum
    circumference_mm: float = _p(400.0, "mm", 300, 600, "texture travel of one turn")
    steps_per_turn: float = _p(12800, "steps", 3200, 51200, "200 full steps × 16 × belt 4:1")
    radius_error_ppm: float = _p(0.0, "ppm", -10000, 10000, "true travel over nominal travel")
    start_mm: float = _p(251.0, "mm", 0, 400, "position under the sensor at power-up")
    plate_start_mm: float = _p(10.0, "mm", 5, 20, "start of the plate after the index mark")
    plate_length_mm: float = _p(370.0, "mm", 300, 385, "texture on the plate; the rest is clamp")
    plate_seating_mm: float = _p(0.2, "mm", 0, 1, "spread of a plate's position")
    index_length_mm: float = _p(2.0, "mm", 1, 5, "length of the index mark, from 0")
    run_out_mm: float = _p(0.05, "mm", 0, 0.1, "amplitude of the drum's eccentricity, once a turn")
    run_out_phase_deg: float = _p(40.0, "°", 0, 360, "angle of the eccentricity's rise")

    # Actuator
    actuator_speed_mm_s: float = _p(10.0, "mm/s", 6, 15, "speed at full duty, 24 V")
    actuator_lag_ms: float = _p(30.0, "ms", 15, 50, "first-order lag of its speed")
    dead_band: float = _p(0.08, "duty", 0.02, 0.2, "duty below which nothing moves")
    stiction: float = _p(0.01, "duty", 0, 0.05, "extra duty to break loose from rest")
    backlash_mm: float = _p(0.05, "mm", 0, 0.1, "backlash of the screw")
    drum_weight_g: float = _p(1500.0, "g", 800, 4000, "weight that keeps the screw on one flank")
    actuator_travel_mm: float = _p(50.0, "mm", 40, 60, "from upper to lower end")
    actuator_start_mm: float = _p(5.0, "mm", 0, 30, "position at power-up")

    # Contact
    contact_mm: float = _p(20.0, "mm", 10, 30, "actuator travel at which the drum touches")
    stiffness_g_mm: float = _p(
        600.0, "g/mm", 300, 900, "stiffness of skin and frame, smooth plate, 500 g"
    )
    frame_share: float = _p(
        0.92, "", 0.3, 0.95, "share of that deflection in the frame", IDENTIFIED
    )
    pressure_power: float = _p(1.7, "", 1.5, 2.2, "pressure is this power of the depth", IDENTIFIED)

    # Load cell
    loadcell_rate_hz: float = _p(80.0, "Hz", 80, 80, "conversions a second by its own clock")
    loadcell_clock_ppm: float = _p(8000.0, "ppm", -30000, 30000, "error of its clock, + is fast")
    loadcell_average_ms: float = _p(10.0, "ms", 5, 12, "span that one conversion averages")
    loadcell_ug_per_count: float = _p(2400.0, "µg", 1000, 5000, "weight of one count")
    loadcell_offset_counts: float = _p(80000.0, "counts", -500000, 500000, "drum's weight, bridge")
    loadcell_noise_g: float = _p(0.3, "g", 0, 1, "noise of one conversion, rms")
    loadcell_drift_g: float = _p(0.5, "g", 0, 3, "amplitude of slow drift")
    loadcell_drift_s: float = _p(3600.0, "s", 600, 20000, "period of slow drift")
    loadcell_creep: float = _p(0.0005, "", 0, 0.002, "share of a lasting load that creeps in")
    loadcell_creep_s: float = _p(60.0, "s", 10, 600, "time constant of creep")
    loadcell_drag: float = _p(
        0.0,
        "",
        0,
        0.5,  # above 0.52 no contact force at 40 mm/s reads 1,200 g
        "what drag adds to its reading at 500 g for each 100 mm/s above 60 mm/s, as a share",
        IDENTIFIED,
    )
    imbalance_g: float = _p(1.0, "g", 0, 5, "load-cell reading once a turn, from imbalance")
    moved_mass_g: float = _p(300.0, "g", 0, 1500, "mass whose acceleration the cell feels")

    # Clocks of the boards
    drum_clock_ppm: float = _p(1200.0, "ppm", -5000, 5000, "Mega's clock error, + is fast")
    taxel_clock_ppm: float = _p(-900.0, "ppm", -5000, 5000, "Uno's clock error, + is fast")

    # Textures
    base_height_mm: float = _p(1.2, "mm", 0.5, 2, "height of the base ridges", IDENTIFIED)
    base_space_mm: float = _p(6.2, "mm", 4, 8, "spacing of the base ridges", IDENTIFIED)
    ridge_share: float = _p(0.51, "", 0.3, 0.7, "share of the spacing on a ridge", IDENTIFIED)
    print_roughness_mm: float = _p(0.02, "mm", 0, 0.05, "height noise of the print, rms")

    # Skin
    taxel_pitch_mm: float = _p(5.0, "mm", 5, 5, "distance of taxel centres", PAPER)
    taxel_size_mm: float = _p(3.0, "mm", 3, 3, "width of a taxel, most sensitive inside", SENSOR)
    sensor_skew_deg: float = _p(3.0, "°", -5, 5, "turn of the sensor against the travel")
    edge_drop_mm: float = _p(
        0.1, "mm", 0.05, 0.2, "loss of depth at the outer rows from the drum's curve", IDENTIFIED
    )
    skin_length_mm: float = _p(
        25.5,
        "mm",
        15,
        40,
        "skin along the travel that carries force, the array in its middle",
        IDENTIFIED,
    )
    taxel_rise_mm: float = _p(0.0, "mm", 0, 0.5, "rise of the taxels above the skin between them")
    bridging_mm: float = _p(
        0.31, "mm", 0.2, 1.5, "width over which the skin bridges grooves, sigma", IDENTIFIED
    )
    top_blur_mm: float = _p(
        0.98, "mm", 0.3, 1.5, "spread of pressure above the top layer, sigma", IDENTIFIED
    )
    bottom_blur_mm: float = _p(
        3.3, "mm", 1, 4, "spread of pressure above the bottom layer, sigma", IDENTIFIED
    )
    top_gain: float = _p(
        0.048, "", 0.03, 1, "conductance of a top taxel at the mean pressure of 250 g", IDENTIFIED
    )
    bottom_gain: float = _p(0.09, "", 0.03, 0.8, "the same for a bottom taxel", IDENTIFIED)
    conductance_power: float = _p(
        1.03, "", 0.3, 1.3, "conductance is this power of the pressure", IDENTIFIED
    )
    saturation_g: float = _p(
        9100.0, "g", 500, 12500, "force whose mean pressure halves the conductance", IDENTIFIED
    )
    rest_conductance: float = _p(0.02, "", 0, 0.1, "conductance without load")
    gain_spread: float = _p(0.07, "", 0, 0.4, "spread of gain over the taxels, rms", IDENTIFIED)
    session_spread: float = _p(0.04, "", 0, 0.15, "change of each gain from session to session")
    sensor_tilt_mm: float = _p(
        0.045, "mm", 0, 0.3, "tilt of the sensor a taxel pitch, across the travel", IDENTIFIED
    )
    plate_tilt_mm: float = _p(
        0.015, "mm", 0, 0.1, "tilt of a mounted plate a taxel pitch, each way, rms", IDENTIFIED
    )
    plate_give_mm: float = _p(
        0.021,
        "mm",
        0,
        0.1,
        "tilt that 500 g add to a mounted plate a taxel pitch, each way, rms",
        IDENTIFIED,
    )
    mounting_spread: float = _p(
        0.004, "", 0, 0.03, "change of each gain from mounting to mounting, rms", IDENTIFIED
    )
    contact_shift_mm: float = _p(
        0.4, "mm", 0, 1, "shift of the skin from contact to contact, rms", IDENTIFIED
    )
    contact_spread: float = _p(
        0.03, "", 0, 0.05, "change of each gain from contact to contact, rms", IDENTIFIED
    )
    contact_load_spread: float = _p(
        0.01, "", 0, 0.03, "change of all gains from contact to contact, rms", RECORDINGS
    )
    contact_texture_spread: float = _p(
        0.04, "", 0, 0.08, "change of the sensed texture from contact to contact, rms", RECORDINGS
    )
    viscous_lag_ms: float = _p(2.0, "ms", 2, 20, "lag of the skin's pressure", IDENTIFIED)
    relaxation: float = _p(
        0.15, "", 0, 0.3, "share of the pressure that settles slowly", IDENTIFIED
    )
    relaxation_s: float = _p(1.5, "s", 0.5, 10, "time constant of that share")
    friction_noise: float = _p(0.01, "", 0, 0.05, "jitter of the pressure during sliding, rms")
    divider_kohm: float = _p(
        10.0, "kΩ", 0.8, 47, "resistor at each input; conductances are in units of 1 / 10 kΩ"
    )
    adc_noise_counts: float = _p(0.7, "counts", 0, 3, "noise of one conversion, rms")
    dead_taxels: tuple[int, ...] = ()
    stuck_taxels: tuple[int, ...] = ()
    plates: tuple[Plate, ...] = ()

    @property
    def mm_per_step(self) -> float:
        """Nominal travel of one microstep."""
        return self.circumference_mm / self.steps_per_turn


def parameter_infos(parameters: WorldParameters | None = None) -> list[ParameterInfo]:
    """Return every numeric parameter with its unit, range and meaning, in declaration order."""
    return describe(parameters or WorldParameters())


def validated(parameters: WorldParameters, n_taxels: int = MAX_TAXELS) -> WorldParameters:
    """Return the parameters. Raises WrongUse that names one outside its plausible range.

    ``n_taxels``: taxels of the sensor, where it is known.
    """
    for plate in parameters.plates:
        checked(plate, f"plate {plate.name}")
    for taxel in (*parameters.dead_taxels, *parameters.stuck_taxels):
        if not 0 <= taxel < n_taxels:
            raise WrongUse(f"world: there is no taxel {taxel}: choose 0 to {n_taxels - 1}")
    return checked(parameters, "world")
