"""Copy a session to a second disk, also while it is recorded.

Copy a session into a folder of its name below FOLDER, which must be there. A part is copied when it
is finished, checked by its digests and by reading it back; a file gets its name when all of it is
there, and none is overwritten. Called again, it copies what is missing. Exit code 0: all that is
finished is there; 1: rows of a part are not those that were recorded; 2: wrong use; 3: the second
disk is missing, full or refuses.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from contextlib import suppress
from typing import TextIO

from rigctl.cli.arguments import a_path, add_option
from rigctl.errors import CheckFailed, DiskFault, RigctlError
from rigctl.session.second_copy import SessionCopy, is_written

LOOK_EVERY_S = 1.0
NICER_BY = 10
"""Than the engine: a copy must not delay a recording."""
DAMAGED = "{names}: rows are not those that were recorded, copied as they are: run rigctl verify"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "session", a_path, help_text="a session's folder")
    add_option(parser, "folder", a_path, "FOLDER", "a folder of the second disk")
    parser.add_argument(
        "--follow", action="store_true", help="copy what is finished until the session is closed"
    )


def run(args: argparse.Namespace) -> int:
    """Copy, and print the name of each file that is copied."""
    copy = SessionCopy(args.session, args.folder)
    if args.follow:
        return _follow(copy, args)
    copy.update()
    for name in copy.copied:
        print(name)
    if copy.damaged:
        raise CheckFailed(DAMAGED.format(names=", ".join(copy.damaged)))
    print(f"{copy.folder} has all that is finished")
    return 0


def _follow(copy: SessionCopy, args: argparse.Namespace) -> int:
    """Copy until nobody writes the session any more."""
    if sys.platform != "win32":
        os.nice(NICER_BY)
    followed = _Followed(copy, f"rigctl copy {args.session} {args.folder}")
    while True:
        is_last = not is_written(args.session)
        exit_code = followed.update()
        if is_last:
            return exit_code
        time.sleep(LOOK_EVERY_S)


class _Followed:
    """Tells what is copied, each trouble once, and its end; ``command`` catches up later."""

    def __init__(self, copy: SessionCopy, command: str) -> None:
        self._copy, self._command = copy, command
        self._trouble = ""
        self._n_copied = self._n_damaged = 0

    def update(self) -> int:
        """Copy what is new; return the exit code if nothing more comes."""
        copy, before = self._copy, self._trouble
        try:
            copy.update()
            self._trouble, exit_code = "", int(bool(copy.damaged))
        except RigctlError as error:
            self._trouble, exit_code = str(error), error.exit_code
        if self._trouble not in ("", before):
            _say(f"not copied: {self._trouble}; `{self._command}` catches up", sys.stderr)
        if new := copy.copied[self._n_copied :]:
            _say(f"copied to {copy.folder}: {', '.join(new)}", sys.stdout)
        if wrong := copy.damaged[self._n_damaged :]:
            _say(DAMAGED.format(names=", ".join(wrong)), sys.stderr)
        self._n_copied, self._n_damaged = len(copy.copied), len(copy.damaged)
        return exit_code


def _say(sentence: str, out: TextIO) -> None:
    """Print a sentence; the copy goes on where the engine that read it has ended."""
    with suppress(BrokenPipeError, DiskFault):
        print(sentence, file=out, flush=True)
