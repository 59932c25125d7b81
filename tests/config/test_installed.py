"""The documentation as a site, and the wheel: a stranger's first hour, bad surroundings."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from rigctl import host_build
from rigctl.session.verify import verify
from tests.firmware.building import build_lock
from tests.installed import ROOT, Installed, build_wheel, command_blocks, install

ASK = """
from pathlib import Path
from rigctl.config import resources
from rigctl.errors import RigctlError
from rigctl.protocol.loader import load_protocol
print(resources.__file__)
print(len(load_protocol(resources.find_protocol("paper")).plan().trials))
try:
    resources.firmware_image("drum")
except RigctlError as error:
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
START_VIRTUAL_RIG = """
from PySide6.QtCore import QTimer
import gui.app
shown = gui.app._shown_window
def look(window):
    if window.live_plots.data.history.head:
        print(window.event_log.toPlainText())
        window.attach.leave()
    else:
        QTimer.singleShot(20, lambda: look(window))
def shown_and_used(*how):
    window = shown(*how)
    QTimer.singleShot(0, window.start.virtual.click)
    QTimer.singleShot(0, lambda: look(window))
    return window
gui.app._shown_window = shown_and_used
raise SystemExit(gui.app.main([]))
"""
DAY = """
import sys
sys.path += sys.argv[1:3]  # behind the wheel: the tests, and what they need
import gui.app, pytest
print(gui.app.__file__, flush=True)
options = ["-q", "-p", "no:cacheprovider", "-c", "/dev/null", "--rootdir", sys.argv[1]]
raise SystemExit(pytest.main([*options, sys.argv[3]]))
"""
TINY = """
name = "tiny"
textures = ["D"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 1
trial.travel_mm = 60
"""
CONTENTS = (
    "rigctl/py.typed",
    "rigctl/_data/wiring/wiring-mega.svg",
    "rigctl/_data/wiring/wiring-uno.svg",
    "rigctl/_data/wiring/wiring-teensy.svg",
    "rigctl/_data/protocols/finger/paper.toml",
    "rigctl/_data/site/docs/README.html",
    "rigctl/_data/site/searchindex.js",
    "../../../share/applications/rigctl.desktop",
    "../../../share/icons/hicolor/scalable/apps/rigctl.svg",
)
GERMAN = {"LC_ALL": "de_DE.UTF-8", "LANG": "de_DE.UTF-8", "LANGUAGE": "de"}
DEAD_LINKS = """\
# Page

## A part

[a part](#a-part), [no part](#no-part), [no page](gone.md), [no file](../gone.py)
"""
LOADED = re.compile(r"""<(?:script|link|img)[^>]+(?:src|href)="(?:https?:)?//""")


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
def installed(tmp_path_factory: pytest.TempPathFactory, site: Path) -> Installed:
    """Install the wheel of this computer, with the site, in a new environment."""
    folder = tmp_path_factory.mktemp("stranger")
    with build_lock():  # the wheel's hook runs make
        wheel = build_wheel(folder)
    assert "-py3-none-linux" in wheel.name
    return install(wheel, folder)


def test_a_wheel_carries_the_protocols_and_the_virtual_boards(installed: Installed) -> None:
    packages = installed.packages
    out = installed.run(installed.python, "-c", ASK).stdout
    where, trials, image, drum, taxels, sketches, *libraries, pages = out.splitlines()
    for board, line in (("drum", drum), ("taxels", taxels)):
        build_hash = host_build.image_hash(board)
        assert line == f"{packages}/rigctl/_data/firmware/{board}.hex {build_hash} 0"
    assert all(int(count) > 10 for count in sketches.split())
    assert where.startswith(str(packages))
    assert trials == "24000"
    assert "need a source checkout" in image
    assert len(libraries) == 2
    assert all(library.startswith(str(packages)) for library in libraries)
    assert pages == f"{packages}/rigctl/_data/site/docs/README.html"
    assert [name for name in CONTENTS if not (packages / name).exists()] == []


