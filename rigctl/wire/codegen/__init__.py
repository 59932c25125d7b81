"""Generate the firmware's headers and the reference page from the drum's tables."""

from __future__ import annotations

from pathlib import Path

from rigctl.wire.codegen.cpp_headers import register_header, state_header
from rigctl.wire.codegen.reference_page import reference_page

CHECKOUT = Path(__file__).resolve().parents[3]


def generate() -> dict[str, str]:
    """Return the text of every generated file by its path in the checkout."""
    return {
        "docs/reference/drum-wire.md": reference_page(),
        "arduino/drum/drum_map.h": register_header(),
        "arduino/drum/drum_states.h": state_header(),
    }


def find_stale(checkout: Path = CHECKOUT) -> dict[str, str]:
    """Return the generated files that are missing or outdated: the new text by path."""
    return {path: text for path, text in generate().items() if _read(checkout / path) != text}


def _read(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.is_file() else None
