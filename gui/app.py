"""``rigctl-gui``: one window."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from gui.theme import ThemeChoice

DESCRIPTION = "Open the window: work the rig, watch samples and spikes, run protocols."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What may be said on the command line."""
    parser.add_argument(
        "--rig", metavar="RIG", help="connect at once: virtual, firmware, or the path of a rig.toml"
    )
    parser.add_argument("--theme", choices=("system", "light", "dark"), default="system")


def show(rig: str | None, theme: str) -> int:
    """Show the window until it is closed; return the exit code."""
    import pyqtgraph as pg

    from gui.window import Window

    app = pg.mkQApp("rigctl")
    window = Window(choice=ThemeChoice[theme.upper()])
    window.show()
    if rig is not None:
        window.connect_rig(rig)
    return int(app.exec())


def main(argv: Sequence[str] | None = None) -> int:
    """The console script."""
    parser = argparse.ArgumentParser(prog="rigctl-gui", description=DESCRIPTION)
    add_arguments(parser)
    args = parser.parse_args(argv)
    return show(args.rig, args.theme)


if __name__ == "__main__":
    sys.exit(main())
