"""Packages with plug-ins as pip installs them: a wheel's files, its metadata, its entry points."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

HERE = Path(__file__).parent
BUILD = "import sys, hatchling.build; hatchling.build.build_wheel(sys.argv[1])"


def install_package(source: Path, target: Path) -> None:
    """Build the wheel of a package and unpack it into a folder."""
    work = target.parent / f"build-{source.name}"
    shutil.copytree(source, work, ignore=shutil.ignore_patterns("__pycache__"))
    command = [sys.executable, "-c", BUILD, str(work / "dist")]
    subprocess.run(command, cwd=work, check=True, capture_output=True)
    (wheel,) = (work / "dist").glob("*.whl")
    with zipfile.ZipFile(wheel) as files:
        files.extractall(target)


def install_module(
    target: Path, package: str, entries: str, source: str = "", requires: str = "rigctl"
) -> None:
    """Write a package of one module and its metadata, version 1.0, into a folder.

    ``entries``: its entry points; ``source``: of the module, named as the package with underscores.
    """
    name = package.replace("-", "_")
    info = target / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (target / f"{name}.py").write_text(source, encoding="utf-8")
    (info / "entry_points.txt").write_text(entries, encoding="utf-8")
    head = f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\nRequires-Dist: {requires}\n"
    (info / "METADATA").write_text(head, encoding="utf-8")
