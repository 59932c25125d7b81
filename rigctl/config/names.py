"""Names that may become part of a path or of a terminal's line: of textures and protocols."""

from __future__ import annotations

import unicodedata

MAX_NAME_BYTES = 100
_MARKS = " -_.,+()"
_RESERVED = {"CON", "PRN", "AUX", "NUL"} | {
    f"{port}{n}" for port in ("COM", "LPT") for n in "123456789"
}
_RULE = f"a name has letters, digits, spaces and any of {_MARKS.strip()}"


def name_problem(name: str, longest_bytes: int = MAX_NAME_BYTES) -> str:
    """Return why ``name`` cannot be a name, in words that follow the name; empty if it can.

    A name has letters and digits of any language, spaces and a few marks. It does not begin
    with a dot or a space nor end with one, and no system reserves it.
    """
    shown = shorten(repr(name))
    if len(name.encode("utf-8", "surrogatepass")) > longest_bytes:
        return f"{shown} is longer than {longest_bytes} bytes"
    refused = next((letter for letter in name if not _is_safe(letter)), None)
    if refused is not None:
        return f"{shown} contains {refused!r}: {_RULE}"
    if not name or name != name.strip(" .").strip():
        return f"{shown} is empty, or begins or ends with a dot or a space"
    if name.partition(".")[0].strip().upper() in _RESERVED:
        return f"{shown} is reserved by Windows: choose another name"
    return ""


def shorten(text: str, longest: int = 80) -> str:
    """Return the text, cut with an ellipsis where it is longer than ``longest`` letters."""
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def _is_safe(letter: str) -> bool:
    return letter in _MARKS or unicodedata.category(letter)[0] in "LMN"
