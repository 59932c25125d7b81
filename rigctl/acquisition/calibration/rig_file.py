"""What calibrations write into the rig.toml of a bench; everything else in it stays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rigctl.acquisition.calibration.calibration_values import ForceLoopGains, LoadCellScale
from rigctl.config.rig_config import TaxelArray, parse_config
from rigctl.config.text_file import read_text
from rigctl.config.toml_bounds import MAX_BYTES
from rigctl.config.toml_edit import Value, set_keys

BOARD = "the board's EEPROM"
RANGES_REMOVED = "low and high belong to an unknown order and were removed: calibrate them again"


@dataclass(frozen=True, slots=True)
class CalibratedValues:
    """The result of a calibration: settings of the board, and keys of a table of ``rig.toml``.

    ``remark``: a sentence on what else changes, empty where nothing does.
    """

    settings: Mapping[str, float] = field(default_factory=dict)
    table: str = ""
    keys: Mapping[str, Value] = field(default_factory=dict)
    remark: str = ""

    def edited(self, path: Path) -> str:
        """Return the text of ``rig.toml`` with the keys. Raises ConfigError if it is invalid."""
        return edited_rig_file(path, self.table, self.keys)


def edited_rig_file(path: Path, table: str, keys: Mapping[str, Value]) -> str:
    """Return the text of ``rig.toml`` with keys of a table. Raises ConfigError if it is invalid."""
    source = read_text(path, MAX_BYTES)
    parse_config(source, str(path))
    text = set_keys(source, table, keys)
    parse_config(text, str(path))
    return text


def loadcell_values(scale: LoadCellScale, masses_g: Iterable[float], day: str) -> CalibratedValues:
    """Return the scale that a calibration on ``day`` with these masses has found."""
    masses = ", ".join(f"{mass:g} g" for mass in sorted(masses_g) if mass)
    keys: dict[str, Value] = {
        "scale_ug_per_count": scale.ug_per_count,
        "calibrated": f"{day} with {masses}",
    }
    return CalibratedValues({"scale_ug_per_count": scale.ug_per_count}, "loadcell", keys)


def force_values(gains: ForceLoopGains) -> CalibratedValues:
    """Return the gains of the force loop."""
    gain_p, gain_i = gains.gain_p_per_s, gains.gain_i_per_s
    keys: dict[str, Value] = {"gain_p_per_s": gain_p, "gain_i_per_s": gain_i}
    return CalibratedValues({"gain_p": gain_p, "gain_i": gain_i}, "actuator", keys)


def wiring_values(before: TaxelArray, wiring: tuple[int, ...]) -> CalibratedValues:
    """Return the order of the taxels; the ranges of a known order move with their readings."""
    keys: dict[str, Value] = {"wiring": list(wiring)}
    if not before.low:
        return CalibratedValues(table="taxels", keys=keys)
    if not before.wiring:
        keys |= {"low": [], "high": []}
        return CalibratedValues(table="taxels", keys=keys, remark=RANGES_REMOVED)
    places = [before.wiring.index(reading) for reading in wiring]
    keys["low"] = [before.low[place] for place in places]
    keys["high"] = [before.high[place] for place in places]
    return CalibratedValues(table="taxels", keys=keys)
