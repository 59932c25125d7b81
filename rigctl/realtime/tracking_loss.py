"""Notices that a tracker has found its reference again after a loss that can shift its frame."""

from __future__ import annotations

from rigctl.values import Position

LOSS_S = 0.5
"""A tracker without its reference for longer finds it again with another offset: published for the
VIVE by Niehorster et al. 2017, see docs/reference/virtual-finger.md."""


class TrackingLoss:
    """Follows the validity of positions; what came before the first valid one is no loss."""

    def __init__(self) -> None:
        self._valid_s: float | None = None
        self._invalid_s: float | None = None

    def add(self, position: Position) -> float | None:
        """Return the length of a loss in seconds with the first valid position after it."""
        since_s = self._invalid_s
        if not position.valid:
            if since_s is None and self._valid_s is not None:
                self._invalid_s = position.at_s
            return None
        self._valid_s, self._invalid_s = position.at_s, None
        lost_s = 0.0 if since_s is None else position.at_s - since_s
        return lost_s if lost_s > LOSS_S else None
