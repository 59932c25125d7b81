"""A person at the bench is asked to do something, and says when it is done."""

from __future__ import annotations

from rigctl.errors import WrongUse


def ask(text: str, cure: str) -> None:
    """Wait for Enter. Raises KeyboardInterrupt for a, WrongUse with ``cure`` where nobody is."""
    try:
        answer = input(f"{text} [Enter, or a to abort] ")
    except EOFError:
        raise WrongUse(f"nobody is there to answer: {cure}") from None
    if answer.strip().lower().startswith("a"):
        raise KeyboardInterrupt
