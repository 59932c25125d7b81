"""The paths of protocols, firmware images and pages, in a checkout or in an installed wheel.

A wheel carries protocols, sketches and images to flash in ``rigctl/_data``. An editable install has
no such folder, so the checkout comes first. Images for simulated chips exist in a checkout only.
"""

from __future__ import annotations

from html import unescape
from pathlib import Path

from rigctl.config.text_file import is_plain_file, kind_of, shorten
from rigctl.errors import ProtocolError, WrongUse

WINDOW_DEBIAN_PACKAGES = (
    "libegl1 libgl1 libxkbcommon-x11-0 libxcb-cursor0 libdbus-1-3 libfontconfig1"
)
"""What the window needs of Debian."""
_PACKAGE = Path(__file__).resolve().parents[1]
_FINGER_FOLDERS = (Path("finger"), Path("protocols/finger"))


def checkout() -> Path | None:
    """Return the root of the source checkout; None in an installed wheel."""
    root = _PACKAGE.parent
    return root if (root / "arduino").is_dir() and (root / "pyproject.toml").is_file() else None


def protocols() -> Path:
    """Return the folder of the built-in protocols."""
    root = checkout()
    return root / "protocols" if root else _PACKAGE / "_data" / "protocols"


def wiring_drawing(board: str) -> Path:
    """Return the wiring drawing of a board, ``mega``, ``uno`` or ``teensy``, an SVG."""
    root = checkout()
    folder = root / "arduino" if root else _PACKAGE / "_data" / "wiring"
    return folder / f"wiring-{board}.svg"


def part_title(picture: str) -> str:
    """Return the heading of a part, ``page#id``, in its wiring drawing."""
    page, _, part = picture.partition("#")
    texts = wiring_drawing(page).read_text(encoding="utf-8").split(f'<g id="{part}">')[1]
    return unescape(texts[texts.index("<text ") :].split(">", 1)[1].split("<", 1)[0])


def finger_protocols() -> Path:
    """Return the folder of the built-in protocols of the moving finger."""
    return protocols() / "finger"


def find_protocol(name: str) -> Path:
    """Return the file of a protocol: ``name`` is a path, or the name of a built-in protocol.

    ``quick``, ``quick.toml`` and ``protocols/quick.toml`` find the built-in one unless the
    current folder has such a file. Raises ProtocolError with the names of the built-in ones.
    """
    return _find(name, protocols(), (Path(), Path("protocols")))


def find_finger_protocol(name: str) -> Path:
    """Return the file of a protocol of the moving finger, as :func:`find_protocol`."""
    return _find(name, finger_protocols(), (Path(), *_FINGER_FOLDERS))


def find_any_protocol(name: str) -> Path:
    """Return the file of a protocol of the drum or, as ``finger/quick``, of the moving finger.

    As :func:`find_protocol`.
    """
    of_finger = Path(name).parent in _FINGER_FOLDERS
    return find_finger_protocol(name) if of_finger else find_protocol(name)


def _find(name: str, built_in: Path, parents: tuple[Path, ...]) -> Path:
    path = Path(name)
    if is_plain_file(path):
        return path
    shipped = built_in / (path.name if path.suffix == ".toml" else f"{path.name}.toml")
    if path.parent in parents and is_plain_file(shipped):
        return shipped
    if kind := kind_of(path):
        raise ProtocolError(f"{name} is {kind}, not the file of a protocol")
    known = ", ".join(sorted(p.stem for p in built_in.glob("*.toml"))) or "none"
    raise ProtocolError(
        f"there is no protocol {shorten(name)}: give a file or a built-in name: {known}"
    )


def firmware_image(board: str) -> Path:
    """Return the compiled image (ELF) of ``drum``, ``taxels`` or ``finger``.

    Raises WrongUse without one.
    """
    root = checkout()
    if root is None:
        raise WrongUse(
            "simulated chips need a source checkout of rigctl: clone it, run make firmware, "
            "or use --rig virtual"
        )
    image = root / "build" / "firmware" / f"{board}.elf"
    if not image.is_file():
        raise WrongUse(f"{image} is not built: run make firmware")
    return image


def flash_image(board: str) -> tuple[Path, str]:
    """Return the image of ``drum`` or ``taxels`` as Intel HEX, and its build hash.

    Raises WrongUse without one.
    """
    root = checkout()
    folder = root / "build" / "firmware" if root else _PACKAGE / "_data" / "firmware"
    image, hash_file = folder / f"{board}.hex", folder / f"{board}.build"
    if image.is_file() and hash_file.is_file():
        return image, hash_file.read_text().strip()
    if root is not None:
        raise WrongUse(f"{image} is not built: run make firmware, which needs avr-gcc")
    raise WrongUse(
        f"this installation has no image of the {board} board, because avr-gcc was missing when it "
        "was packed: upload the sketch that `rigctl flash --sketches DIR` writes, with the Arduino "
        "IDE"
    )


def documentation() -> Path:
    """Return the first page of the documentation, which may be missing.

    The built site's; in a checkout without one, the page as it was written.
    """
    root = checkout()
    site = root / "build" / "site" if root else _PACKAGE / "_data" / "site"
    page = site / "docs" / "README.html"
    return root / "docs" / "README.md" if root and not page.is_file() else page


def sketch_sources() -> Path:
    """Return the folder with the sources of the boards' sketches, a folder for each."""
    root = checkout()
    return root / "arduino" if root else _PACKAGE / "_data" / "arduino"


def installed_library(name: str) -> Path:
    """Return the path of a virtual board's library in an installed wheel; it may be missing."""
    return _PACKAGE / "_data" / "boards" / name


def source_commit() -> str:
    """Return the commit of the running checkout, 40 hexadecimal digits; empty if unknown."""
    root = checkout()
    if root is None:
        return ""
    try:
        head = (root / ".git" / "HEAD").read_text().strip()
        if not head.startswith("ref: "):
            return head
        return _commit_of(root / ".git", head.removeprefix("ref: "))
    except OSError:
        return ""


def _commit_of(git: Path, name: str) -> str:
    """Return a branch's commit, from the branch's own file or a line of ``packed-refs``."""
    if (git / name).is_file():
        return (git / name).read_text().strip()
    for line in (git / "packed-refs").read_text().splitlines():
        if line.endswith(f" {name}"):
            return line.split()[0]
    return ""
