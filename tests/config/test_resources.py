"""Protocols and pages are found in a checkout and in a wheel; images in a checkout only."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from rigctl import host_build
from rigctl.config import resources
from rigctl.errors import ProtocolError, WrongUse
from tests.firmware.building import build_lock

ROOT = Path(__file__).resolve().parents[2]
ASK = """
from pathlib import Path
from rigctl.config import resources
from rigctl.protocol.loader import load_protocol
print(resources.__file__)
print(len(load_protocol(resources.find_protocol("paper")).plan().trials))
try:
    resources.firmware_image("drum")
except Exception as error:
    print(error)
from rigctl.bench.boards.drum_firmware import DrumFirmware
from rigctl.bench.boards.taxels import TaxelFirmware
from rigctl.boards.flash import installed_image, read_image
from rigctl.boards.flash import write_sketches
for board in ("drum", "taxels"):
    image, build_hash = installed_image(board)
    print(image, build_hash, read_image(image)[0][0])
print(*(len(list(folder.iterdir())) for folder in write_sketches(Path("sketches"))))
for board in (DrumFirmware(), TaxelFirmware()):
    print(board._library._name)
    board.close()
print(resources.documentation())
"""
OPEN_WINDOW = """
from PySide6.QtCore import QTimer
import gui.app
shown = gui.app._shown_window
def shown_once(theme):
    window = shown(theme)
    QTimer.singleShot(0, window.close)
    return window
gui.app._shown_window = shown_once
print(gui.app.__file__, gui.app.main([]))
"""
CONTENTS = (
    "rigctl/py.typed",
    "rigctl/_data/wiring/wiring-mega.svg",
    "rigctl/_data/wiring/wiring-uno.svg",
    "rigctl/_data/wiring/wiring-teensy.svg",
    "rigctl/_data/protocols/finger/paper.toml",
    "rigctl/_data/site/docs/README.html",
    "rigctl/_data/site/searchindex.js",
    "rigctl-*.data/data/share/applications/rigctl.desktop",
    "rigctl-*.data/data/share/icons/hicolor/scalable/apps/rigctl.svg",
)
DEAD_LINKS = """\
# Page

## A part

[a part](#a-part), [no part](#no-part), [no page](gone.md), [no file](../gone.py)
"""
LOADED = re.compile(r"""<(?:script|link|img)[^>]+(?:src|href)="(?:https?:)?//""")


