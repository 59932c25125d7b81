"""Ask the person at the bench to do something and wait until it is done."""

from __future__ import annotations

from rigctl.errors import WrongUse


def ask(text: str, cure: str) -> None:
    """Print ``text`` and wait for Enter.

    Raises KeyboardInterrupt for the answer a, and WrongUse with ``cure`` without a terminal.
    """
    try:
        answer = input(f"{text} [Enter, or a to abort] ")
    except EOFError:
        raise WrongUse(f"there is no terminal to answer at: {cure}") from None
    if answer.strip().lower().startswith("a"):
        raise KeyboardInterrupt
