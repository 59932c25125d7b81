"""A number as a person types it, alike in every language of the computer.

Both "." and "," are decimal marks, and digits may be those of any script. Marks between groups of
digits are refused, as "1.000" is one thousand to some readers and one to others.
"""

from __future__ import annotations

import re
from decimal import Decimal
from unicodedata import decimal

from rigctl.errors import WrongUse

_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d{1,3})?", re.ASCII | re.IGNORECASE)
_GROUPS = re.compile(r"[+-]?[0-9][0-9.,'’٬_\s]*[0-9]")
_ONE_GROUP = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}", re.ASCII)
_FEWEST_FOR_GROUP = 3


def typed_number(text: str) -> Decimal:
    """Return the number that is typed, exactly. Raises WrongUse for what is none."""
    typed = _ascii_number(text)
    if _NUMBER.fullmatch(typed):
        return Decimal(typed.replace(",", "."))
    if has_group_marks(typed):
        raise WrongUse(f"{typed} has a mark between groups of digits: leave it out")
    raise WrongUse(f"{typed!r} is no number: type digits, such as 12.5 or 12,5")


def _ascii_number(text: str) -> str:
    """Return a text with ASCII's digits and minus, and the Arabic decimal mark as a comma."""
    digits = "".join(str(decimal(letter, letter)) for letter in text.strip())
    return digits.replace("−", "-").replace("٫", ",")


def has_group_marks(value: object) -> bool:
    """Return whether a value is a text of digits with marks between groups of them."""
    text = value.strip() if isinstance(value, str) else ""
    return not _NUMBER.fullmatch(text) and bool(_GROUPS.fullmatch(text))


def number_in_steps(text: str, decimals: int) -> Decimal:
    """Return a typed number that has no more than so many decimals.

    Raises WrongUse for another one, and for a text that may mean thousands where so many decimals
    are not in use, such as 1,000.
    """
    number, typed = typed_number(text), _ascii_number(text)
    if decimals < _FEWEST_FOR_GROUP and _ONE_GROUP.fullmatch(typed):
        digits = re.sub("[.,]", "", typed)
        raise WrongUse(f"{typed} may mean {digits} or {number.normalize():f}: type one of the two")
    exponent = number.normalize().as_tuple().exponent
    if isinstance(exponent, int) and -exponent > decimals:
        most = f"a number with at most {decimals} decimal{'s' * (decimals > 1)}"
        raise WrongUse(
            f"{typed} has too many decimals: type {most if decimals else 'a whole number'}"
        )
    return number
