"""Whether the window fits on a screen."""

from __future__ import annotations

MIN_WIDTH_PX, MIN_HEIGHT_PX = 1024, 700


def screen_complaint(width_px: int, height_px: int) -> str:
    """Return why a screen is too small and what helps, empty for one that is large enough."""
    if width_px >= MIN_WIDTH_PX and height_px >= MIN_HEIGHT_PX:
        return ""
    return (
        f"the screen has {width_px} × {height_px} px, the window needs {MIN_WIDTH_PX} × "
        f"{MIN_HEIGHT_PX}: parts of it are beyond the edge; choose a higher resolution, or "
        "View → Text size → 90 %. Esc stops the drum in any case"
    )
