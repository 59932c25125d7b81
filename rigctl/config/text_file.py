"""Files from anywhere, read up to a declared size: no pipe, device or folder, nothing endless."""

from __future__ import annotations

import codecs
import os
import re
import stat
import unicodedata
from io import BufferedReader
from pathlib import Path

from rigctl.errors import WrongUse

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


_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
_WITHOUT_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def kind_of(path: Path) -> str:
    """Return what is at ``path`` if it is no plain file, such as ``a pipe``; else an empty text.

    A path without anything, or one that the system refuses, has no kind.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # ValueError: a zero byte in the path
        return ""
    return _KINDS.get(stat.S_IFMT(mode), "")


def is_plain_file(path: Path) -> bool:
    """Return whether there is a file that can be read to its end; never raises."""
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def refuse_link_outside(path: Path, error: type[WrongUse] = WrongUse) -> None:
    """Raise ``error`` for a link that leads out of its own folder; the folder may be a link."""
    try:
        is_link = path.is_symlink()
    except OSError:  # such as a name that is too long: opening it says so
        return
    if not is_link:
        return
    folder, target = os.path.realpath(path.parent), Path(os.path.realpath(path))
    if not target.is_relative_to(folder):
        raise error(
            f"{path} is a link to a file outside its folder, which may not be followed: put the "
            "file itself there"
        )


def open_file(path: Path, error: type[WrongUse] = WrongUse) -> BufferedReader:
    """Open a plain file for reading. Raises ``error`` for anything else; never waits."""
    if kind := kind_of(path):
        raise error(f"cannot read {path}: it is {kind}, not a file")
    try:
        return os.fdopen(os.open(path, os.O_RDONLY | _WITHOUT_WAITING), "rb")
    except ValueError as problem:
        raise error(f"cannot read {str(path)!r}: a path has no zero byte") from problem
    except OSError as problem:
        raise error(f"cannot read {path}: {problem.strerror}") from problem


def read_bytes(path: Path, limit: int, error: type[WrongUse] = WrongUse) -> bytes:
    """Return the content of a plain file of up to ``limit`` bytes, which bounds the memory too.

    Raises ``error`` for a larger file, and for whatever is no plain file.
    """
    with open_file(path, error) as file:
        try:
            content = file.read(limit + 1)
        except OSError as problem:
            raise error(f"cannot read {path}: {problem.strerror}") from problem
    if len(content) > limit:
        raise error(f"{path} is larger than {limit:,} bytes: it cannot be what it should be")
    return content


def read_text(path: Path, limit: int, error: type[WrongUse] = WrongUse) -> str:
    """Return the text of a file of up to ``limit`` bytes, with line ends as ``\\n``.

    It is UTF-8, or UTF-16 with a byte-order mark. Raises ``error`` as :func:`read_bytes`, and for
    bytes of any other encoding.
    """
    content = read_bytes(path, limit, error)
    try:
        text = content.decode(text_encoding(content))
    except UnicodeDecodeError as problem:
        raise error(f"{path} is not UTF-8 text: {SAVE_AS_UTF8}") from problem
    return text.replace("\r\n", "\n").replace("\r", "\n")


SAVE_AS_UTF8 = "save it as UTF-8"


def text_encoding(start: bytes) -> str:
    """Return the encoding of a text from its first bytes. Raises UnicodeDecodeError.

    Windows writes UTF-16 with a byte-order mark, and its editors write one before UTF-8 too.
    """
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    halves = start[0:_FIRST_BYTES:2], start[1:_FIRST_BYTES:2]
    if any(half and not any(half) for half in halves):  # UTF-16 without a mark
        raise UnicodeDecodeError("utf-8", start, start.index(0), start.index(0) + 1, "UTF-16")
    return "utf-8-sig"


_FIRST_BYTES = 64
