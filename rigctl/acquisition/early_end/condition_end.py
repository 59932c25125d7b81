"""The decision that a condition ends, as a process or a client sends it to the engine."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from rigctl.acquisition.rpc.commands import Number, TextureName
from rigctl.protocol.early_end import QUANTITY_NAMES, Condition, EarlyEnd

Amount = Annotated[float, Meta(ge=0, le=1e6)]


class ConditionEnd(Struct, frozen=True, forbid_unknown_fields=True):
    """A condition, and the mean of its first ``trials`` trials with half its interval."""

    texture: TextureName
    speed_mm_s: Amount
    force_g: Amount
    depth_mm: Amount
    trials: Number
    mean_hz: Amount
    half_width_hz: Amount

    @property
    def condition(self) -> Condition:
        """Plate, speed, force and depth."""
        return self.texture, self.speed_mm_s, self.force_g, self.depth_mm

    def describe(self, rule: EarlyEnd) -> str:
        """Return why the condition ends."""
        press = f"{self.depth_mm:g} mm" if self.depth_mm else f"{self.force_g:g} g"
        return (
            f"{self.texture}, {self.speed_mm_s:g} mm/s, {press} ends early after {self.trials} "
            f"trials: {QUANTITY_NAMES[rule.of]} {self.mean_hz:.2f} ± {self.half_width_hz:.2f} Hz"
        )
