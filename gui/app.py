"""``rigctl-gui``: one window."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from rigctl.errors import RigctlError, WrongUse

DEBIAN_PACKAGES = "libegl1 libgl1 libxkbcommon-x11-0 libxcb-cursor0 libdbus-1-3 libfontconfig1"
DESCRIPTION = "Open the window: work the rig, watch samples and spikes, run protocols."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What may be said on the command line."""
    parser.add_argument(
        "--rig",
        metavar="RIG",
        help="connect at once: virtual, firmware, join (a running engine), or a rig.toml",
    )
    parser.add_argument(
        "--world",
        type=Path,
        metavar="FILE",
        help="a simulated rig's plates, sensor and mechanics; `rigctl world` prints them",
    )
    parser.add_argument("--theme", choices=("system", "light", "dark"), default="system")


def check_display() -> None:
    """Raise WrongUse where Qt would end the process for want of a display or of libraries.

    Qt offers no question for that, it aborts: so another process tries.
    """
    if not sys.platform.startswith("linux"):
        return
    tried = subprocess.run(
        [sys.executable, "-c", "from PySide6.QtGui import QGuiApplication as A; A([])"],
        capture_output=True,
        text=True,
        check=False,
    )
    if tried.returncode:
        raise WrongUse(_why_not(tried.stderr))


def check_world(rig: str | None, world: Path | None) -> None:
    """Raise WrongUse for a world file that no rig could have, before a window opens."""
    from gui.engine_link import JOIN
    from rigctl.simulation.bench.world_file import load_world

    if world is None:
        return
    if rig == JOIN:
        raise WrongUse("the running engine has a world already: join it without --world")
    load_world(world)


def _why_not(said: str) -> str:
    shown = (os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"))
    if not any(shown):
        return (
            "the window needs a display and there is none here: log in at a desktop, use ssh -X, "
            "or work without it (rigctl run, rigctl demo --no-window)"
        )
    line = next((line for line in said.splitlines() if line.strip()), "no reason given")
    return (
        f"the window needs Qt, which does not start here ({line.strip()}): install "
        f"PySide6-Essentials and, on Debian, {DEBIAN_PACKAGES}"
    )


def show(rig: str | None, world: Path | None, theme: str) -> int:
    """Show the window until it is closed; return the exit code. Raises WrongUse."""
    check_display()
    check_world(rig, world)
    import pyqtgraph as pg

    from gui.main_window import MainWindow
    from gui.widgets.theme import ThemeChoice

    app = pg.mkQApp("rigctl")
    window = MainWindow(choice=ThemeChoice[theme.upper()])
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: window.close())
    window.show()
    if rig is not None:
        window.connect_rig(rig, str(world or ""))
    elif world is not None:
        window.toolbar.world.choose(str(world))
    return int(app.exec())


def main(argv: Sequence[str] | None = None) -> int:
    """The console script."""
    parser = argparse.ArgumentParser(prog="rigctl-gui", description=DESCRIPTION)
    add_arguments(parser)
    args = parser.parse_args(argv)
    try:
        return show(args.rig, args.world, args.theme)
    except RigctlError as error:
        print(f"rigctl-gui: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
