"""Damage to texts in TOML, JSON and CSV: keys, values, nesting, lengths, letters."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from random import Random

from tests.fuzz.kind import Mutation
from tests.fuzz.mutations.bytes import BYTES

NUMBERS = (
    *("0", "-1", "1", "1e308", "-1e308", "1e999", "nan", "inf", "-inf", "NaN", "Infinity"),
    *("9" * 25, "9" * 5000, "0x10", "1_000", "true", "null", "1e-320", "2147483648", "1000000"),
)
WORDS = (
    *('""', '"../../x"', '"/etc/passwd"', '"a\\u0000b"', '"\\u001b[2J"', '"\\u202e"', '"é"'),
    *('"' + "x" * 300 + '"', '"' + "x" * 300_000 + '"', "[]", "{}", "[[]]", '["A", "A"]'),
    *("1979-05-27", '"""', "'", '"{texture}{0.__class__}"', '"serial:/dev/zero"', '"(a+)+$"'),
    *(
        '"(?P<texture>(a|a)*)(?P<speed>"',
        '["' + '", "'.join(map(str, range(20_000))) + '"]',
    ),
)
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\w.]*")
_VALUE = re.compile(r"(?<=[=:])[ \t]*[^\n,]+")
_KEY = re.compile(r"\b[A-Za-z_][A-Za-z_0-9]*(?=\s*[=:])")

MOST_LETTERS = 16 << 20
"""A text is not made longer: this process has little memory."""
Rewrite = Callable[[Random, str], str]


def replace_number(random: Random, text: str) -> str:
    """Put a number at its limit, or none, in the place of a number."""
    return _replace(random, _NUMBER, text, random.choice(NUMBERS))


def replace_value(random: Random, text: str) -> str:
    """Put another kind of value in the place of a value."""
    return _replace(random, _VALUE, text, " " + random.choice((*NUMBERS, *WORDS)))


def exchange_values(random: Random, text: str) -> str:
    """Put one value in the place of another."""
    values = [match.group() for match in _VALUE.finditer(text)]
    return _replace(random, _VALUE, text, random.choice(values)) if values else text


def rename_key(random: Random, text: str) -> str:
    """Rename a key, to another one of the file or to a strange one."""
    keys = [match.group() for match in _KEY.finditer(text)]
    strange = ('""', '"\\u001b"', "k" * 300, '"' + "k" * 300_000 + '"', "a.b.c", "__class__")
    return _replace(random, _KEY, text, random.choice((*keys, *strange)))


def drop_line(random: Random, text: str) -> str:
    """Leave a line out."""
    lines = text.split("\n")
    del lines[random.randrange(len(lines))]
    return "\n".join(lines)


def repeat_line(random: Random, text: str) -> str:
    """Repeat a line, twice or very often."""
    lines = text.split("\n")
    at, times = random.randrange(len(lines)), random.choice((2, 200, 5000))
    if len(lines[at]) * times > MOST_LETTERS:
        return text
    return "\n".join(lines[:at] + [lines[at]] * times + lines[at + 1 :])


def swap_lines(random: Random, text: str) -> str:
    """Exchange two lines."""
    lines = text.split("\n")
    a, b = random.randrange(len(lines)), random.randrange(len(lines))
    lines[a], lines[b] = lines[b], lines[a]
    return "\n".join(lines)


def nest(random: Random, text: str) -> str:
    """Nest deeply somewhere."""
    at = random.randrange(len(text) + 1)
    opening = random.choice(("[", "{", '{"a":', "[[", "(", '"', "'''", "a."))
    return text[:at] + opening * random.choice((1, 5, 1000, 100_000)) + text[at:]


def insert_letters(random: Random, text: str) -> str:
    """Insert letters that terminals, parsers or file systems treat in a special way."""
    letters = ("\0", "\x1b[2J", "\r", "\u202e", "\ufeff", "\ud7ff", "\U0001f600", "\x7f", "\x85")
    at = random.randrange(len(text) + 1)
    return text[:at] + random.choice(letters) + text[at:]


def add_tables(random: Random, text: str) -> str:
    """Add tables, few or many."""
    lines = (
        "[[steps]]\nat = 'every'\ntrials = 1\nkind = 'rest'\nseconds = 1\n",
        "[x]\n",
        "[[y]]\n",
    )
    return text + "\n" + random.choice(lines) * random.choice((1, 300))


def _replace(random: Random, pattern: re.Pattern[str], text: str, new: str) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return text + new
    match = random.choice(found)
    return text[: match.start()] + new + text[match.end() :]


def on_text(rewrite: Rewrite) -> Mutation:
    """Return a rewriting of a text as a mutation of a file."""

    def mutate(random: Random, path: Path) -> str:
        text = path.read_text(encoding="utf-8", errors="replace")
        new = rewrite(random, text or " ")
        path.write_text(new, encoding="utf-8", errors="replace", newline="")
        return f"{rewrite.__name__}, now {len(new)} letters"

    return mutate


REWRITES: tuple[Rewrite, ...] = (
    *(replace_number, replace_number, replace_value, replace_value, exchange_values, rename_key),
    *(drop_line, repeat_line, swap_lines, nest, insert_letters, add_tables),
)
TEXT: tuple[Mutation, ...] = (*map(on_text, REWRITES), *BYTES[:: len(BYTES) // 4])
