"""rigctl as a stranger has it: its wheel in an environment of its own, and an empty home."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import Distribution, distributions
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = ("export", "lsl")
SHARED = ("..", "__pycache__")
_BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Installed(NamedTuple):
    """An environment with rigctl, and a folder in which home and working folder are made."""

    environment: Path
    place: Path

    @property
    def python(self) -> Path:
        """The environment's Python."""
        return self.environment / "bin" / "python"

    @property
    def packages(self) -> Path:
        """Where rigctl lies in the environment."""
        return next(self.environment.glob("lib/python*/site-packages"))

    def run(
        self, *words: str | Path, before: Sequence[str] = (), **variables: str
    ) -> subprocess.CompletedProcess[str]:
        """Run a command of the environment, behind the words ``before``, and return how it ended.

        Its home and its working folder are those of the stranger; nothing of this user is seen.
        """
        home, work = self.place / "Zuhause", self.place / "erste Stunde ä"
        home.mkdir(exist_ok=True)
        work.mkdir(exist_ok=True)
        kept = {key: text for key, text in os.environ.items() if not key.startswith("XDG_")}
        path = f"{self.environment / 'bin'}{os.pathsep}{os.environ['PATH']}"
        own = {"HOME": str(home), "PATH": path, "RIGCTL_RUNTIME": str(self.place / "run")}
        own |= {"QT_QPA_PLATFORM": "offscreen", "PYTHONFAULTHANDLER": "1"} | variables
        kept.pop("PYTHONPATH", None)
        command = [*before, *map(str, words)]
        return subprocess.run(command, cwd=work, capture_output=True, text=True, env=kept | own)


def build_wheel(folder: Path) -> Path:
    """Pack a wheel for this computer and return it."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def install(wheel: Path, place: Path) -> Installed:
    """Install a wheel into a new environment, with the packages that it asks for and no other."""
    installed = Installed(place / "rigctl Prüfstand", place)
    venv.create(installed.environment, symlinks=True)
    pip = [sys.executable, "-m", "pip", "--python", str(installed.python), "install"]
    options = ["--no-deps", "--no-index", "--quiet", "--disable-pip-version-check", str(wheel)]
    subprocess.run([*pip, *options], check=True, capture_output=True)
    (rigctl,) = distributions(name="rigctl", path=[str(installed.packages)])
    for name in sorted(_packages_of(_wanted(rigctl, EXTRAS))):
        (installed.packages / name).symlink_to(Path(sysconfig.get_path("purelib")) / name)
    return installed


def _wanted(package: Distribution, extras: Iterable[str]) -> Iterator[tuple[str, frozenset[str]]]:
    """Yield what a package asks for here, with the extras of each."""
    for line in package.requires or ():
        wanted = Requirement(line)
        if any(not wanted.marker or wanted.marker.evaluate({"extra": e}) for e in ("", *extras)):
            yield wanted.name, frozenset(wanted.extras)


def _packages_of(wanted: Iterable[tuple[str, frozenset[str]]]) -> set[str]:
    """Return the files and folders of packages, and of all that these ask for.

    A package that has no wheel for this computer, such as nixio, is left out with its own.
    """
    found: set[str] = set()
    left, seen = list(wanted), set[tuple[str, frozenset[str]]]()
    while left:
        name, extras = one = left.pop()
        package = next(iter(distributions(name=name)), None)
        if package is None or one in seen:
            continue
        seen.add(one)
        left += _wanted(package, extras)
        found |= {file.parts[0] for file in package.files or () if file.parts[0] not in SHARED}
    return found


def command_blocks(page: Path) -> list[str]:
    """Return the blocks of commands of a page of the documentation, in their order."""
    return _BLOCK.findall(page.read_text(encoding="utf-8"))
