"""Words in the names of columns, fields and files, and what they say."""

from __future__ import annotations

import re
from collections.abc import Iterable

WORDS = {
    "time": {"t", "time", "timestamp", "zeit", "clock", "millis", "micros", "ms", "us", "sec"},
    "trial": {
        *("trial", "run", "recording", "take", "sweep", "trialno", "trialid", "versuch", "messung"),
    },
    "texture": {
        *("texture", "tex", "material", "mat", "fabric", "surface", "cloth", "textile", "stimulus"),
        *("class", "label", "stoff"),
    },
    "speed": {"speed", "velocity", "vel", "v", "feed", "feedrate"},
    "force": {"force", "load", "weight", "pressure", "depth", "indentation", "level", "f", "fz"},
    "repeat": {"repeat", "rep", "repetition", "r", "no", "nr", "n"},
    "mount": {"mount", "mounting"},
    "loadcell": {"loadcell", "cell", "fn", "fz", "force", "load", "normal", "weight", "pressure"},
    "rate": {"fs", "rate", "hz", "samplerate", "frequency"},
    "index": {"index", "idx", "sample", "samples", "row", "frame", "counter", "seq", "id", "no"},
    "extra": {
        *("temp", "temperature", "humidity", "proximity", "prox", "acc", "gyro", "imu", "mag"),
        *("x", "y", "z", "pos", "position", "angle", "encoder", "current", "ft", "torque"),
    },
}
"""Words of each role, in lower case."""
FILE_WORDS = {
    **WORDS,
    "repeat": WORDS["repeat"] | WORDS["trial"] | {"i", "k"},
    "force": WORDS["force"] | {"w", "p"},
    "mount": WORDS["mount"] | {"m"},
}
"""Words beside a number in the name of a file."""
_SPEED_UNITS = {
    "mm/min": r"mm[ _]?(?:/|p|per|[ _])[ _]?min|mmmin|mmpm",
    "m/min": r"m[ _]?(?:/|p|per|[ _])[ _]?min|mpm",
    "inch/min": r"(?:inch|in)[ _]?(?:/|p|per|[ _])[ _]?min|ipm",
    "mm/s": r"mm[ _]?(?:/|p|per|[ _])[ _]?s(?:ec)?|mms|mmps",
    "cm/s": r"cm[ _]?(?:/|p|per|[ _])[ _]?s(?:ec)?|cms|cmps",
    "inch/s": r"(?:inch|in)[ _]?(?:/|p|per|[ _])[ _]?s(?:ec)?|ips",
    "m/s": r"m[ _]?(?:/|p|per|[ _])[ _]?s(?:ec)?|mps",
    "rpm": "rpm",
}
_FORCE_UNITS = {
    "kPa": "kpa",
    "mN": "mn|millinewton",
    "N": "n|newtons?",
    "kg": "kg|kgf",
    "g": "g|gf|grams?",
}
_TIME_UNITS = {"ms": "ms|msec|millis", "us": "us|µs|usec|micros", "ns": "ns", "s": "s|sec|seconds"}
UNITS = {"speed": _SPEED_UNITS, "force": {**_FORCE_UNITS, "mm": "mm"}, "time": _TIME_UNITS}
"""Expressions of the units of each role."""
ANY_UNIT = "|".join([*_SPEED_UNITS.values(), *_FORCE_UNITS.values(), "mm"])


def words_of(name: str) -> list[str]:
    """Return the words of a name in lower case: ``normalForce_N`` has normal, force and n."""
    parts = re.findall(r"[A-Z]?[^\W\d_A-Z]+|[A-Z]+(?![^\W\d_A-Z])|[A-Z]", name)
    return [part.lower() for part in parts]


def has_word(role: str, name: str) -> bool:
    """Return whether one of a name's words says that role, or all of them joined."""
    words = words_of(name)
    return any(word in WORDS[role] for word in (*words, "".join(words)))


def role_of_unit(name: str) -> str:
    """Return speed or force if the unit behind a name's words is one of theirs, else nothing.

    A length is neither: it may be a depth, a position or a distance.
    """
    if len(words_of(name)) < 2:
        return ""
    roles = (role for role in ("speed", "force") if find_unit(role, name) not in ("", "mm"))
    return next(roles, "")


def find_unit(role: str, text: str) -> str:
    """Return the unit at the end of a name or after a number, empty if there is none."""
    text = text.strip().strip("()[]{}_ ").lower()
    for unit, expression in UNITS[role].items():
        if re.search(rf"(?:^|[\W_])(?:{expression})$", text):
            return unit
    return ""


def first_role(word: str, roles: Iterable[str]) -> str:
    """Return the first of the roles that a word beside a number says, empty if none does."""
    return next((role for role in roles if word.lower() in FILE_WORDS[role]), "")
