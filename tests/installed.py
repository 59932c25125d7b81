"""rigctl as a stranger has it: its wheel in an environment of its own, and an empty home."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
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
        own |= {"QT_QPA_PLATFORM": "offscreen"} | variables
        kept.pop("PYTHONPATH", None)
        command = [*before, *map(str, words)]
        return subprocess.run(command, cwd=work, capture_output=True, text=True, env=kept | own)


def build_wheel(folder: Path) -> Path:
    """Pack a wheel for this computer and return it."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def install(wheel: Path, place: Path) -> Installed:
    """Install a wheel into a new environment, which has the other packages of this Python."""
    installed = Installed(place / "rigctl Prüfstand", place)
    venv.create(installed.environment, symlinks=True)
    others = installed.packages / "others.pth"
    # Of these packages' own files of paths none is read, such as that of the checkout.
    others.write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    pip = [sys.executable, "-m", "pip", "--python", str(installed.python), "install"]
    options = ["--no-deps", "--no-index", "--quiet", "--disable-pip-version-check", str(wheel)]
    subprocess.run([*pip, *options], check=True, capture_output=True)
    return installed


def command_blocks(page: Path) -> list[str]:
    """Return the blocks of commands of a page of the documentation, in their order."""
    return _BLOCK.findall(page.read_text(encoding="utf-8"))
