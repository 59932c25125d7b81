"""The example packages, installed into a folder that Python searches."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rigctl.plugins import installed
from tests.drivers.support import HERE, install_package


@pytest.fixture(scope="session")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder with both example packages."""
    target = tmp_path_factory.mktemp("packages") / "site"
    for name in ("teensy16", "step_axis"):
        install_package(HERE / name, target)
    return target


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Yield an empty folder of packages that Python searches first."""
    folder = tmp_path / "site"
    folder.mkdir()
    yield from searched(folder, monkeypatch)


@pytest.fixture
def examples(packages: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Yield the folder with both example packages, which Python searches first."""
    yield from searched(packages, monkeypatch)


def searched(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Yield a folder that Python searches first for packages, and forget them at the end."""
    monkeypatch.syspath_prepend(str(folder))
    installed.cache_clear()
    before = set(sys.modules)
    yield folder
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(folder)):
            del sys.modules[name]
    installed.cache_clear()
