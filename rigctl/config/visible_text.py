"""Text of any origin as a terminal may show it: what would act on the terminal becomes visible."""

from __future__ import annotations

import codecs
import re

# C0 but tab and newline, DEL and C1; marks that turn the direction of writing; line and paragraph
# separators; what stands for bytes that are no UTF-8.
_ACTING = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]"
)
UNENCODABLE = "rigctl.visible"
"""Name of the error handler that writes a character the terminal lacks as its escape."""


def visible(text: str, encoding: str = "utf-8") -> str:
    """Return the text with escapes for control characters and for what ``encoding`` lacks.

    ``\\x1b`` for a control character, ``\\u009b`` or ``\\u202e`` for the others: in a JSON text,
    which has no control characters of its own, each stays what it was.
    """
    escaped = _ACTING.sub(lambda found: _escape(found[0]), text)
    return escaped.encode(encoding, UNENCODABLE).decode(encoding)


def visible_line(text: str) -> str:
    """Return the text as :func:`visible`, with line breaks and tabs escaped too."""
    return visible(text).replace("\n", "\\n").replace("\t", "\\t")


def _escape(letter: str) -> str:
    code = ord(letter)
    if code < 0x20:
        return f"\\x{code:02x}"
    if code < 0x10000:
        return f"\\u{code:04x}"
    high, low = divmod(code - 0x10000, 0x400)
    return f"\\u{0xD800 + high:04x}\\u{0xDC00 + low:04x}"  # as JSON writes it


def _escape_unencodable(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_escape, error.object[error.start : error.end])), error.end


codecs.register_error(UNENCODABLE, _escape_unencodable)
