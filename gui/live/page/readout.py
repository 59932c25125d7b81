"""The values at the cursor, and their differences from the reference."""

from __future__ import annotations

import numpy as np

from gui.live.live_data import LiveData
from gui.live.store.time_window import TimeWindow
from gui.live.value_scale import ValueScale
from rigctl.values import SAMPLE_RATE_HZ

HINT = "Point at the plots for values · click: reference · drag: move · wheel: zoom"


def cursor_text(
    data: LiveData, window: TimeWindow, position: int | None, taxel: int, scale: ValueScale
) -> str:
    """Return the values at a position; a hint without one."""
    if position is None:
        return HINT
    parts = [f"Cursor {_signed((position - window.origin) / SAMPLE_RATE_HZ, 3)} s"]
    if (drum := data.drum.at(position)) is not None:
        parts += [f"force {drum['force_g']:.1f} g", f"speed {drum['speed_mm_s']:.1f} mm/s"]
    reading = data.reading_at(position, taxel)
    shown = "no sample" if reading is None else f"{scale.text(reading)} {scale.unit}"
    parts.append(f"T{taxel + 1} {shown}")
    near = data.marks.nearest(position, window.span // 100)
    return " · ".join(parts + ([near.text] if near is not None else [])).replace(" -", " −")


def difference_text(
    data: LiveData, position: int | None, reference: int | None, taxel: int, scale: ValueScale
) -> str:
    """Return what changed from the reference to a position; empty without both."""
    if position is None or reference is None:
        return ""
    parts = [f"From the reference {_signed((position - reference) / SAMPLE_RATE_HZ, 3)} s"]
    drums = [data.drum.at(reference), data.drum.at(position)]
    if drums[0] is not None and drums[1] is not None:
        parts.append(f"{_signed(drums[1]['force_g'] - drums[0]['force_g'], 1)} g")
        parts.append(f"{_signed(drums[1]['speed_mm_s'] - drums[0]['speed_mm_s'], 1)} mm/s")
    readings = [data.reading_at(at, taxel) for at in (reference, position)]
    if readings[0] is not None and readings[1] is not None:
        change = scale.text(readings[1] - readings[0], signed=True)
        parts.append(f"T{taxel + 1} {change} {scale.unit}")
    first, last = sorted((reference, position))
    counts = _spikes_between(data, first, last, taxel)
    return " · ".join([*parts, f"SA {counts[0]}, RA {counts[1]} spikes"])


def _spikes_between(data: LiveData, first: int, last: int, taxel: int) -> tuple[int, int]:
    spikes = data.spikes_before(last, last - first + 1)
    n_taxels = spikes.shape[1] // 2
    columns = spikes[:, [taxel, n_taxels + taxel]].sum(axis=0, dtype=np.int64)
    return int(columns[0]), int(columns[1])


def _signed(value: float, digits: int) -> str:
    return f"{value:+.{digits}f}".replace("-", "−")
