"""Compile the virtual boards' firmware while the package is installed or packed.

Without a compiler the installation continues. A virtual rig then fails to open, with a message that
says how to get a compiler. A wheel also contains the images that `rigctl flash` writes, where there
is avr-gcc.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

IMAGES = tuple(f"{board}.{kind}" for board in ("drum", "taxels") for kind in ("hex", "build"))
"""What `rigctl flash` writes, and the build hash of each."""


class VirtualBoards(BuildHookInterface[Any]):
    """Build hook: a wheel contains libraries and images, an editable install has them in build/."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile what is stale before anything is packed."""
        build = _host_build(Path(self.root))
        try:
            build.build_stale()
        except build.BuildFailed as failed:
            self.app.display_warning(str(failed))
        else:
            if version != "editable":
                self._pack(build, build_data)
        if version != "editable":
            self._pack_images(build_data)

    def _pack(self, build: ModuleType, build_data: dict[str, Any]) -> None:
        build_data["pure_python"] = False
        build_data["infer_tag"] = True
        for board in build.BOARDS:
            place = f"rigctl/_data/boards/{build.dynamic_library_name(board)}"
            build_data["force_include"][str(build.dynamic_library_path(board))] = place

    def _pack_images(self, build_data: dict[str, Any]) -> None:
        """Build and pack the boards' images."""
        if not shutil.which("avr-g++") or not shutil.which("make"):
            self.app.display_warning("no avr-gcc: the wheel has no images for `rigctl flash`")
            return
        targets = [f"../build/firmware/{name}" for name in IMAGES if name.endswith(".hex")]
        command = ["make", "-C", "arduino", f"PYTHON={sys.executable}", *targets]
        subprocess.run(command, cwd=self.root, check=True)
        for name in IMAGES:
            image = Path(self.root) / "build" / "firmware" / name
            build_data["force_include"][str(image)] = f"rigctl/_data/firmware/{name}"


def _host_build(root: Path) -> ModuleType:
    """Load rigctl/host_build.py by its path, because the package is not installed yet."""
    name = "rigctl_host_build"
    spec = importlib.util.spec_from_file_location(name, root / "rigctl/host_build.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
