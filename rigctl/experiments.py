"""The experiments by name, and what each of them provides to the rooms below its package.

No room imports the package of an experiment, which stands above all of them. A room that meets a
session, a protocol, a board or a command of an experiment loads what it needs from here.
"""

from __future__ import annotations

from collections.abc import Mapping
from pkgutil import resolve_name
from typing import Any, NamedTuple

from rigctl.config.toml_reader import TomlTable

DRUM_EXPERIMENT, FINGER_EXPERIMENT = "drum", "finger"


class Experiment(NamedTuple):
    """Its name in a sentence, the commands of its sessions, and where its parts are found.

    ``protocol_keys``: keys that no other protocol has.
    """

    title: str
    recorded_by: str
    analysed_by: str
    protocol_keys: tuple[str, ...]
    parts: Mapping[str, str]

    def load(self, part: str) -> Any:
        """Return a part; its module is imported now."""
        return resolve_name(self.parts[part])


EXPERIMENTS: Mapping[str, Experiment] = {
    DRUM_EXPERIMENT: Experiment(
        "the drum",
        "rigctl run",
        "rigctl analyse",
        (),
        {
            "layout": "rigctl.session.layout:DRUM_LAYOUT",
            "reader": "rigctl.session.session:Session",
            "live": "rigctl.engine.live_file:LiveReader",
            "raster": "rigctl.cli.session_looks:trial_raster",
            "plates": "rigctl.bench.plate_solids:write_drum_plates",
        },
    ),
    FINGER_EXPERIMENT: Experiment(
        "the moving finger",
        "rigctl realtime",
        "rigctl analyse --experiment realtime",
        ("profiles", "stages", "reference_mm_s"),
        {
            "layout": "rigctl.finger.layout:FINGER_LAYOUT",
            "reader": "rigctl.finger.session:FingerSession",
            "live": "rigctl.finger.live_file:FingerLiveReader",
            "raster": "rigctl.finger.cli.raster:scan_raster",
            "check_part": "rigctl.finger.verify:check_finger_part",
            "check_plan": "rigctl.finger.verify:check_finger_plan",
            "summarise": "rigctl.finger.summary:summarise_finger",
            "field_groups": "rigctl.finger.plan:finger_groups",
            "driver": "rigctl.finger.driver:Finger",
            "trackers": "rigctl.finger.trackers.open_tracker:TRACKERS",
            "firmware": "rigctl.finger.bench.firmware:FingerFirmware",
            "plates": "rigctl.finger.bench.plates:write_flat_plates",
            "settings": "rigctl.finger.analysis.settings:FingerAnalysisSettings",
            "report": "rigctl.finger.analysis.report:report_on",
            "check": "rigctl.finger.cli.check:check_protocol",
            "serve": "rigctl.finger.cli.serve:serve_finger",
        },
    ),
}


def protocol_key(root: TomlTable) -> tuple[Experiment, str]:
    """Return the experiment of a protocol, and the key that says so; "" in one of the drum."""
    for experiment in EXPERIMENTS.values():
        for key in experiment.protocol_keys:
            if key in root:
                return experiment, key
    return EXPERIMENTS[DRUM_EXPERIMENT], ""
