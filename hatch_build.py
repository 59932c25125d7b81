"""Compile the virtual boards' firmware while the package is installed or packed.

Without a compiler the installation continues. A virtual rig then fails to open, with a message that
says how to get a compiler.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class VirtualBoards(BuildHookInterface[Any]):
    """Build hook: a wheel contains both libraries, an editable install has them in build/."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile what is stale before anything is packed."""
        build = _host_build(Path(self.root))
        try:
            build.build_stale()
        except build.BuildFailed as failed:
            self.app.display_warning(str(failed))
            return
        if version != "editable":
            self._pack(build, build_data)

    def _pack(self, build: ModuleType, build_data: dict[str, Any]) -> None:
        build_data["pure_python"] = False
        build_data["infer_tag"] = True
        for board in build.BOARDS:
            place = f"rigctl/_data/boards/{build.dynamic_library_name(board)}"
            build_data["force_include"][str(build.dynamic_library_path(board))] = place


def _host_build(root: Path) -> ModuleType:
    """Load rigctl/host_build.py by its path, because the package is not installed yet."""
    name = "rigctl_host_build"
    spec = importlib.util.spec_from_file_location(name, root / "rigctl/host_build.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
