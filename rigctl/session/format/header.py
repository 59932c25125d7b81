"""What is known of a session before its first sample: stored in every part of it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from rigctl.encoding.normalisation import FULL_SCALE
from rigctl.values import N_TAXELS, SAMPLE_RATE_HZ, BoardIdentity

IMPORTED = "import"
"""Name of the rig of recordings from elsewhere."""
CUT_BY_WIRE, CUT_BY_CLOCK = "sync line", "drum clock"
"""What shows the first sample of a trial."""
ADC_COUNTS = f"ADC counts, 0–{FULL_SCALE}"
_PER_TAXEL = ("taxel_low", "taxel_high", "wiring")


@dataclass(frozen=True, slots=True)
class SessionHeader:
    """Who, what, with which rig and which plan.

    ``start_utc`` is an ISO 8601 stamp that the command line took, ``start_loop_s`` the loop
    time at that instant. ``taxel_low`` and ``taxel_high`` are the calibrated range of each
    taxel in stored counts, empty when there was no calibration. ``wiring`` is the reading of the
    taxel wire that each column of the samples holds, empty where that is not told; what an empty
    one means in a session says :mod:`rigctl.session.format.wiring`. ``sample_unit`` says what a
    reading is, ``highest_reading`` how high one can be. ``cut_by``: what showed the first sample of
    a trial, empty where that is not told. ``simulation`` holds what a simulated
    bench needs to be repeated (seed, slice length, parameters) and is empty at a real one.
    """

    plan_hash: str
    seed: int
    trials_planned: int
    rig: str
    simulated: bool
    start_utc: str
    start_loop_s: float = 0.0
    protocol: str = ""
    boards: tuple[BoardIdentity, ...] = ()
    operator: str = ""
    sensor: str = ""
    software_version: str = ""
    software_commit: str = ""
    encoder_preset: str = ""
    n_taxels: int = N_TAXELS
    sample_rate_hz: int = SAMPLE_RATE_HZ
    sample_unit: str = ADC_COUNTS
    highest_reading: int = FULL_SCALE
    taxel_low: tuple[int, ...] = ()
    taxel_high: tuple[int, ...] = ()
    wiring: tuple[int, ...] = ()
    cut_by: str = ""
    simulation: dict[str, Any] = field(default_factory=dict)

    def attributes(self) -> dict[str, str | int | float]:
        """Attributes of a part's root; what is not a plain value is JSON."""
        plain = asdict(self)
        boards = plain.pop("boards")
        plain["simulated"] = int(self.simulated)
        plain["boards"] = json.dumps(boards)
        for name in (*_PER_TAXEL, "simulation"):
            plain[name] = json.dumps(plain[name])
        return plain

    @classmethod
    def from_attributes(cls, attributes: dict[str, Any]) -> SessionHeader:
        """The header that :meth:`attributes` described; unknown attributes are ignored."""
        known = {name: attributes[name] for name in cls.__slots__ if name in attributes}
        known["simulated"] = bool(known["simulated"])
        known["boards"] = tuple(BoardIdentity(**board) for board in json.loads(known["boards"]))
        for name in known.keys() & _PER_TAXEL:
            known[name] = tuple(json.loads(known[name]))
        known["simulation"] = json.loads(known["simulation"])
        return cls(**known)
