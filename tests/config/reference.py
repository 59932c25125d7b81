"""The tables of docs/reference/rig-toml.md, finger-toml.md and of the finger in protocols.md.

``python -m tests.config.reference`` prints them.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from rigctl.config.rig_config import RigConfig
from rigctl.finger.config import FingerConfig
from rigctl.finger.plan import ScanQuality, StageRepeats


def section(name: str, kind: type[Any]) -> str:
    return "\n".join([f"## `[{name}]`", "", (kind.__doc__ or "").strip(), "", rows(kind)])


def rows(kind: type[Any]) -> str:
    """Return the table of a section's keys."""
    lines = ["| key | default | unit | range | meaning |", "|---|---|---|---|---|"]
    lines += [f"| `{item.name}` | {_default(item)} |{_bounds(item)}" for item in fields(kind)]
    return "\n".join(lines)


def sections() -> list[str]:
    return [section(item.name, type(item.default)) for item in fields(RigConfig)]


def finger_sections() -> list[str]:
    config = FingerConfig()
    return [
        section(item.name, type(getattr(config, item.name)))
        for item in fields(FingerConfig)
        if item.name != "text"
    ]


def _default(item: Any) -> str:
    if isinstance(item.default, bool):
        return str(item.default).lower()
    if isinstance(item.default, str):
        return f'`"{item.default}"`'
    return "`[]`" if isinstance(item.default, tuple) else f"{item.default:g}"


def _bounds(item: Any) -> str:
    meta = item.metadata
    reach = f"{meta['low']:g} to {meta['high']:g}" if "low" in meta else "–"
    return f" {meta['unit'] or '–'} | {reach} | {meta['doc']} |"


if __name__ == "__main__":
    print("\n\n".join([*sections(), *finger_sections(), rows(StageRepeats), rows(ScanQuality)]))
