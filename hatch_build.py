"""Compile the virtual boards' firmware while the package is installed or packed.

Without a compiler the installation continues. A virtual rig then fails to open, with a message that
says how to get a compiler. A wheel also contains the images that `rigctl flash` writes, where there
is avr-gcc, and the documentation, where `make site` has built it. `RIGCTL_PLATFORM` names another
platform to pack a wheel for; Zig compiles for it.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

IMAGES = tuple(f"{board}.{kind}" for board in ("drum", "taxels") for kind in ("hex", "build"))
"""What `rigctl flash` writes, and the build hash of each."""

ZIG_TARGETS = {
    "manylinux_2_17_x86_64": ("x86_64-linux-gnu.2.17", ".so"),
    "manylinux_2_17_aarch64": ("aarch64-linux-gnu.2.17", ".so"),
    "win_amd64": ("x86_64-windows-gnu", ".dll"),
    "macosx_11_0_x86_64": ("x86_64-macos.11.0", ".dylib"),
    "macosx_11_0_arm64": ("aarch64-macos.11.0", ".dylib"),
}
"""What Zig calls each platform, and the suffix of a library there."""


class VirtualBoards(BuildHookInterface[Any]):
    """Build hook: a wheel contains libraries and images, an editable install has them in build/."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile what is stale before anything is packed."""
        build = _host_build(Path(self.root))
        platform = os.environ.get("RIGCTL_PLATFORM", "")
        if platform:
            self._pack(_cross_compiled(build, platform), platform, build_data)
        else:
            self._compile_here(build, version, build_data)
        if version != "editable":
            self._pack_images(build_data)
            self._pack_site(build_data)

    def _compile_here(self, build: ModuleType, version: str, build_data: dict[str, Any]) -> None:
        try:
            build.build_stale()
        except build.BuildFailed as failed:
            self.app.display_warning(str(failed))
            return
        if version != "editable":
            libraries = [build.dynamic_library_path(board) for board in build.BOARDS]
            self._pack(libraries, sysconfig.get_platform(), build_data)

    def _pack(self, libraries: list[Path], platform: str, build_data: dict[str, Any]) -> None:
        """Pack libraries, which Python loads by their paths: any Python 3 of the platform can."""
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platform.replace('-', '_').replace('.', '_')}"
        for library in libraries:
            build_data["force_include"][str(library)] = f"rigctl/_data/boards/{library.name}"

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

    def _pack_site(self, build_data: dict[str, Any]) -> None:
        """Pack the documentation as `make site` has left it."""
        site = Path(self.root) / "build" / "site"
        if site.is_dir():
            build_data["force_include"][str(site)] = "rigctl/_data/site"
        else:
            self.app.display_warning("no build/site: the wheel has no documentation, see make site")


def _cross_compiled(build: ModuleType, platform: str) -> list[Path]:
    """Compile the boards for another platform and return the libraries."""
    target, suffix = ZIG_TARGETS[platform]
    os.environ["CXX"] = f"{sys.executable} -m ziglang c++ -target {target} -s"
    folder = build.ROOT / "build" / "wheels" / platform
    return [build.build(board, folder / f"virtual-{board}{suffix}") for board in build.BOARDS]


def _host_build(root: Path) -> ModuleType:
    """Load rigctl/host_build.py by its path, because the package is not installed yet."""
    name = "rigctl_host_build"
    spec = importlib.util.spec_from_file_location(name, root / "rigctl/host_build.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
