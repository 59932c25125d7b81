"""A sound device without sound."""

from __future__ import annotations

from gui.live.spike_clicks import MOST_FRAMES, Frames
from gui.live.spike_sound import Take


class Speaker:
    """A device that a test lets take frames."""

    def __init__(self) -> None:
        self.take: Take | None = None
        self.is_open = False

    def open(self, take: Take) -> Speaker:
        """Open it."""
        self.take, self.is_open = take, True
        return self

    def close(self) -> None:
        """Close it."""
        self.is_open = False

    def listen(self) -> Frames:
        """Return all that waits."""
        assert self.take is not None
        return self.take(MOST_FRAMES)
