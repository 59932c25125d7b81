"""Check this computer and the boards, and name the cure of each fault.

One line for each of: Python, packages, plug-ins of other packages, virtual boards, Qt, fonts,
serial ports and who may open them, brltty, ModemManager, clock, disk, file locks, shared memory,
last crash, unclosed session, and the firmware of each board. Asking a board resets it, so a rig
that an engine uses is not asked.
--write-udev-rule writes a rule that you install yourself, and checks nothing. Exit code 1:
something needs doing.
"""

from __future__ import annotations

import argparse
import asyncio
import importlib.metadata
import json
import mmap
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Coroutine, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import platformdirs
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from platformdirs.unix import Unix

from rigctl.analysis.further_tasks import TASK_FAMILIES
from rigctl.bench.boards.drum_firmware import DrumFirmware
from rigctl.bench.boards.firmware_library import FirmwareLibrary
from rigctl.bench.boards.taxels import TaxelFirmware
from rigctl.boards.port_discovery import PortReport, probe_ports
from rigctl.boards.sensor_driver import SENSORS
from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.ports import SILENT_FIRST
from rigctl.config.resources import WINDOW_DEBIAN_PACKAGES, checkout, flash_image
from rigctl.config.rig_config import RigConfig
from rigctl.engine.axis import ACTUATORS
from rigctl.engine.health import ACTIVE_WINDOW_S, RESERVE_BYTES
from rigctl.engine.rpc.engine_files import (
    LOG,
    EngineFile,
    is_crash_report,
    running_engines,
    runtime_folder,
)
from rigctl.errors import RigctlError, RigFault, WrongUse
from rigctl.exchange.export.formats import FORMATS
from rigctl.experiments import EXPERIMENTS, FINGER_EXPERIMENT
from rigctl.host_build import image_hash
from rigctl.plugins import Lookup, installed
from rigctl.protocol.plan import recorded_bytes_per_s
from rigctl.session.writer_lock import LOCK_FILE, Writer, try_lock, writer_of

DAY_S = 86_400.0
RECENT_S = 7 * DAY_S
"""A crash of the last week needs doing; an older one is only told."""
CLOCK_TOLERANCE_S = 60.0
JUMP_S = 0.1
"""A clock that is slewed gains or loses at most 0.5 ms a second."""
WRITTEN_BYTES = 16 << 20
WRITING_S = 0.7
"""Both bound the test of the disk: it ends with the write that passes one of them."""
RECORDING_S = 8 * 3600.0
"""A disk has room for a working day."""
SPARE = 10
"""A disk writes this many times as fast as a session grows: others use it too."""
SEGMENT_BYTES = 16 << 20
"""More than the live data of an engine."""
CHILD_S = 60.0

_MODULES = {
    "pyserial": "serial",
    "scikit-learn": "sklearn",
    "pyside6-essentials": "PySide6",
    "vl-convert-python": "vl_convert",
}
"""The modules of packages that are not named alike."""
_IMPORT = """
import sys
from importlib import import_module
for module in sys.argv[1:]:
    try:
        import_module(module)
    except Exception as error:
        sys.exit(f"{module}: {error}")
"""
_START_QT = """
import os
from PySide6.QtCore import QtMsgType, qInstallMessageHandler
from PySide6.QtGui import QGuiApplication

said = []


def hear(kind, context, text):
    said.append(text)
    if kind == QtMsgType.QtFatalMsg:  # Qt aborts now
        os.write(2, said[0].encode())
        os._exit(1)


qInstallMessageHandler(hear)
QGuiApplication([])
"""
_FONTS = ("*.ttf", "*.otf", "*.ttc")
_FONT_FOLDERS = ("usr/share/fonts", "usr/local/share/fonts", ".local/share/fonts", ".fonts")
_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
_CLOCK_KEEPERS = ("chronyd", "ntpd", "ptp4l", "phc2sys", "VBoxService", "vmtoolsd")
_TIMESYNCD = "systemd-timesyn"
"""As /proc shows it, in 15 letters."""
_RULE_NAME = "60-rigctl.rules"
"""Before 73-seat-late.rules, which gives ``uaccess`` its meaning."""
_RULES = ("etc/udev/rules.d", "run/udev/rules.d", "usr/lib/udev/rules.d", "lib/udev/rules.d")
_CH340 = ("1a86", "7523")
_PERMISSIONS = "port permissions"
_GROUP_OPENS = 0o060
_WRITE_RULE = f"rigctl doctor --write-udev-rule {_RULE_NAME}, and install it as it says"
UDEV_RULE = """\
# Serial ports of the rig's boards: who is logged in at this computer may open them, and
# ModemManager leaves them alone. Written by rigctl doctor; belongs into /etc/udev/rules.d.
ACTION=="remove", GOTO="rigctl_end"
SUBSYSTEMS=="usb", ATTRS{idVendor}=="2341|2a03|1a86|0403|16c0", GOTO="rigctl_board"
GOTO="rigctl_end"
LABEL="rigctl_board"
ENV{ID_MM_DEVICE_IGNORE}="1", ENV{ID_MM_PORT_IGNORE}="1"
SUBSYSTEM=="tty", TAG+="uaccess"
# The loader of a Teensy speaks to the USB device itself.
ATTRS{idVendor}=="16c0", SUBSYSTEM=="usb|hidraw", TAG+="uaccess"
LABEL="rigctl_end"
"""


