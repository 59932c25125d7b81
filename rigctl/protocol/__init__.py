"""Trial protocols: parse ``protocols/*.toml`` into a plan of ordered steps."""

from rigctl.protocol.loader import load_protocol, parse_protocol
from rigctl.protocol.plan import FreeStep, Plan, Protocol, Quality, Settle
from rigctl.protocol.steps import (
    ApproachOnly,
    Baseline,
    ChangePlate,
    Message,
    Rest,
    RunTrial,
    Step,
    Tare,
    Turn,
)

__all__ = [
    "ApproachOnly",
    "Baseline",
    "ChangePlate",
    "FreeStep",
    "Message",
    "Plan",
    "Protocol",
    "Quality",
    "Rest",
    "RunTrial",
    "Settle",
    "Step",
    "Tare",
    "Turn",
    "load_protocol",
    "parse_protocol",
]