def test_a_checkout_finds_its_own_protocols(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert resources.checkout() == ROOT
    monkeypatch.chdir(tmp_path)
    shipped = ROOT / "protocols" / "quick.toml"
    for name in ("quick", "quick.toml", "protocols/quick.toml"):
        assert resources.find_protocol(name) == shipped
    (tmp_path / "quick.toml").write_text("")
    assert resources.find_protocol("quick.toml") == Path("quick.toml")
    with pytest.raises(ProtocolError, match="quick, sensor, showcase"):
        resources.find_protocol("elsewhere/quick.toml")


def test_a_missing_image_says_how_to_build_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(resources, "checkout", lambda: tmp_path)
    with pytest.raises(WrongUse, match="run make firmware"):
        resources.firmware_image("drum")
    image = tmp_path / "build" / "firmware" / "taxels.elf"
    image.parent.mkdir(parents=True)
    image.write_bytes(b"")
    assert resources.firmware_image("taxels") == image


def test_the_commit_is_read_from_the_checkout(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(resources, "checkout", lambda: tmp_path)
    assert resources.source_commit() == ""
    branch = tmp_path / ".git" / "refs" / "heads" / "main"
    branch.parent.mkdir(parents=True)
    (tmp_path / ".git" / "HEAD").write_text("ref: refs/heads/main\n")
    (tmp_path / ".git" / "packed-refs").write_text(f"# pack-refs\n{'b' * 40} refs/heads/main\n")
    assert resources.source_commit() == "b" * 40
    branch.write_text("a" * 40 + "\n")
    assert resources.source_commit() == "a" * 40
    (tmp_path / ".git" / "HEAD").write_text("c" * 40)
    assert resources.source_commit() == "c" * 40
    monkeypatch.setattr(resources, "checkout", lambda: None)
    assert resources.source_commit() == ""


def test_help_opens_the_site_or_the_page_as_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(resources, "checkout", lambda: tmp_path)
    assert resources.documentation() == tmp_path / "docs" / "README.md"
    page = tmp_path / "build" / "site" / "docs" / "README.html"
    page.parent.mkdir(parents=True)
    page.write_text("")
    assert resources.documentation() == page


@pytest.fixture(scope="module")
def site() -> Path:
    """Build the documentation, where a warning is an error, and return the site's folder."""
    # The Python environment is the one that runs the tests.
    command = ["make", "--silent", "--assume-old=.venv/.ready", "site"]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert (built.returncode, built.stderr) == (0, "")
    return ROOT / "build" / "site"


def test_the_site_has_every_page_and_needs_no_network(site: Path) -> None:
    sources = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "arduino" / "README.md"]
    pages = [site / source.relative_to(ROOT).with_suffix(".html") for source in sources]
    assert [page for page in pages if not page.is_file()] == []
    assert [page for page in pages if LOADED.search(page.read_text(encoding="utf-8"))] == []
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    assert index.startswith("Search.setIndex(") and '"docs/reference/glossary"' in index


def test_the_reference_comes_from_the_code(site: Path) -> None:
    api = (site / "docs" / "reference" / "api.html").read_text(encoding="utf-8")
    assert 'id="rigctl.ConnectedRig.approach"' in api
    assert "Press until the set force has settled." in api
    options = (site / "docs" / "reference" / "options.html").read_text(encoding="utf-8")
    assert "rigctl export" in options and "--representations" in options


def test_a_dead_link_fails_the_site(tmp_path: Path) -> None:
    (tmp_path / "index.md").write_text(DEAD_LINKS)
    build = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet"]
    build += ["--conf-dir", "docs", "--define", "root_doc=index", str(tmp_path)]
    built = subprocess.run(
        [*build, str(tmp_path / "out")], cwd=ROOT, capture_output=True, text=True
    )
    assert built.returncode == 1
    assert re.findall(r"target not found: '(.*?)'", built.stderr) == [
        "no-part",
        "gone.md",
        "../gone.py",
    ]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory, site: Path) -> Path:
    """Build the wheel of this computer, with the site, and return it."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    with build_lock():  # the wheel's hook runs make
        subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel: Path) -> Path:
    """Unpack the wheel outside the checkout and return the folder, for PYTHONPATH."""
    with zipfile.ZipFile(wheel) as file:
        file.extractall(wheel.parent / "site")
    return wheel.parent / "site"


def run_installed(installed: Path, place: Path, *words: str) -> str:
    """Run Python on the installed wheel and return what it prints."""
    folders = {"RIGCTL_RUNTIME": str(place), "XDG_CONFIG_HOME": str(place)}
    environment = {**os.environ, **folders, "PYTHONPATH": str(installed)}
    environment["QT_QPA_PLATFORM"] = "offscreen"
    command = [sys.executable, *words]
    return subprocess.run(
        command, cwd=place, check=True, capture_output=True, text=True, env=environment
    ).stdout


def test_a_wheel_carries_the_protocols_and_the_virtual_boards(
    installed: Path, wheel: Path, tmp_path: Path
) -> None:
    out = run_installed(installed, tmp_path, "-c", ASK)
    where, trials, image, drum, taxels, sketches, *libraries, pages = out.splitlines()
    for board, line in (("drum", drum), ("taxels", taxels)):
        build_hash = host_build.image_hash(board)
        assert line == f"{installed}/rigctl/_data/firmware/{board}.hex {build_hash} 0"
    assert all(int(count) > 10 for count in sketches.split())
    assert where.startswith(str(installed))
    assert trials == "24000"
    assert "need a source checkout" in image
    assert len(libraries) == 2
    assert all(library.startswith(str(installed)) for library in libraries)
    assert pages == f"{installed}/rigctl/_data/site/docs/README.html"
    assert "-py3-none-linux" in wheel.name
    assert [name for name in CONTENTS if not any(installed.glob(name))] == []


def test_a_wheel_runs_outside_the_checkout(installed: Path, tmp_path: Path) -> None:
    """The demo records, verifies, encodes and classifies; a rehearsed setup checks each part."""
    demo = run_installed(
        installed, tmp_path, "-m", "rigctl", "demo", "--no-window", "--out", "demo"
    )
    assert "is whole" in demo and "all data come from the simulated bench" in demo
    setup = run_installed(installed, tmp_path, "-m", "rigctl", "setup", "--rig", "virtual", "--yes")
    assert "the rig is set up" in setup
    window = run_installed(installed, tmp_path, "-c", OPEN_WINDOW)
    assert window == f"{installed}/gui/app.py 0\n"
