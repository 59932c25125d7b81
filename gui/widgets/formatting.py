"""Format sizes and durations as text."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta


def capitalised(text: str) -> str:
    """Return a text with a capital letter in front; all others stay."""
    return text[:1].upper() + text[1:]


def grouped(number: float) -> str:
    """Return a whole number with narrow spaces between thousands: a comma is a decimal mark."""
    return f"{number:,.0f}".replace(",", "\u202f")


def duration(seconds: float) -> str:
    """Return a duration in its two largest units."""
    whole = max(0, round(seconds))
    days, hours, minutes = whole // 86400, whole // 3600 % 24, whole // 60 % 60
    if days:
        return f"{days} d {hours} h"
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {whole % 60:02d} s" if minutes else f"{whole} s"


def size(n_bytes: float) -> str:
    """Return a number of bytes in decimal units."""
    for unit in ("B", "kB", "MB"):
        if n_bytes < 1000:
            return f"{n_bytes:.0f} {unit}"
        n_bytes /= 1000
    if n_bytes < 1000:
        return f"{n_bytes:.1f} GB" if n_bytes < 100 else f"{n_bytes:.0f} GB"
    return f"{n_bytes / 1000:.1f} TB"


def age(seconds: float) -> str:
    """Return an age, in ms below one second."""
    return f"{seconds * 1000:.0f} ms" if seconds < 1 else duration(seconds)


def ago(seconds: float) -> str:
    """Return how long ago something was, in one unit, so that it fits into a narrow cell."""
    if seconds < 100:
        return f"{max(0, seconds):.0f} s ago"
    for unit, unit_s, limit_s in (("min", 60, 6000), ("h", 3600, 180_000)):
        if seconds < limit_s:
            return f"{seconds // unit_s:.0f} {unit} ago"
    return f"{seconds // 86400:.0f} d ago"


def day_time(seconds: float, now: datetime | None = None) -> str:
    """Return the time of day in ``seconds`` from now, with the day unless it is today."""
    now = now or datetime.now()
    then = now + timedelta(seconds=seconds)
    if then.date() == now.date():
        return f"{then:%H:%M}"
    days = (then.date() - now.date()).days
    return f"{then:%H:%M} tomorrow" if days == 1 else f"{then:%H:%M}, in {days} days"


def time_stamp() -> str:
    """Return the present second in UTC, for the name of a folder."""
    return f"{datetime.now(UTC):%Y%m%d-%H%M%S}"