def test_a_strangers_hour(installed: Installed) -> None:
    """Every command of the tutorial is run, in a German environment with blanks and umlauts."""
    (page,) = (ROOT / "docs" / "tutorial").glob("*.md")
    said = ""
    for block in command_blocks(page):
        window = block.replace("rigctl gui", 'python -c "$WINDOW"')
        ran = installed.run("sh", "-ec", window, WINDOW=START_VIRTUAL_RIG, **GERMAN)
        assert ran.returncode == 0 and "Traceback" not in ran.stderr, (block, ran)
        said += ran.stdout
    for promised in (
        "all data come from the simulated bench",
        "taxel board connected: firmware",
        "the rig is set up",
        "the drum has pressed, with ",
        "first-day is whole: 32 trials committed",
        "report: report/report.html",
    ):
        assert promised in said


def test_a_day_in_the_window_that_the_wheel_brings(installed: Installed, tmp_path: Path) -> None:
    """What the tutorial does in the window is done there: bring up, touch, run, note, analyse."""
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    page = str(tmp_path / "tests" / "gui" / "shell" / "test_day_by_keyboard.py")
    ran = installed.run(
        installed.python, "-c", DAY, str(tmp_path), sysconfig.get_path("purelib"), page
    )
    assert ran.returncode == 0 and "1 passed" in ran.stdout, ran
    assert ran.stdout.startswith(str(installed.packages))


def without_rights(shared_memory: str) -> list[str]:
    """Return the words before a command that may write only where permissions allow it.

    They are root's in most containers, whom no permission binds. ``shared_memory`` is a command of
    the shell that changes /dev/shm for it alone.
    """
    drop = "exec setpriv --bounding-set=-dac_override,-dac_read_search"
    own = ["unshare", "--mount", *([] if os.geteuid() == 0 else ["--map-root-user"])]
    words = [*own, "sh", "-ec", f'{shared_memory}; {drop} "$@"', "sh"]
    if subprocess.run([*words, "true"], capture_output=True).returncode:
        pytest.skip("this computer lets nobody change /dev/shm for one program")
    return words


def test_neither_home_nor_shared_memory_is_needed(installed: Installed, tmp_path: Path) -> None:
    """A run is recorded whole, from files with blanks and umlauts, and the window tells of it."""
    before = without_rights("mount -t tmpfs -o ro none /dev/shm")
    folder = tmp_path / "Prüfstand Ä 1"
    folder.mkdir()
    (folder / "Maße.toml").write_text('[ports]\nsimulate = "virtual"\n')
    (folder / "kurz ß.toml").write_text(TINY)
    home = installed.place / "Zuhause"
    home.chmod(0o555)
    words = ["run", folder / "kurz ß.toml", "--rig", folder / "Maße.toml", "--yes"]
    homes = {f"XDG_{kind}_HOME": str(home / kind) for kind in ("CACHE", "CONFIG", "DATA", "STATE")}
    run = installed.run(
        "rigctl", *words, "--out", folder / "Sitzung 1", before=before, **homes, **GERMAN
    )
    window = installed.run("python", "-c", START_VIRTUAL_RIG, before=before, **homes)
    home.chmod(0o755)
    assert (run.returncode, window.returncode) == (0, 0), (run, window)
    assert "window.ini cannot be written: this window forgets" in window.stdout
    assert not any("Traceback" in each.stdout + each.stderr for each in (run, window))
    assert verify(folder / "Sitzung 1").whole


def test_an_installation_that_takes_no_files_compiles_elsewhere(installed: Installed) -> None:
    """It is root's, and its user has no home: numba finds no place for its machine code."""
    folders = [path for path in installed.packages.rglob("*") if path.name == "__pycache__"]
    for path in folders:
        path.chmod(0o555)
    ran = installed.run(
        "rigctl", "doctor", before=without_rights("true"), HOME="/dev/null", XDG_CACHE_HOME=""
    )
    for path in folders:
        path.chmod(0o755)
    assert "virtual boards" in ran.stdout and "Traceback" not in ran.stderr, ran
    assert any((installed.place / "run").glob("*/numba"))
