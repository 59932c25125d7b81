"""Add a note to a session, or mark a trial bad.

Add a note to a session, also while it is recorded, or list its notes. A note is a dated file with a
digest of its own beside the parts, which do not change. A trial marked bad does not count: encode,
analyse and classify leave it out, and --resume of the command that made the session records it
again.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime

from rigctl.cli.arguments import a_path, add_option, number, whole_number
from rigctl.errors import WrongUse
from rigctl.session.notes import MAX_AT_S, Mark, SessionNote
from rigctl.session.session import add_note, open_session


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "session", a_path, help_text="a session's folder")
    parser.add_argument(
        "text", nargs="?", type=str.strip, help="the note; without it, the notes are listed"
    )
    add_option(parser, "--trial", whole_number(1), "N", "the trial that it is about")
    add_option(
        parser,
        "--attempt",
        whole_number(1),
        "N",
        "which attempt at it; without it the one that counts",
    )
    add_option(
        parser, "--at", number(0, MAX_AT_S), "S", "moment in the trial, from its first sample"
    )
    verdict = parser.add_mutually_exclusive_group()
    verdict.add_argument("--bad", action="store_true", help="the trial does not count")
    verdict.add_argument("--good", action="store_true", help="the trial counts again")
    parser.add_argument(
        "--by", type=str.strip, default="", metavar="NAME", help="who writes the note"
    )


def run(args: argparse.Namespace) -> int:
    """Write the note and print its file, or print the session's notes."""
    if args.text is None:
        if args.bad or args.good or args.trial is not None:
            raise WrongUse("a note needs a text: write one in quotes")
        with open_session(args.session) as session:
            for note in session.notes:
                by = f" ({note.author})" if note.author else ""
                print(f"{note.made_utc}{by} {note.describe()}")
        return 0
    print(add_note(args.session, _note(args)))
    return 0


def _note(args: argparse.Namespace) -> SessionNote:
    mark = Mark.BAD if args.bad else Mark.GOOD if args.good else Mark.NONE
    made_utc = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    about = args.trial or 0, args.attempt or 0
    return SessionNote(made_utc, args.text, *about, mark, args.by, at_s=args.at)
