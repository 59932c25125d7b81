"""What an action of the Operate panel came to, as a line of the log."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

_DONE = {
    "arm": "armed, lifted",
    "disarm": "lifted, motors off",
    "home": "the index mark is found",
    "tare": "the load cell is at 0 g",
    "approach": "the force is reached",
    "run": "the drum has turned over the plate",
    "retract": "lifted",
    "clear_fault": "the fault is cleared",
}


def action_result(command: str, result: Mapping[str, Any]) -> str:
    """Return what a command came to, empty for one that is no action of the panel."""
    words = _DONE.get(command) or _measured(command, result)
    return f"{command.replace('_', ' ')}: {words}" if words else ""


def _measured(command: str, result: Mapping[str, Any]) -> str:
    match command:
        case "jog" if "moved_mm" in result:
            return f"{result['moved_mm']:+.1f} mm".replace("-", "−")
        case "set" if "speed_mm_s" in result and "force_g" in result:
            return f"the drum has {result['speed_mm_s']:.1f} mm/s and {result['force_g']:.0f} g"
        case "calibrate_range" if "low" in result:
            return f"the ranges of {len(result['low'])} taxels are measured"
        case "test_taxels" if "found" in result:
            return "; ".join(map(str, result["found"])) or "no findings"
        case "record" if "session" in result:
            return f"recording into {result['session']}"
        case "end_record" if "session" in result:
            return f"{Path(str(result['session'])).name} is closed"
    return ""
