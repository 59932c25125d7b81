"""What an action came to, as a line of the log; actions have the names of their buttons."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gui.operate.bench_controls import FAULTS, WIRINGS_ON_OFF
from rigctl.acquisition.calibration_values import (
    ForceLoopGains,
    MassReading,
    gains_words,
    imbalance_words,
)

_NAMES = {
    "calibrate_range": "taxel range",
    "test_taxels": "taxel test",
    "calibrate_loadcell": "load cell",
    "calibrate_force": "force loop",
    "calibrate_imbalance": "imbalance",
    "calibrate_wiring": "taxel order",
    "end_record": "record",
    "setup_check": "set up",
    "setup_keep": "set up",
    "setup_commission": "set up",
    "inject": "bench",
}
"""Where a button has other words than its command."""
_DONE = {
    "arm": "armed, lifted",
    "disarm": "lifted, motors off",
    "home": "the index mark is found",
    "tare": "the load cell is at 0 g",
    "approach": "the force is reached",
    "run": "the drum has turned over the plate",
    "retract": "lifted",
    "discard_calibration": "forgotten",
    "clear_fault": "the fault is cleared",
}


def action_name(command: str) -> str:
    """Return the name of an action for people."""
    return _NAMES.get(command, command.replace("_", " "))


def action_result(command: str, result: Mapping[str, Any]) -> str:
    """Return what a command came to, empty for one that is no action of a panel."""
    words = _DONE.get(command) or _measured(command, result)
    return f"{action_name(command)}: {words}" if words else ""


def injected_words(injected: Mapping[str, Any], texts: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the text of an injected fault as its list has it, or the words of the engine."""
    known = (text for text, args in texts.items() if args == injected)
    return next(known, " ".join(str(value).replace("_", " ") for value in injected.values()))


def _measured(command: str, result: Mapping[str, Any]) -> str:
    match command:
        case "jog" if "moved_mm" in result:
            return f"{result['moved_mm']:+.1f} mm".replace("-", "−")
        case "set" if "speed_mm_s" in result and "force_g" in result:
            return f"the drum has {result['speed_mm_s']:.1f} mm/s and {result['force_g']:.0f} g"
        case "calibrate_loadcell" if "mass_g" in result:
            reading = MassReading(**result)
            counts, spread = reading.mean_counts, reading.sd_counts
            return f"{reading.mass_g:g} g: {counts:.0f} counts ± {spread:.0f}"
        case "calibrate_force" if "gain_p_per_s" in result:
            return gains_words(ForceLoopGains(**result))
        case "calibrate_imbalance" if "table_g" in result:
            return imbalance_words(result["table_g"])
        case "calibrate_wiring" if "found" in result:
            return str(result["found"])
        case "save_calibration" if "kept_in" in result:
            saved = f"{result['part']} is saved in {' and '.join(result['kept_in'])}"
            return f"{saved}; {result['remark']}" if result.get("remark") else saved
        case "setup_check" if "part" in result:
            return f"{result['part']} {'is right' if result['passed'] else result['problem']}"
        case "setup_keep" if "says" in result:
            return f"rig.toml says {result['says']}"
        case "setup_commission" if "not_checked" in result:
            return f"commissioned; nobody has checked {', '.join(result['not_checked'])}"
        case "calibrate_range" if "low" in result:
            return f"the ranges of {len(result['low'])} taxels are measured"
        case "plate" if "texture" in result:
            return f"{result['texture']} is on the drum"
        case "inject" if "injected" in result:
            return injected_words(result["injected"], {**FAULTS, **WIRINGS_ON_OFF})
        case "test_taxels" if "found" in result:
            return "; ".join(map(str, result["found"])) or "no findings"
        case "record" if "session" in result:
            return f"recording into {result['session']}"
        case "end_record" if "session" in result:
            return f"{Path(str(result['session'])).name} is closed"
    return ""
