"""Options and arguments of commands: numbers within limits, and paths that a file can have.

Each refuses in one sentence that names the argument. Limits are far beyond any use, and near
enough that nothing is allocated for them.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from rigctl.config.text_file import kind_of, shorten
from rigctl.config.typed_number import number_in_steps, typed_number
from rigctl.errors import WrongUse
from rigctl.protocol.plan import MAX_SEED
from rigctl.values import ABOUT, OWN_NAME

Kind = Callable[[str, str], Any]
"""Takes the name of an option and its text; returns the value or raises WrongUse."""
OWN_LETTERS = 40
"""Of the name of a lab's own field."""
MAX_WORKERS = 1024
MAX_REPEATS = 100_000
MAX_NUMBER = 1_000_000_000
"""Of trials, taxels, sessions, components: what they choose from is smaller."""
_MAX_PART_BYTES = 255
_MAX_PATH_BYTES = 4000
_MORE_WORKERS = "--more-workers-than-cores"


def add_option(
    parser: argparse._ActionsContainer,
    name: str,
    kind: Kind,
    metavar: str | None = None,
    help_text: str | None = None,
    **settings: Any,
) -> None:
    """Add an option or argument whose text a ``kind`` turns into a value."""
    shown = name if name.startswith("-") else metavar or name.upper()
    parser.add_argument(
        name, type=partial(kind, shown), metavar=metavar, help=help_text, **settings
    )


def whole_number(low: int, high: int = MAX_NUMBER) -> Kind:
    """Return the kind of whole numbers from ``low`` to ``high``; it raises WrongUse for others."""

    def parse(option: str, text: str) -> int:
        try:
            value = int(text)
        except ValueError:  # also for more digits than Python converts
            value = low - 1
        if not low <= value <= high:
            given = f"{option} {shorten(text, 40)}"
            raise WrongUse(f"{given}: give a whole number from {low:,} to {high:,}")
        return value

    return parse


def number(low: float, high: float) -> Kind:
    """Return the kind of numbers from ``low`` to ``high``; it raises WrongUse for others.

    "." and "," are both decimal marks, "1,000" is refused: it may mean 1 or 1000.
    """

    def parse(option: str, text: str) -> float:
        given = shorten(text, 40)
        wrong = WrongUse(f"{option} {given}: give a number from {low:,.10g} to {high:,.10g}")
        try:
            value = number_in_steps(given, 2) if "," in given else typed_number(given)
        except WrongUse as reason:
            raise (WrongUse(f"{option} {reason}") if "," in given else wrong) from reason
        if not low <= value <= high:
            raise wrong
        return float(value)

    return parse


WORKERS = whole_number(1, MAX_WORKERS)


def a_path(option: str, text: str) -> Path:
    """Return the path to a file or folder. Raises WrongUse for a pipe or a device."""
    return Path(path_or_name(option, text))


def path_or_name(option: str, text: str) -> str:
    """Check as :func:`a_path` what may be a name, too, such as ``virtual``."""
    name = os.fsencode(text)
    shown = f"{option} {shorten(text)}"
    if not text or b"\0" in name:
        raise WrongUse(f"{shown}: a path is not empty and has no zero byte")
    if len(name) > _MAX_PATH_BYTES or any(
        len(os.fsencode(part)) > _MAX_PART_BYTES for part in Path(text).parts
    ):
        raise WrongUse(f"{shown}: the path is longer than a file system allows")
    kind = kind_of(Path(text))
    if kind not in ("", "a folder"):
        raise WrongUse(f"{shown} is {kind}: give a file or a folder")
    return text


def add_seed(
    parser: argparse.ArgumentParser,
    help_text: str,
    default: int | None = None,
    required: bool = False,
) -> None:
    """Add ``--seed``."""
    kind = whole_number(0, MAX_SEED)
    add_option(parser, "--seed", kind, None, help_text, default=default, required=required)


def add_more_workers(parser: argparse.ArgumentParser, default: int) -> None:
    """Add the option to use more workers than this computer has cores."""
    parser.set_defaults(default_workers=default)
    parser.add_argument(
        _MORE_WORKERS, action="store_true", help="allow --workers beyond the cores of this computer"
    )


def workers_of(args: argparse.Namespace) -> int:
    """Return the number of workers. Raises WrongUse for more than cores, unless asked for twice."""
    cores = os.cpu_count() or 1
    workers = int(args.workers)
    if workers > max(cores, args.default_workers) and not args.more_workers_than_cores:
        raise WrongUse(
            f"--workers {workers}: this computer has {cores} cores; add {_MORE_WORKERS} if you "
            "mean it"
        )
    return workers


def add_about(parser: argparse._ActionsContainer) -> None:
    """Add the options of what a session says of itself, each stored with it."""
    for name, words in ABOUT.items():
        parser.add_argument(_option(name), default="", type=str.strip, help=words)
    words = "a field of your own; may be given several times"
    add_option(parser, "--about", own_field, "NAME=TEXT", words, action="append", default=[])


def ask_own_fields(args: argparse.Namespace, names: Iterable[str]) -> None:
    """Ask at a terminal for the fields of a rig's file that no option gave; its end ends that."""
    asked = [name for name in names if name not in dict(args.about)]
    with suppress(EOFError):
        for name in asked if sys.stdin.isatty() else ():
            args.about = [*args.about, (name, input(f"{name}: ").strip())]


def own_field(shown: str, text: str) -> tuple[str, str]:
    """Return name and value of a lab's own field. Raises WrongUse where it has no name."""
    name, separator, value = text.partition("=")
    if not separator or len(name) > OWN_LETTERS or not re.search(OWN_NAME, name.strip()):
        raise WrongUse(f"{shown} {text!r} names no field: give it as 'skin temperature=31'")
    return name.strip(), value.strip()


def add_lsl(parser: argparse.ArgumentParser) -> None:
    """Add the option to stream what a rig does."""
    parser.add_argument(
        "--lsl",
        nargs="?",
        const="computer",
        choices=("computer", "network"),
        help="stream samples, spikes, pulses and events over LSL, as rigctl lsl does",
    )


def about_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return what was said of a session, by attribute; without what was left out."""
    said = {name: text for name in ABOUT if (text := getattr(args, name))}
    return {**said, **({"own": dict(args.about)} if args.about else {})}


def about_options(args: argparse.Namespace) -> list[str]:
    """Return what was said of a session as options, a word each."""
    said = {name: text for name in ABOUT if (text := getattr(args, name))}
    own = [f"--about={name}={text}" for name, text in args.about]
    return [*(f"{_option(name)}={text}" for name, text in said.items()), *own]


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
