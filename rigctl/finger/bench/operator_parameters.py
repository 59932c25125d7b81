"""Parameters of the person who moves the finger, each with unit, plausible range and source.

Nobody has published how the paper's operator moved, so nearly all numbers are plausible ones, and
none is chosen for an accuracy. A person is imprecise in three ways: from session to session, from
scan to scan, and within a scan. ``docs/reference/virtual-finger.md`` is rendered from this table.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from rigctl.bench.parameter_fields import describe
from rigctl.bench.parameter_fields import parameter as _p
from rigctl.bench.parameter_tables import TABLE_HEAD, table_line

NAMED = "plausible: the paper names the profile"
PACED = "plausible: unverified, movements of one intended speed scatter by 5 to 20 % [7]"
ON_PLATE = "plausible: the sensor stays on a plate of 36 mm"
PRESSED = "published: unnoticed drifts of a finger's force reach 35 % [4]"
HELD = "published: 4 % for a still finger [3]; unnoticed drifts reach 35 % [4]"
FELT = "plausible: a person feels changes from 7 to 10 % on [2]; drifts of 35 % go unnoticed [4]"
BENT = "published: a wrist's angle is known to 4.6 to 5.1° [5, 6], at 50 to 100 mm over the plate"
EXPLORING = "plausible: unverified, fingertips use 0.2 to 1.5 N [8]; this sensor needs more"
VIVE = "published: [1]"
TILTED = "plausible: that there is one, is published [1]"


@dataclass(frozen=True, slots=True)
class OperatorParameters:
    """How a person moves; ``spread`` is the standard deviation of the logarithm."""

    # Speed
    slow_mm_s: float = _p(60.0, "mm/s", 30, 90, "speed of a slow slide between the marks", NAMED)
    medium_mm_s: float = _p(100.0, "mm/s", 70, 140, "the same, medium", NAMED)
    fast_mm_s: float = _p(160.0, "mm/s", 120, 300, "the same, fast", NAMED)
    change_mm: float = _p(120.0, "mm", 40, 200, "travel over which slow becomes fast")
    change_place_mm: float = _p(15.0, "mm", 0, 40, "scatter of the middle of that change, rms")
    speed_session_spread: float = _p(0.05, "", 0, 0.2, "spread of all speeds over sessions", PACED)
    speed_scan_spread: float = _p(0.12, "", 0.05, 0.2, "spread of a speed over scans", PACED)
    speed_wander_spread: float = _p(0.10, "", 0.05, 0.2, "spread of the speed within a scan", PACED)
    speed_wander_s: float = _p(0.3, "s", 0.1, 2, "time in which the speed wanders")
    acceleration_s: float = _p(0.15, "s", 0.05, 0.5, "time from rest to the speed, and back")

    # Path
    run_up_mm: float = _p(25.0, "mm", 15, 35, "travel in contact before and behind the marks")
    run_up_scatter_mm: float = _p(4.0, "mm", 0, 8, "its scatter over scans, rms")
    lateral_session_mm: float = _p(
        1.0, "mm", 0, 4, "distance of the path from the middle, rms", ON_PLATE
    )
    lateral_scan_mm: float = _p(1.0, "mm", 0, 4, "its change from scan to scan, rms", ON_PLATE)
    lateral_wander_mm: float = _p(0.8, "mm", 0, 3, "its wander within a scan, rms", ON_PLATE)
    lateral_wander_s: float = _p(1.0, "s", 0.2, 5, "time in which the path wanders")
    skew_session_deg: float = _p(1.0, "°", 0, 4, "angle of the path to the plate, rms", ON_PLATE)
    skew_scan_deg: float = _p(0.7, "°", 0, 4, "its change from scan to scan, rms", ON_PLATE)
    seating_mm: float = _p(0.5, "mm", 0, 2, "scatter of a plate's place in its holder, rms")

    # Pressure
    force_g: float = _p(400.0, "g", 150, 800, "contact force", EXPLORING)
    force_session_spread: float = _p(0.10, "", 0, 0.35, "its spread over sessions", PRESSED)
    force_scan_spread: float = _p(0.15, "", 0.07, 0.35, "its spread over scans", FELT)
    force_wander_spread: float = _p(0.12, "", 0.04, 0.35, "its spread within a scan", HELD)
    force_wander_s: float = _p(0.4, "s", 0.1, 2, "time in which the force wanders")
    touch_s: float = _p(0.08, "s", 0.03, 0.3, "time from the first touch to the full force")

    # Sensor on the finger
    tilt_attachment_deg: float = _p(
        0.5, "°", 0, 3, "tilt of the sensor to the plate, each way, rms"
    )
    tilt_scan_deg: float = _p(0.25, "°", 0, 2, "its change from scan to scan, rms")
    turn_attachment_deg: float = _p(2.0, "°", 0, 8, "turn of the sensor to the path, rms")
    turn_scan_deg: float = _p(1.0, "°", 0, 5, "its change from scan to scan, rms")
    shift_attachment_mm: float = _p(1.0, "mm", 0, 4, "place of the sensor along the finger, rms")
    attachment_spread: float = _p(0.08, "", 0, 0.3, "change of each gain with each attachment")
    gain_drift_spread: float = _p(0.10, "", 0, 0.4, "change of all gains from session to session")
    rest_drift_spread: float = _p(0.20, "", 0, 0.5, "change of the conductance without load")

    # Wrist, which wears the tracker
    wrist_behind_mm: float = _p(
        140.0, "mm", 80, 200, "distance of the tracker behind the fingertip"
    )
    wrist_above_mm: float = _p(50.0, "mm", 20, 100, "its height over the plate")
    wrist_session_mm: float = _p(2.0, "mm", 0, 9, "change of the grip since the corners, rms", BENT)
    wrist_scan_mm: float = _p(1.5, "mm", 0, 9, "its change from scan to scan, rms", BENT)
    wrist_bend_mm: float = _p(
        4.0, "mm", 0, 9, "bend of the wrist over the marks' distance, rms", BENT
    )
    wrist_wander_mm: float = _p(1.5, "mm", 0, 6, "wander of the wrist within a scan, rms", BENT)
    wrist_wander_s: float = _p(0.6, "s", 0.2, 3, "time in which the wrist wanders")
    corner_touch_mm: float = _p(0.4, "mm", 0, 1, "error of touching a plate's corner, rms")

    # Time between slides
    lower_s: float = _p(0.3, "s", 0.1, 1, "time to get ready, and to bring the finger down")
    lift_s: float = _p(0.2, "s", 0.1, 1, "time to lift it")
    return_s: float = _p(1.0, "s", 0.5, 5, "time in the air back to the start")
    air_mm: float = _p(30.0, "mm", 10, 100, "height in the air")


@dataclass(frozen=True, slots=True)
class TrackerParameters:
    """What the tracker measures of the wrist, and when its measurements arrive."""

    rate_hz: float = _p(100.0, "Hz", 90, 120, "measurements a second")
    noise_mm: float = _p(0.1, "mm", 0, 0.2, "noise of each coordinate, rms", VIVE)
    latency_ms: float = _p(22.0, "ms", 10, 50, "latency that the source knows", VIVE)
    latency_error_ms: float = _p(3.0, "ms", 0, 10, "unknown rest of the latency of a session, rms")
    arrival_jitter_ms: float = _p(1.0, "ms", 0, 5, "mean delay of an arrival; exponential")
    dropouts_per_min: float = _p(2.0, "1/min", 0, 60, "short gaps in the measurements")
    dropout_ms: float = _p(40.0, "ms", 10, 200, "mean length of a gap; exponential")
    frame_tilt_deg: float = _p(
        1.5, "°", 0, 5, "tilt of its frame to the plate, each way, rms", TILTED
    )
    shift_after_loss_mm: float = _p(
        3.0,
        "mm",
        0,
        50,
        "shift of its frame after a loss, rms",
        "published: Niehorster et al. 2017",
    )


PAGE = Path(__file__).parents[3] / "docs" / "reference" / "virtual-finger.md"
BEGIN, END = "<!-- parameters -->\n", "<!-- end of parameters -->"

_GROUPS = {
    "slow_mm_s": "Speed",
    "run_up_mm": "Path",
    "force_g": "Pressure",
    "tilt_attachment_deg": "Sensor on the finger",
    "wrist_behind_mm": "Wrist",
    "lower_s": "Between the slides",
    "rate_hz": "Tracker",
}


def render(page: str) -> str:
    """Return the page with current tables; the text around them is unchanged."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}{_tables()}{END}{rest.partition(END)[2]}"


def _tables() -> str:
    parts = []
    for row in [*describe(OperatorParameters()), *describe(TrackerParameters())]:
        if row.name in _GROUPS:
            parts.append(f"\n### {_GROUPS[row.name]}\n\n{TABLE_HEAD}")
        parts.append(table_line(row))
    return "".join(parts)


def main(arguments: list[str]) -> int:
    """Write the tables, or with ``--check`` return 1 if they are stale."""
    page = PAGE.read_text(encoding="utf-8")
    if "--check" in arguments:
        return int(page != render(page))
    PAGE.write_text(render(page), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
