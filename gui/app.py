"""Open the window.

Operate the rig, watch samples and spikes, run protocols.
"""

from __future__ import annotations

import argparse
import builtins
import gc
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING

from rigctl.config.resources import WINDOW_DEBIAN_PACKAGES
from rigctl.config.text_file import visible
from rigctl.engine.rpc.engine_files import place_machine_code
from rigctl.errors import RigctlError, WrongUse

if TYPE_CHECKING:
    from gui.link.engine_link import ClientFactory
    from gui.shell.main_window import MainWindow
    from rigctl.engine.rpc.client import EngineClient

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


SOON_MS = 100
"""After the start: the window is on the screen by then."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "--rig",
        metavar="RIG",
        action="append",
        help="rig to connect to: virtual, firmware, join (a running engine), or a rig.toml; "
        "several times for several rigs in one window",
    )
    parser.add_argument(
        "--world",
        type=Path,
        metavar="FILE",
        help="plates, sensor and mechanics of a simulated rig; `rigctl world` prints them",
    )
    parser.add_argument(
        "--follow",
        type=Path,
        metavar="SESSION",
        help="show the newest trials of a session that another program records",
    )
    parser.add_argument(
        "--plots",
        type=Path,
        metavar="FILE",
        help="Python file of own plots, which the window shows in place of the live views",
    )
    parser.add_argument(
        "--theme", choices=("system", "light", "dark"), help="colours; without it the last ones"
    )


@contextmanager
def paused_collector() -> Iterator[None]:
    """Pause Python's collector of garbage while the window is made.

    It would go through all that is loaded again and again, which is a tenth of the time until the
    window is there. Afterwards it leaves that alone, as it stays until the end.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def check_display() -> None:
    """Raise WrongUse where Qt or its libraries are missing, or Linux has no display."""
    try:
        from PySide6 import QtGui  # noqa: F401 - what fails without Qt's libraries
    except ImportError as error:
        raise WrongUse(_start_failure(str(error))) from None
    # PySide reads the source of each module that is imported from now on, to find those that use
    # its `__feature__`: a twentieth of the time until the window is there, and nothing here does.
    builtins.__import__ = getattr(builtins, "__orig_import__", builtins.__import__)
    displays = (os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"))
    if sys.platform.startswith("linux") and not any(displays):
        raise WrongUse(
            "the window needs a display, but there is none: log in at a desktop, use ssh -X, "
            "or work without the window (rigctl run, rigctl demo --no-window)"
        )


@contextmanager
def told_abort() -> Iterator[None]:
    """End the process with one sentence where Qt aborts it; hold what starts the application."""
    from PySide6.QtCore import QMessageLogContext, QtMsgType, qInstallMessageHandler

    said: list[str] = []

    def hear(kind: QtMsgType, context: QMessageLogContext, text: str) -> None:
        said.append(text)
        if kind == QtMsgType.QtFatalMsg:
            os.write(2, f"rigctl: {_start_failure(' '.join(said[:-1] or said))}\n".encode())
            os._exit(2)

    qInstallMessageHandler(hear)
    yield
    qInstallMessageHandler(None)
    print("".join(f"{text}\n" for text in said), end="", file=sys.stderr)


def _start_failure(said: str) -> str:
    return (
        f"the window needs Qt, but Qt does not start ({' '.join(said.split())}): install "
        f"PySide6-Essentials and, on Debian, {WINDOW_DEBIAN_PACKAGES}"
    )


def run(args: argparse.Namespace) -> int:
    """Show the window until it closes; return the exit code. Raises WrongUse."""
    with paused_collector():
        check_display()
        _check_request(args)
        is_asked = Event()  # to leave, while there is no window yet
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: is_asked.set())
        window = _shown_window(args.theme, _opened_early(args))
    from PySide6.QtCore import QTimer
    from PySide6.QtWidgets import QApplication
    from shiboken6 import delete

    for number in (signal.SIGINT, signal.SIGTERM):
        # Python calls this in the middle of anything, such as a redraw that reads the live data.
        signal.signal(number, lambda *_: QTimer.singleShot(0, partial(_leave, window)))
    if is_asked.is_set():
        QTimer.singleShot(0, partial(_leave, window))
    Thread(target=_load_compiler).start()
    QTimer.singleShot(SOON_MS, window, window.fit_screen)  # its frame is there by then
    QTimer.singleShot(SOON_MS, window, window.prepare)
    if args.plots is not None:
        window.own_plots.choose(str(args.plots.absolute()))
    _begin(window, args)
    code = int(QApplication.exec())
    for link in (link for peer in window.peers for link in peer.links):
        for sentence in link.left_running:
            print(f"rigctl-gui: {visible(sentence)}", file=sys.stderr)
    # While there is an application: widgets that outlive it crash Python's end.
    delete(window.window())
    return code


