"""Write the generated files, or with ``--check`` only list those that are stale."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rigctl.wire.codegen.cpp_headers import register_header, state_header
from rigctl.wire.codegen.reference_page import reference_page

CHECKOUT = Path(__file__).resolve().parents[3]
GENERATED = {
    "docs/reference/drum-wire.md": reference_page,
    "arduino/drum/drum_map.h": register_header,
    "arduino/drum/drum_states.h": state_header,
}
"""Function that returns the text of each file, by the file's path in the checkout."""


def main() -> int:
    """Return 1 where ``--check`` finds a stale file, 0 otherwise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only list the stale files")
    only_check = parser.parse_args().check
    stale = 0
    for name, generate in GENERATED.items():
        path, text = CHECKOUT / name, generate()
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            continue
        stale += 1
        print(f"{name}: {'stale' if only_check else 'written'}")
        if not only_check:
            path.write_text(text, encoding="utf-8")
    return 1 if only_check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
