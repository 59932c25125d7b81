"""Write the generated files, or with ``--check`` only list those that are stale."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rigctl.boards.codegen.cpp_headers import reference_page, register_header, state_header

CHECKOUT = Path(__file__).resolve().parents[3]
GENERATED = {
    "docs/reference/drum-wire.md": reference_page,
    "arduino/drum/drum_map.h": register_header,
    "arduino/drum/drum_states.h": state_header,
}
"""Function that returns the text of each file, by the file's path in the checkout."""


def find_stale(checkout: Path = CHECKOUT) -> dict[str, str]:
    """Return the new text of each generated file that is missing or outdated, by its path."""
    texts = {name: generate() for name, generate in GENERATED.items()}
    return {name: text for name, text in texts.items() if _read(checkout / name) != text}


def _read(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.is_file() else None


def main() -> int:
    """Return 1 where ``--check`` finds a stale file, 0 otherwise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only list the stale files")
    only_check = parser.parse_args().check
    stale = find_stale()
    for name, text in stale.items():
        print(f"{name}: {'stale' if only_check else 'written'}")
        if not only_check:
            (CHECKOUT / name).write_text(text, encoding="utf-8")
    return 1 if only_check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
