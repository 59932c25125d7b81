"""Write the generated files, or with ``--check`` only list those that are stale."""

from __future__ import annotations

import argparse
import sys

from rigctl.wire.codegen import CHECKOUT, find_stale


def main() -> int:
    """Return 1 where ``--check`` finds a stale file, 0 otherwise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only list the stale files")
    only_check = parser.parse_args().check
    stale = find_stale()
    for path, text in stale.items():
        print(f"{path}: {'stale' if only_check else 'written'}")
        if not only_check:
            (CHECKOUT / path).parent.mkdir(parents=True, exist_ok=True)
            (CHECKOUT / path).write_text(text, encoding="utf-8")
    return 1 if only_check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
