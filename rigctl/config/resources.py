"""Where protocols and firmware images lie: in a checkout, or in an installed wheel.

A wheel carries the protocols in ``rigctl/_data``. An editable install has no such folder, so
the checkout is looked at first. Firmware images are built, and found, in a checkout only.
"""

from __future__ import annotations

from pathlib import Path

from rigctl.errors import ProtocolError, WrongUse

_PACKAGE = Path(__file__).resolve().parents[1]
BOARDS = ("drum", "taxels")


def checkout() -> Path | None:
    """Root of the source checkout that this package runs from; None in an installed wheel."""
    root = _PACKAGE.parent
    return root if (root / "arduino").is_dir() and (root / "pyproject.toml").is_file() else None


def protocols() -> Path:
    """Folder of the protocols that come with the program."""
    root = checkout()
    return root / "protocols" if root else _PACKAGE / "_data" / "protocols"


def find_protocol(name: str) -> Path:
    """The file that ``name`` means: a path, or the bare name of a protocol that comes with us.

    ``quick``, ``quick.toml`` and ``protocols/quick.toml`` all find the shipped one where no such
    file stands in the current folder. Raises ProtocolError with the names there are.
    """
    path = Path(name)
    if path.is_file():
        return path
    shipped = protocols() / (path.name if path.suffix == ".toml" else f"{path.name}.toml")
    if path.parent in (Path(), Path("protocols")) and shipped.is_file():
        return shipped
    known = ", ".join(sorted(p.stem for p in protocols().glob("*.toml"))) or "none"
    raise ProtocolError(f"there is no protocol {name}; give a file, or one of those here: {known}")


def firmware_image(board: str) -> Path:
    """The compiled image (ELF) of ``drum`` or ``taxels``; raises WrongUse where there is none."""
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


def installed_library(name: str) -> Path:
    """Where an installed wheel carries a virtual board's library; it may be missing."""
    return _PACKAGE / "_data" / "boards" / name


def source_commit() -> str:
    """Commit of the checkout that runs, 40 hexadecimal digits; empty where it is not known."""
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
    """A branch's commit lies in a file of its own, or in a line of ``packed-refs``."""
    if (git / name).is_file():
        return (git / name).read_text().strip()
    for line in (git / "packed-refs").read_text().splitlines():
        if line.endswith(f" {name}"):
            return line.split()[0]
    return ""
