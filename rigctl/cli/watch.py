"""Watch a session that another program records.

Print its events as they are recorded, what was repeated or put into quarantine before, and a line
with its trials, its losses and the age of its newest data; on a terminal the spikes of the newest
trial, too. Where its engine runs on this computer, what the run does or waits for, the next change
of plates and the end as well; without SESSION, of the newest run here. --http shows the same as a
page in the browser. It only looks, and reaches no rig. Exit code 0: the session is closed; 1: the
program that recorded it is gone.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from contextlib import ExitStack
from pathlib import Path

from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.progress import ProgressLine
from rigctl.cli.session_looks import BLOCKS, LETTERS, looks
from rigctl.cli.watch_page import WatchPage, listen_address
from rigctl.engine.rpc.client import find_engines
from rigctl.errors import CheckFailed, WrongUse

LOOK_EVERY_S = 0.5
GONE = (
    "the program that recorded {session} is gone: continue it with --resume, or put it in order "
    "with rigctl recover"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    words = "a session's folder (default: that of the newest run on this computer)"
    add_option(parser, "session", a_path, help_text=words, nargs="?")
    words = "show it as a page, too, at http://localhost:PORT; with HOST (0.0.0.0: all) to others"
    add_option(parser, "--http", listen_address, "[HOST:]PORT", words)


def run(args: argparse.Namespace) -> int:
    """Show what is recorded until the session is closed. Raises CheckFailed without a recorder."""
    line, folder = ProgressLine(sys.stdout), args.session or _newest_session()
    columns = shutil.get_terminal_size().columns - 1 if sys.stdout.isatty() else 0
    marks = BLOCKS if (sys.stdout.encoding or "").lower().startswith("utf") else LETTERS
    with ExitStack() as stack:
        stack.callback(line.end)
        page = None if args.http is None else stack.enter_context(WatchPage(args.http, folder))
        if page is not None:
            line.say(f"{page.address} shows {folder}, for as long as this runs")
        for look in looks(folder, columns, marks, with_raster=page is not None):
            if page is not None:
                page.show(look)
            for text in look.news:
                line.say(text)
            line.show(look.line, last=look.has_ended)
            if look.has_ended:
                return 0
            if look.is_gone:
                raise CheckFailed(GONE.format(session=folder))
            time.sleep(LOOK_EVERY_S)
    return 0


def _newest_session() -> Path:
    """Return the folder of the newest run on this computer. Raises WrongUse without one."""
    for found in find_engines():
        if found.has_run:
            return Path(str(found.run["session"]))
    raise WrongUse("no run is active on this computer: name a session's folder")