def _leave(window: MainWindow) -> None:
    """Close all pages without a question; runs go on."""
    for peer in window.peers:
        peer.attach.leave()


def _check_request(args: argparse.Namespace) -> None:
    """Raise WrongUse for options that exclude each other, a wrong world, or no session."""
    from gui.link.engine_link import JOIN, SIMULATED
    from gui.shell.rigs_window import MOST_RIGS, TOO_MANY
    from rigctl.engine.rpc.engine_files import rig_name

    if args.follow is not None:
        if args.rig is not None or args.world is not None:
            raise WrongUse("--follow shows a session that another program records: give it alone")
        from rigctl.session.part import part_paths

        part_paths(args.follow)
    named = [rig_name(rig) for rig in args.rig or () if rig not in (*SIMULATED, JOIN)]
    if len(set(named)) < len(named):
        raise WrongUse(f"each rig once: {', '.join(named)}")
    if len(args.rig or ()) > MOST_RIGS:
        raise WrongUse(TOO_MANY)
    if args.world is not None:
        from rigctl.bench.world_file import load_world

        if args.rig is not None and JOIN in args.rig:
            raise WrongUse("the running engine already has a world: join it without --world")
        load_world(args.world)


def _opened_early(args: argparse.Namespace) -> ClientFactory:
    """Begin to start the engine of the only rig, while the window is made; return who gives it.

    An engine that no window takes ends by itself.
    """
    from gui.link.engine_link import open_client

    if len(args.rig or ()) != 1:
        return open_client
    wanted = args.rig[0], str(args.world or "")
    thread = ThreadPoolExecutor(1)
    opening = [thread.submit(open_client, *wanted)]
    thread.shutdown(wait=False)

    def open_or_take(rig: str, world: str = "") -> EngineClient:
        if opening and (rig, world) == wanted:
            return opening.pop().result()
        return open_client(rig, world)

    return open_or_take


def _shown_window(theme: str | None, factory: ClientFactory) -> MainWindow:
    """Return the window with the user's settings; errors of Python go to its log and a report."""
    import pyqtgraph as pg
    from PySide6.QtGui import QIcon

    from gui.shell.help_page import REPORTS, CrashReporter
    from gui.shell.main_window import MainWindow
    from gui.shell.rigs_window import connect_menu
    from gui.shell.user_settings import UserSettings
    from gui.widgets.theme import ThemeChoice

    with told_abort():
        app = pg.mkQApp("rigctl")
    app.setDesktopFileName("rigctl")
    app.setWindowIcon(QIcon(str(Path(__file__).with_name("rigctl.svg"))))
    settings = UserSettings.of_user()
    themes = ThemeChoice.__members__
    kept = settings.value("theme", ThemeChoice.SYSTEM.name, themes.__contains__)
    window = MainWindow(factory, themes[(theme or kept).upper()], settings=settings)
    crashes = CrashReporter(settings.folder / REPORTS, window.event_log.toPlainText)
    crashes.reported.connect(lambda *said: window.peers[0].report(*said))
    crashes.install()
    crashes.follow_native_code()
    connect_menu(window)
    window.show()
    if complaint := screen_complaint(*window.screen().availableSize().toTuple()):
        window.report("check", complaint)
    return window


def _begin(window: MainWindow, args: argparse.Namespace) -> None:
    """Connect to a rig or follow a session; without either, offer the engines that run."""
    if args.follow is not None:
        _follow(window, args.follow.absolute())
    elif args.rig is not None:
        from gui.shell.rigs_window import add_rig

        for _ in args.rig[1:]:
            add_rig(window)
        for peer, rig in zip(window.peers, args.rig, strict=True):
            peer.connect_rig(rig, str(args.world or ""))
    else:
        if args.world is not None:
            window.toolbar.world.choose(str(args.world))
        window.attach.announce()


def _follow(window: MainWindow, session: Path) -> None:
    """Show the newest trials in Replay; scans of the moving finger, which has none, in Analysis."""
    from rigctl.finger.layout import FINGER_LAYOUT
    from rigctl.session.part import session_layout

    if session_layout(session) is FINGER_LAYOUT:
        window.show_panel("analysis")
        window.analysis_tab.open_session(str(session))
    else:
        window.replay.follow(str(session))


def _load_compiler() -> None:
    """Load what compiles the encoder while the user looks at the window, before it is wanted.

    A window that closes meanwhile waits for it, unseen: Python cannot end while native code loads.
    """
    import_module("rigctl.encoder.encoder")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the console script; return the exit code."""
    parser = argparse.ArgumentParser(prog="rigctl-gui", description=__doc__)
    add_arguments(parser)
    os.environ["PYTHONSAFEPATH"] = "1"  # no child imports from the working folder
    try:
        place_machine_code()
        return run(parser.parse_args(argv))
    except RigctlError as error:
        print(f"rigctl-gui: {visible(str(error))}", file=sys.stderr)
        return error.exit_code