Probe = Callable[[asyncio.AbstractEventLoop], Coroutine[None, None, list[PortReport]]]
"""Returns a report of each serial port, as :func:`probe_ports`."""


class State(StrEnum):
    """What a check found; ``attention`` means that something needs doing."""

    OK = "ok"
    ATTENTION = "attention"
    UNKNOWN = "unknown"


OK, ATTENTION, UNKNOWN = State


@dataclass(frozen=True, slots=True)
class Finding:
    """What one check found, in a sentence, and the cure where there is one."""

    name: str
    state: State
    sentence: str
    cure: str = ""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(
        parser,
        "--out",
        a_path,
        "DIR",
        "the folder where sessions go, whose disk is tested (sessions)",
        default=Path("sessions"),
    )
    add_option(
        parser,
        "--write-udev-rule",
        a_path,
        "FILE",
        "write the rule for the boards' serial ports to FILE, and say how to install it",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print the findings, or write the udev rule; return 1 where something needs doing."""
    if args.write_udev_rule is not None:
        print(write_udev_rule(args.write_udev_rule))
        return 0
    return print_findings(examine(args.out), args.json)


def print_findings(findings: Iterable[Finding], as_json: bool) -> int:
    """Print each finding as it comes, or all as one JSON object; return the exit code."""
    all_found = []
    for finding in findings:
        all_found.append(finding)
        if not as_json:
            cure = f": {finding.cure}" if finding.cure else ""
            print(f"{finding.state:<9}  {finding.name}: {finding.sentence}{cure}", flush=True)
    needs_doing = any(finding.state is ATTENTION for finding in all_found)
    if as_json:
        found = [asdict(finding) for finding in all_found]
        print(json.dumps({"ok": not needs_doing, "findings": found}, ensure_ascii=False))
    return int(needs_doing)


def write_udev_rule(path: Path) -> str:
    """Write the rule to a new file; return how to install it. Raises WrongUse."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(UDEV_RULE)
    except OSError as error:
        raise WrongUse(
            f"{path} cannot be written ({error.strerror}): name a new file in a folder of yours"
        ) from error
    return (
        f"{path} is written; to install it:\n"
        f"  sudo cp {path} /etc/udev/rules.d/{_RULE_NAME}\n"
        "  sudo udevadm control --reload && sudo udevadm trigger"
    )


def examine(
    out: Path,
    root: Path = Path("/"),
    system: str = sys.platform,
    probe: Probe = probe_ports,
) -> Iterator[Finding]:
    """Yield a finding for each check.

    ``out`` is the folder of the sessions, ``root`` stands for / of a Linux computer, and ``probe``
    returns the reports of the serial ports.
    """
    started = time.time(), time.monotonic()
    home = root / Path.home().relative_to("/") if system == "linux" else Path.home()
    yield from examine_program(root, home, system)
    yield from examine_system(root, system)
    yield tried("disk", lambda: check_disk(existing(out), measure_disk))
    yield tried("file locks", lambda: check_locks(root, existing(out), locking_error))
    engines = find_engines()
    running: list[EngineFile] = []
    logs: list[Path] = []
    if isinstance(engines, Finding):
        yield engines
    else:
        folder, running = engines
        logs = engine_logs(folder, running)
        shared = [root / "dev/shm", folder] if system == "linux" else [folder]
        yield tried("shared memory", lambda: check_shared_memory(shared))
    yield tried("last crash", lambda: check_crash(crash_reports_folder(), logs, time.time()))
    folders = (out, Path.home() / "rigctl-sessions")
    yield tried("last session", lambda: check_last_session(folders))
    yield tried("clock", lambda: check_clock(root, system, time.time(), jump_s(*started)))
    yield from examine_boards(running, probe)


def examine_program(root: Path, home: Path, system: str) -> Iterator[Finding]:
    """Yield what Python, its packages, the virtual boards, Qt and the fonts give cause for."""
    required, lines = requirements(checkout())
    needed = needed_packages(lines)
    versions = installed_versions(needed)
    yield check_python(
        sys.version_info[:3],
        sys.implementation.name,
        required,
        versions.get("pyside6-essentials", ""),
        sys.prefix if sys.prefix != sys.base_prefix else "",
    )
    yield check_packages(needed, versions, import_error(versions))
    yield from check_plugins(lookups())
    yield check_virtual_boards()
    yield check_qt(system, os.environ)
    yield tried("fonts", lambda: check_fonts(root, home, system))


def examine_system(root: Path, system: str) -> Iterator[Finding]:
    """Yield what serial ports, brltty and ModemManager give cause for."""
    if system != "linux":
        text = f"nothing to check on {system}: neither groups nor udev guard a port there"
        yield Finding(_PERMISSIONS, OK, text)
        return
    yield tried(_PERMISSIONS, lambda: check_permissions(root, os.getuid(), os.getgroups()))
    yield tried("brltty", lambda: check_brltty(root))
    yield tried("ModemManager", lambda: check_modem_manager(root))


def examine_boards(running: Sequence[EngineFile], probe: Probe) -> Iterator[Finding]:
    """Yield a finding for each serial port, unless an engine uses a bench."""
    benches = [engine for engine in running if engine.rig.endswith(".toml")]
    if benches:
        yield Finding(
            "boards",
            UNKNOWN,
            f"an engine (process {benches[0].pid}) uses the boards of {benches[0].rig}",
            "disconnect its clients, then ask again",
        )
        return
    print(f"asking every port; {SILENT_FIRST}", file=sys.stderr)
    with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        reports = runner.run(probe(runner.get_loop()))
    if not reports:
        yield Finding("boards", OK, "no serial port, so no board is plugged in")
    for report in reports:
        yield check_board(report, installed_build)


def tried(name: str, check: Callable[[], Finding]) -> Finding:
    """Return what a check finds; ``unknown`` where the system does not let it read something."""
    try:
        return check()
    except OSError as error:
        return Finding(name, UNKNOWN, f"cannot be checked ({error})")


def check_python(
    version: Sequence[int], implementation: str, required: str, pyside: str, environment: str
) -> Finding:
    """Check Python's version; ``environment`` is the virtual environment's folder or empty."""
    name, number = "Python", ".".join(map(str, version))
    if number not in SpecifierSet(required):
        text = f"{number} is not {required}, which rigctl needs"
        return Finding(name, ATTENTION, text, "install a newer Python, then make setup")
    # PySide6 6.12 drops a reference to None with each call there, and dies within minutes.
    crashes = (implementation, *version[:2]) == ("cpython", 3, 11)
    if crashes and pyside and pyside in SpecifierSet(">=6.12"):
        text = f"PySide6 {pyside} crashes on CPython {number} within minutes"
        return Finding(name, ATTENTION, text, "pip install 'PySide6-Essentials<6.12'")
    place = f"in the virtual environment {environment}" if environment else "of the system"
    return Finding(name, OK, f"{number} {place}")


def lookups() -> tuple[Lookup[Any], ...]:
    """Return all that other packages may bring."""
    trackers = EXPERIMENTS[FINGER_EXPERIMENT].load("trackers")
    return SENSORS, ACTUATORS, trackers, FORMATS, TASK_FAMILIES


def check_plugins(kinds: Iterable[Lookup[Any]]) -> Iterator[Finding]:
    """Yield a finding for each plug-in: what it is and from where, or why it cannot be used."""
    name, found = "plug-in", [(one, plugin) for one in kinds for plugin in installed(one.kind)]
    if not found:
        yield Finding(name, OK, "no package brings one")
    for lookup, plugin in found:
        try:
            lookup.load(plugin.name)
        except WrongUse as error:
            sentence, _, cure = str(error).rpartition(": ")
            yield Finding(name, ATTENTION, sentence, cure)
        else:
            yield Finding(name, OK, str(plugin))


def requirements(source: Path | None) -> tuple[str, list[str]]:
    """Return the versions of Python and the packages that rigctl needs.

    A checkout (``source``) may be newer than its installation, which then says too little.
    """
    if source is None:
        told = importlib.metadata.metadata("rigctl")
        return told["Requires-Python"], told.get_all("Requires-Dist") or []
    project = tomllib.loads((source / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return project["requires-python"], project["dependencies"]


def needed_packages(lines: Iterable[str]) -> dict[str, SpecifierSet]:
    """Return the versions that rigctl needs here of each package, by its normalised name."""
    needed = [Requirement(line) for line in lines]
    here = [one for one in needed if one.marker is None or one.marker.evaluate({"extra": ""})]
    return {canonicalize_name(one.name): one.specifier for one in here}


def installed_versions(names: Iterable[str]) -> dict[str, str]:
    """Return the versions of those packages that are installed."""
    versions = {}
    for name in names:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def check_packages(
    needed: Mapping[str, SpecifierSet], versions: Mapping[str, str], failure: str
) -> Finding:
    """Check the installed versions; ``failure`` is the error of importing them, or empty."""
    wrong = [
        f"{name} {versions[name]} is not {specifier}" if name in versions else f"{name} is missing"
        for name, specifier in needed.items()
        if name not in versions or not specifier.contains(versions[name], prereleases=True)
    ]
    if failure:
        wrong.append(f"cannot be imported: {failure}")
    if wrong:
        cure = "pip install --only-binary :all: -r requirements.lock, in the same environment"
        return Finding("packages", ATTENTION, "; ".join(wrong), cure)
    listed = ", ".join(f"{name} {versions[name]}" for name in needed)
    return Finding("packages", OK, listed)


def import_error(names: Iterable[str]) -> str:
    """Import packages in a process of its own; return the first error, or empty."""
    modules = [_MODULES.get(name, name) for name in names]
    # pyqtgraph loads Qt, which has a check of its own.
    return child_error(_IMPORT, *(module for module in modules if module != "pyqtgraph"))


def child_error(code: str, *words: str, environment: Mapping[str, str] | None = None) -> str:
    """Run Python code in a child; return its last line where it fails, else empty."""
    command = [sys.executable, "-P", "-c", code, *words]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=CHILD_S,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no end within {CHILD_S:.0f} s"
    lines = done.stderr.strip().splitlines()
    return (
        (lines[-1] if lines else f"it died with code {done.returncode}") if done.returncode else ""
    )


VIRTUAL_BOARDS: tuple[Callable[[], FirmwareLibrary], ...] = (
    DrumFirmware,
    TaxelFirmware,
    lambda: EXPERIMENTS[FINGER_EXPERIMENT].load("firmware")(),
)


def check_virtual_boards(
    boards: Iterable[Callable[[], FirmwareLibrary]] = VIRTUAL_BOARDS,
) -> Finding:
    """Load the boards that were compiled for this computer."""
    try:
        for load in boards:
            load().close()
    except RigFault as fault:
        return _refused("virtual boards", fault)
    return Finding("virtual boards", OK, "compiled for this computer")


def check_qt(system: str, environment: Mapping[str, str]) -> Finding:
    """Start Qt in a child, on the display that there is."""
    if system != "linux":
        return Finding("Qt", OK, f"is not tried on {system}, where it brings what it needs")
    has_display = any(environment.get(name) for name in _DISPLAYS)
    child = dict(environment) if has_display else {**environment, "QT_QPA_PLATFORM": "offscreen"}
    failure = child_error(_START_QT, environment=child)
    if failure:
        cure = f"install PySide6-Essentials and, on Debian, {WINDOW_DEBIAN_PACKAGES}"
        return Finding("Qt", ATTENTION, f"Qt does not start ({failure})", cure)
    if has_display:
        return Finding("Qt", OK, "starts on this display")
    cure = "for the window, log in at a desktop or use ssh -X"
    return Finding("Qt", UNKNOWN, "loads, and there is no display here to start on", cure)


def check_fonts(root: Path, home: Path, system: str) -> Finding:
    """Check that a scalable font is installed where fontconfig looks."""
    if system != "linux":
        return Finding("fonts", OK, f"{system} brings its own")
    for place in _FONT_FOLDERS:
        folder = (home if place.startswith(".") else root) / place
        fonts = (font for pattern in _FONTS for font in folder.rglob(pattern))
        if (first := next(fonts, None)) is not None:
            return Finding("fonts", OK, f"in {first.parent}")
    text = "there is none, so the window's labels stay blank"
    return Finding("fonts", ATTENTION, text, "sudo apt install fonts-dejavu-core")


def check_permissions(
    root: Path,
    uid: int,
    groups: Sequence[int],
    may_open: Callable[[Path, int], bool] = os.access,
) -> Finding:
    """Check that the user ``uid``, a member of ``groups``, may open the USB serial ports."""
    user = user_name(root, uid)
    nodes = sorted([*(root / "dev").glob("ttyACM*"), *(root / "dev").glob("ttyUSB*")])
    closed = [node for node in nodes if not may_open(node, os.R_OK | os.W_OK)]
    if closed:
        return _closed_ports(root, user, closed)
    if nodes:
        opened = ", ".join(f"/dev/{node.name}" for node in nodes)
        return Finding(_PERMISSIONS, OK, f"{user} may open {opened}")
    known = read_groups(root)
    group = next((name for name in ("dialout", "uucp") if name in known), "")
    text = "no USB serial port is there"
    if uid == 0 or not group or known[group][0] in groups:
        return Finding(_PERMISSIONS, OK, f"{text}; {user} may open one")
    cure = f"before you plug in a board, sudo usermod -aG {group} {user}; or {_WRITE_RULE}"
    return Finding(_PERMISSIONS, UNKNOWN, f"{text}; {user} is not in group {group}", cure)


def _closed_ports(root: Path, user: str, closed: Sequence[Path]) -> Finding:
    """Return the finding for ports that may not be opened, with the cure for their group."""
    found = closed[0].stat()
    known = read_groups(root)
    group = next((name for name, (gid, _) in known.items() if gid == found.st_gid), "")
    ports = ", ".join(f"/dev/{node.name}" for node in closed)
    text = f"{user} may not open {ports}"
    if not group or found.st_mode & _GROUP_OPENS != _GROUP_OPENS:
        return Finding(_PERMISSIONS, ATTENTION, text, _WRITE_RULE)
    if user in known[group][1]:
        cure = f"log out and in again: only then is {user} in group {group}"
        return Finding(_PERMISSIONS, ATTENTION, text, cure)
    cure = f"sudo usermod -aG {group} {user}, then log out and in again; or {_WRITE_RULE}"
    return Finding(_PERMISSIONS, ATTENTION, f"{text} of group {group}", cure)


def user_name(root: Path, uid: int) -> str:
    """Return the user's name in /etc/passwd; one of a network stands as the shell knows it."""
    for line in (root / "etc/passwd").read_text(errors="replace").splitlines():
        if line.split(":")[2:3] == [str(uid)]:
            return line.partition(":")[0]
    return "$USER"


def read_groups(root: Path) -> dict[str, tuple[int, tuple[str, ...]]]:
    """Return id and members of each group in /etc/group."""
    groups = {}
    for line in (root / "etc/group").read_text(errors="replace").splitlines():
        name, _, rest = line.partition(":")
        gid, _, members = rest.partition(":")[2].partition(":")
        if gid.isdecimal():
            groups[name] = int(gid), tuple(members.split(","))
    return groups


def check_brltty(root: Path) -> Finding:
    """Check that no program for Braille displays takes the port of a CH340."""
    cure = "without a Braille display, sudo apt remove brltty"
    for name, text in udev_rules(root).items():
        lines = (line.lower() for line in text.splitlines() if not line.lstrip().startswith("#"))
        if "brltty" in name and any(all(part in line for part in _CH340) for line in lines):
            cure += f"; with one, sudo ln -s /dev/null /etc/udev/rules.d/{name}"
            sentence = f"its rule {name} takes every CH340, as clones of the boards have"
            return Finding("brltty", ATTENTION, sentence, cure)
    if "brltty" in running_programs(root):
        return Finding("brltty", ATTENTION, "runs, and may take a board's port", cure)
    return Finding("brltty", OK, "takes no board's port")


def check_modem_manager(root: Path) -> Finding:
    """Check that ModemManager does not write to boards that are plugged in."""
    name = "ModemManager"
    if name not in running_programs(root):
        return Finding(name, OK, "does not run")
    if any(
        rule.endswith("rigctl.rules") and "ID_MM_" in text
        for rule, text in udev_rules(root).items()
    ):
        return Finding(name, OK, "runs, and the udev rule keeps it from the boards")
    text = "runs, and asks every new serial port whether it is a modem"
    return Finding(name, ATTENTION, text, _WRITE_RULE)


def udev_rules(root: Path) -> dict[str, str]:
    """Return the text of each udev rule file by its name, of which the first folder's counts."""
    rules: dict[str, str] = {}
    for folder in _RULES:
        for path in (root / folder).glob("*.rules"):
            if path.name not in rules:
                rules[path.name] = path.read_text(errors="replace")
    return rules


def running_programs(root: Path) -> set[str]:
    """Return the names of the running processes, of which Linux keeps 15 letters."""
    names = set()
    for path in (root / "proc").glob("[0-9]*/comm"):
        try:
            names.add(path.read_text(errors="replace").strip())
        except (FileNotFoundError, ProcessLookupError):  # it has just ended
            continue
    return names


def check_clock(root: Path, system: str, now_s: float, jumped_s: float) -> Finding:
    """Check that the clock is kept, has not gone back, and did not jump during the checks."""
    name, cure = "clock", "sudo timedatectl set-ntp true"
    if abs(jumped_s) > JUMP_S:
        text = f"jumped by {jumped_s:+.1f} s while this was running"
        return Finding(name, ATTENTION, text, "record when it has settled")
    if system != "linux":
        return Finding(name, OK, f"{system} keeps it by its own settings, which are not read")
    kept = root / "var/lib/systemd/timesync/clock"
    behind_s = kept.stat().st_mtime - now_s if kept.exists() else 0.0
    if behind_s > CLOCK_TOLERANCE_S:
        text = f"is {behind_s:.0f} s behind the time of its last synchronisation"
        return Finding(name, ATTENTION, text, cure)
    if (root / "run/systemd/timesync/synchronized").exists():
        return Finding(name, OK, "is synchronised")
    programs = running_programs(root)
    if keepers := programs.intersection(_CLOCK_KEEPERS):
        return Finding(name, OK, f"{', '.join(sorted(keepers))} keeps it")
    if _TIMESYNCD in programs:
        text = "systemd-timesyncd runs, and has not reached a time server yet"
        return Finding(name, ATTENTION, text, "look at timedatectl timesync-status")
    text = "nothing synchronises it, and sessions are dated by it"
    return Finding(name, ATTENTION, text, cure)


def jump_s(wall_s: float, monotonic_s: float) -> float:
    """Return by how much the clock has jumped since both times were read."""
    return (time.time() - wall_s) - (time.monotonic() - monotonic_s)


def existing(folder: Path) -> Path:
    """Return the folder, or the nearest one above it that exists."""
    return next(path for path in (folder, *folder.absolute().parents) if path.is_dir())


def check_disk(folder: Path, measure: Callable[[Path], tuple[float, float, int]]) -> Finding:
    """Check room and speed of the disk against what a session of the nominal rig needs.

    ``measure`` is :func:`measure_disk`.
    """
    needed_per_s = recorded_bytes_per_s(RigConfig())
    try:
        per_s, longest_s, free_bytes = measure(folder)
    except OSError as error:
        text = f"{folder} cannot be written ({error.strerror})"
        return Finding("disk", ATTENTION, text, "give the folder of the sessions with --out")
    hours = (free_bytes - RESERVE_BYTES) / needed_per_s / 3600
    text = (
        f"{folder} takes {per_s / 1e6:.1f} MB/s with fsyncs of at most {longest_s * 1000:.0f} ms "
        f"and has room for {max(hours, 0):,.0f} h; a session needs {needed_per_s / 1e6:.3f} MB/s"
    )
    if hours < RECORDING_S / 3600:
        return Finding("disk", ATTENTION, text, "make room, or choose another disk with --out")
    # A trial ends with an fsync; the window says that nothing is recorded after this time.
    if per_s < SPARE * needed_per_s or longest_s > ACTIVE_WINDOW_S:
        return Finding("disk", ATTENTION, f"{text}: too slow", "record on a local disk, with --out")
    return Finding("disk", OK, text)


def measure_disk(folder: Path) -> tuple[float, float, int]:
    """Write and sync a file that vanishes.

    Returns the bytes written a second, the longest fsync, s, and the free bytes.
    """
    block, longest_s, written = os.urandom(1 << 20), 0.0, 0
    began_s = synced_s = time.perf_counter()
    with tempfile.TemporaryFile(dir=folder) as file:
        while written < WRITTEN_BYTES and synced_s - began_s < WRITING_S:
            written += file.write(block)
            file.flush()
            flushed_s = time.perf_counter()
            os.fsync(file.fileno())
            synced_s = time.perf_counter()
            longest_s = max(longest_s, synced_s - flushed_s)
    return written / (synced_s - began_s), longest_s, shutil.disk_usage(folder).free


def check_locks(root: Path, folder: Path, lock: Callable[[Path], str]) -> Finding:
    """Check that the file system has locks; ``lock`` is :func:`locking_error`."""
    failure, kind = lock(folder), file_system(root, folder)
    place = f"{folder} ({kind})" if kind else str(folder)
    if not failure:
        return Finding("file locks", OK, f"{place} has them")
    cure = "record on a local disk, with --out, and copy the session there afterwards"
    text = f"{place} has none ({failure}): sessions there are read, and none is written"
    return Finding("file locks", ATTENTION, text, cure)


def locking_error(folder: Path) -> str:
    """Lock a file that vanishes; return the error, or empty."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            try_lock(file.fileno())
    except OSError as error:
        return str(error.strerror)
    return ""


def file_system(root: Path, folder: Path) -> str:
    """Return the kind of the file system that holds ``folder``, empty where it is not told."""
    mounts = root / "proc/mounts"
    if not mounts.is_file():
        return ""
    best, kind = Path(), ""
    for line in mounts.read_text(errors="replace").splitlines():
        words = line.split(" ")
        if len(words) > 2:
            place = Path(words[1].replace("\\040", " "))
            if folder.absolute().is_relative_to(place) and len(place.parts) >= len(best.parts):
                best, kind = place, words[2]
    return kind


def check_shared_memory(folders: Sequence[Path]) -> Finding:
    """Check that a segment as large as an engine's live data can be made in each folder."""
    for folder in folders:
        try:
            with tempfile.TemporaryFile(dir=folder) as file:
                if hasattr(os, "posix_fallocate"):  # a full memory disk kills who maps it
                    os.posix_fallocate(file.fileno(), 0, SEGMENT_BYTES)
                file.truncate(SEGMENT_BYTES)
                mmap.mmap(file.fileno(), SEGMENT_BYTES).close()
        except OSError as error:
            size = f"{SEGMENT_BYTES >> 20} MiB"
            text = f"{folder} has no {size} for the live data of an engine ({error.strerror})"
            cure = f"make room there, or mount it larger: sudo mount -o remount,size=1G {folder}"
            return Finding("shared memory", ATTENTION, text, cure)
    return Finding("shared memory", OK, f"can be made in {' and '.join(map(str, folders))}")


def find_engines() -> tuple[Path, list[EngineFile]] | Finding:
    """Return the folder of running engines and these, or the finding that it cannot be used."""
    try:
        folder = runtime_folder()
        return folder, running_engines(folder)
    except WrongUse as refusal:
        return _refused("shared memory", refusal)


def engine_logs(folder: Path, running: Iterable[EngineFile]) -> list[Path]:
    """Return the logs of engines that have ended; one that ended well has removed its own."""
    names = {engine.name for engine in running}
    return [path for path in folder.glob(f"*{LOG}") if path.name.removesuffix(LOG) not in names]


def crash_reports_folder() -> Path:
    """Return the folder of the window's crash reports, beside its settings."""
    if sys.platform == "win32":
        folder = platformdirs.user_config_path("rigctl", appauthor=False, roaming=True)
    else:
        folder = Unix("rigctl").user_config_path  # Qt keeps ini files there on macOS, too
    return folder / "crash-reports"


def check_crash(reports: Path, logs: Iterable[Path], now_s: float) -> Finding:
    """Check for a crash of the window (``reports``, a folder) or of an engine (``logs``)."""
    name = "last crash"
    crashed = [log for log in logs if is_crash_report(log)]
    crashed += reports.glob("rigctl-crash-*.txt")
    last = max(crashed, key=lambda path: path.stat().st_mtime, default=None)
    if last is None:
        return Finding(name, OK, "none is recorded")
    age_s = now_s - last.stat().st_mtime
    text = f"{max(age_s, 0) / DAY_S:.1f} days ago, {last}"
    if age_s > RECENT_S:
        return Finding(name, OK, text)
    return Finding(name, ATTENTION, text, "send it to who looks after the program, then delete it")


def check_last_session(folders: Iterable[Path]) -> Finding:
    """Check that the newest session below ``folders`` was closed, or is being written."""
    name = "last session"
    sessions = [path.parent for folder in folders for path in folder.glob(f"*/{LOCK_FILE}")]
    last = max(sessions, key=lambda path: path.stat().st_mtime, default=None)
    if last is None:
        return Finding(name, OK, "none is open")
    writer = writer_of(last)
    if writer is Writer.LIVES:
        return Finding(name, OK, f"{last} is being recorded")
    state = ATTENTION if writer is Writer.GONE else UNKNOWN
    cure = f"rigctl recover {last}, then rigctl run --resume {last} for the missing trials"
    return Finding(name, state, f"{last} was not closed", cure)


def installed_build(board: str) -> str:
    """Return the build hash of this installation's firmware, empty where it carries none."""
    if checkout():
        return image_hash(board)
    try:
        return flash_image(board)[1]
    except WrongUse:
        return ""


def check_board(report: PortReport, build_hash: Callable[[str], str]) -> Finding:
    """Check a board's firmware; ``build_hash`` is :func:`installed_build`."""
    board = report.identity
    if board is None:
        return _check_silent_port(report)
    text = f"{board.board} board, firmware {board.firmware_version}, build {board.build_hash}"
    # The finger's build contains its trained model, so it differs from the sources by right.
    expected = build_hash(board.board) if board.board != "finger" else ""
    if expected and expected != board.build_hash:
        cure = f"rigctl flash {board.board} --port {report.port}"
        return Finding(report.port, ATTENTION, f"{text}; this installation's is {expected}", cure)
    return Finding(report.port, OK, text)


def _check_silent_port(report: PortReport) -> Finding:
    error = report.error
    for board in ("drum", "taxels", "finger"):
        if f"the {board.rstrip('s')} board's firmware" in error:
            cure = f"rigctl flash {board} --port {report.port}"
            return Finding(report.port, ATTENTION, error.rpartition(": ")[0], cure)
    if "no rigctl board" in error:
        cure = "leave it if it is another device; flash a new board: rigctl flash --help"
        return Finding(report.port, UNKNOWN, error, cure)
    return Finding(report.port, ATTENTION, *_split(error))


def _refused(name: str, error: RigctlError) -> Finding:
    return Finding(name, ATTENTION, *_split(str(error)))


def _split(sentence: str) -> tuple[str, str]:
    """Return an error's sentence and its cure, which stands behind the last colon."""
    text, _, cure = sentence.rpartition(": ")
    return (text, cure) if text else (cure, "")
