"""``rigctl doctor`` names each fault of a computer and its cure.

A fault of the system is a file in a folder that stands for ``/``; one of the hardware is given as
the fact that was measured.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Sequence
from importlib.metadata import requires
from pathlib import Path

import pytest

from rigctl.bench.boards.drum_firmware import DrumFirmware
from rigctl.boards.port_discovery import PortReport
from rigctl.cli import doctor, main
from rigctl.cli.doctor import ATTENTION, OK, UNKNOWN, Finding
from rigctl.config.rig_config import RigConfig
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import LOG
from rigctl.host_build import image_hash
from rigctl.protocol.plan import recorded_bytes_per_s
from rigctl.session.writer_lock import LOCK_FILE, WriterLock
from rigctl.values import BoardIdentity

NOW_S = 1_800_000_000.0
DAY_S = 86_400.0
NEEDED = doctor.needed_packages(
    [
        "numpy>=2.1",
        "pymodbus>=3.15,!=3.16.0,<3.17",
        "PySide6-Essentials>=6.8.3,<6.12; python_version < '3.0'",
        "openvr>=2.5; extra == 'vive'",
    ]
)


def put(root: Path, files: dict[str, str]) -> Path:
    """Write files below ``root`` and return it."""
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def closed(path: Path, mode: int) -> bool:
    return False


class TestProgram:
    def test_a_python_that_is_too_old_is_named(self) -> None:
        found = doctor.check_python((3, 10, 2), "cpython", ">=3.11", "", "")
        assert found.state is ATTENTION
        assert "3.10.2 is not >=3.11" in found.sentence and "newer Python" in found.cure

    @pytest.mark.parametrize(
        ("version", "pyside", "state"),
        [
            ((3, 11, 9), "6.12.0", ATTENTION),
            ((3, 11, 9), "6.12.1", ATTENTION),
            ((3, 11, 9), "6.11.3", OK),
            ((3, 12, 1), "6.12.0", OK),
            ((3, 11, 9), "", OK),
        ],
    )
    def test_the_pyside_that_crashes_on_this_python_is_named(
        self, version: Sequence[int], pyside: str, state: doctor.State
    ) -> None:
        found = doctor.check_python(version, "cpython", ">=3.11", pyside, "/lab/.venv")
        assert found.state is state
        if state is ATTENTION:
            assert found.cure == "pip install 'PySide6-Essentials<6.12'"
        else:
            assert found.sentence.endswith("in the virtual environment /lab/.venv")

    def test_packages_are_those_that_this_python_needs(self) -> None:
        assert list(NEEDED) == ["numpy", "pymodbus"]

    def test_a_checkout_that_was_updated_since_its_installation_says_what_it_needs(
        self, tmp_path: Path
    ) -> None:
        project = '[project]\nrequires-python = ">=3.12"\ndependencies = ["newcomer>=2"]\n'
        required, lines = doctor.requirements(put(tmp_path, {"pyproject.toml": project}))
        assert (required, lines) == (">=3.12", ["newcomer>=2"])
        versions = doctor.installed_versions(["newcomer", "numpy"])
        assert list(versions) == ["numpy"]
        found = doctor.check_packages(doctor.needed_packages(lines), versions, "")
        assert found.state is ATTENTION and found.sentence == "newcomer is missing"
        assert doctor.requirements(None)[0] == ">=3.11"

    def test_packages_are_listed_or_named_with_what_is_wrong(self) -> None:
        found = doctor.check_packages(NEEDED, {"numpy": "2.4.6", "pymodbus": "3.16.1"}, "")
        assert found == Finding("packages", OK, "numpy 2.4.6, pymodbus 3.16.1")
        found = doctor.check_packages(NEEDED, {"pymodbus": "3.16.0"}, "")
        assert "numpy is missing; pymodbus 3.16.0 is not " in found.sentence
        assert found.state is ATTENTION and "requirements.lock" in found.cure

    def test_all_that_rigctl_needs_is_imported_here(self) -> None:
        assert doctor.import_error(doctor.needed_packages(requires("rigctl") or ())) == ""

    def test_a_package_that_cannot_be_imported_is_named_with_its_error(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        put(tmp_path, {"torn.py": "raise OSError('libtorn.so: wrong ELF class')"})
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        failure = doctor.import_error(["msgspec", "torn"])
        assert failure == "torn: libtorn.so: wrong ELF class"
        found = doctor.check_packages(NEEDED, {"numpy": "2.4.6", "pymodbus": "3.16.1"}, failure)
        assert found.state is ATTENTION and failure in found.sentence

    def test_a_package_that_kills_python_does_not_kill_the_doctor(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        put(tmp_path, {"deadly.py": "import os\nos.abort()"})
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        assert doctor.import_error(["deadly"]) == f"it died with code -{signal.SIGABRT.value}"

    def test_virtual_boards_load_or_are_not_compiled(self, tmp_path: Path) -> None:
        assert doctor.check_virtual_boards().state is OK
        found = doctor.check_virtual_boards([lambda: DrumFirmware(tmp_path / "none.so")])
        assert found.state is ATTENTION and "is not compiled" in found.sentence
        assert "g++" in found.cure and "python -m rigctl.host_build" in found.cure

    @pytest.mark.parametrize(
        ("platform", "state", "words"),
        [
            ("nowhere", ATTENTION, ["Qt does not start", "nowhere", "libxcb-cursor0"]),
            ("offscreen", OK, ["starts on this display"]),
            ("", UNKNOWN, ["ssh -X"]),
        ],
    )
    def test_qt_is_started_on_the_display_that_there_is(
        self, platform: str, state: doctor.State, words: list[str]
    ) -> None:
        names = ("DISPLAY", "WAYLAND_DISPLAY")
        without = {name: text for name, text in os.environ.items() if name not in names}
        found = doctor.check_qt("linux", {**without, "QT_QPA_PLATFORM": platform})
        assert found.state is state
        assert all(word in f"{found.sentence} {found.cure}" for word in words)

    def test_a_computer_without_a_font_is_named(self, tmp_path: Path) -> None:
        put(tmp_path, {"usr/share/fonts/misc/fixed.pcf.gz": ""})
        found = doctor.check_fonts(tmp_path, tmp_path / "home", "linux")
        assert (found.state, found.cure) == (ATTENTION, "sudo apt install fonts-dejavu-core")
        put(tmp_path, {"home/.local/share/fonts/own/Own.otf": ""})
        assert doctor.check_fonts(tmp_path, tmp_path / "home", "linux").state is OK


class TestPorts:
    @pytest.fixture
    def root(self, tmp_path: Path) -> Path:
        users = "root:x:0:0::/root:/bin/sh\nada:x:1000:1000:Ada:/home/ada:/bin/sh\n"
        return put(tmp_path, {"etc/passwd": users})

    def plug(self, root: Path, members: str = "bob", mode: int = 0o660) -> None:
        (put(root, {"dev/ttyACM0": ""}) / "dev/ttyACM0").chmod(mode)
        put(root, {"etc/group": f"broken\ndialout:x:{os.getgid()}:{members}\n"})

    def test_a_port_that_opens_is_fine(self, root: Path) -> None:
        self.plug(root)
        found = doctor.check_permissions(root, 1000, [1000])
        assert found == Finding("port permissions", OK, "ada may open /dev/ttyACM0")

    @pytest.mark.parametrize(
        ("members", "mode", "cure"),
        [
            ("bob", 0o660, "sudo usermod -aG dialout ada, then log out and in again; or "),
            ("bob,ada", 0o660, "log out and in again: only then is ada in group dialout"),
            ("bob", 0o600, "rigctl doctor --write-udev-rule"),
        ],
        ids=["outside the group", "joined since the login", "closed to the group"],
    )
    def test_a_port_that_does_not_open_has_a_cure(
        self, root: Path, members: str, mode: int, cure: str
    ) -> None:
        self.plug(root, members, mode)
        found = doctor.check_permissions(root, 1000, [1000], closed)
        assert found.state is ATTENTION
        assert found.sentence.startswith("ada may not open /dev/ttyACM0")
        assert found.cure.startswith(cure)

    def test_before_the_first_board_the_missing_group_is_told(self, root: Path) -> None:
        put(root, {"etc/group": "dialout:x:20:bob\n"})
        found = doctor.check_permissions(root, 1000, [1000])
        assert found.state is UNKNOWN and "sudo usermod -aG dialout ada" in found.cure
        assert doctor.check_permissions(root, 1000, [1000, 20]).state is OK
        put(root, {"etc/group": "uucp:x:14:\n"})
        assert "-aG uucp ada" in doctor.check_permissions(root, 1000, [1000]).cure

    def test_a_user_of_the_network_is_named_as_the_shell_does(self, root: Path) -> None:
        assert doctor.user_name(root, 77_000) == "$USER"

    @pytest.mark.parametrize("folder", ["usr/lib/udev/rules.d", "lib/udev/rules.d"])
    def test_the_rule_of_brltty_that_takes_a_ch340_is_named(self, root: Path, folder: str) -> None:
        name, rule = (
            "85-brltty.rules",
            'ENV{PRODUCT}=="1A86/7523/*", ENV{BRLTTY_BRAILLE_DRIVER}="bm"',
        )
        put(root, {f"{folder}/{name}": f"# a comment\n{rule}\n"})
        found = doctor.check_brltty(root)
        assert found.state is ATTENTION and name in found.sentence
        assert "apt remove brltty" in found.cure and f"/etc/udev/rules.d/{name}" in found.cure
        (root / "etc/udev/rules.d").mkdir(parents=True)
        (root / "etc/udev/rules.d" / name).symlink_to("/dev/null")  # the second cure
        assert doctor.check_brltty(root).state is OK
        put(root, {f"{folder}/90-brltty-new.rules": f"#{rule}\n"})
        assert doctor.check_brltty(root).state is OK, "Debian's newer rule is a comment"

    def test_a_brltty_that_runs_is_named(self, root: Path) -> None:
        put(root, {"proc/812/comm": "brltty\n"})
        assert doctor.check_brltty(root).state is ATTENTION

    def test_modem_manager_is_named_until_the_rule_is_installed(self, root: Path) -> None:
        assert doctor.check_modem_manager(root).sentence == "does not run"
        put(root, {"proc/701/comm": "ModemManager\n", "proc/self/comm": "x\n"})
        found = doctor.check_modem_manager(root)
        assert found.state is ATTENTION and "--write-udev-rule" in found.cure
        rule = root / "60-rigctl.rules"
        said = doctor.write_udev_rule(rule)
        assert f"sudo cp {rule} /etc/udev/rules.d/60-rigctl.rules" in said
        put(root, {"etc/udev/rules.d/60-rigctl.rules": rule.read_text()})
        assert doctor.check_modem_manager(root).state is OK

    def test_the_rule_is_written_to_a_new_file_only(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        rule = tmp_path / "60-rigctl.rules"
        assert main(["doctor", "--write-udev-rule", str(rule)]) == 0
        assert "udevadm control --reload" in capsys.readouterr().out
        text = rule.read_text()
        assert all(f'ID_MM_{part}_IGNORE}}="1"' in text for part in ("DEVICE", "PORT"))
        assert 'SUBSYSTEM=="tty", TAG+="uaccess"' in text
        for path in (rule, tmp_path / "none/60-rigctl.rules", tmp_path):
            assert main(["doctor", "--write-udev-rule", str(path)]) == 2
            assert "cannot be written" in capsys.readouterr().err
        assert rule.read_text() == text


class TestClock:
    @pytest.mark.parametrize(
        ("files", "state", "words"),
        [
            ({"run/systemd/timesync/synchronized": ""}, OK, "is synchronised"),
            ({}, ATTENTION, "sudo timedatectl set-ntp true"),
            ({"proc/300/comm": "systemd-timesyn\n"}, ATTENTION, "timesync-status"),
            ({"proc/300/comm": "chronyd\n"}, OK, "chronyd keeps it"),
        ],
    )
    def test_who_keeps_the_clock_is_told(
        self, tmp_path: Path, files: dict[str, str], state: doctor.State, words: str
    ) -> None:
        found = doctor.check_clock(put(tmp_path, files), "linux", NOW_S, 0.0)
        assert found.state is state and words in f"{found.sentence} {found.cure}"

    def test_a_clock_that_went_back_is_named(self, tmp_path: Path) -> None:
        name = "var/lib/systemd/timesync/clock"
        put(tmp_path, {name: "", "run/systemd/timesync/synchronized": ""})
        os.utime(tmp_path / name, (NOW_S + DAY_S, NOW_S + DAY_S))
        found = doctor.check_clock(tmp_path, "linux", NOW_S, 0.0)
        assert found.state is ATTENTION and "86400 s behind" in found.sentence
        assert doctor.check_clock(tmp_path, "linux", NOW_S + 2 * DAY_S, 0.0).state is OK

    @pytest.mark.parametrize("jumped_s", [3.2, -3.2])
    def test_a_clock_that_jumps_is_named_on_every_system(
        self, tmp_path: Path, jumped_s: float
    ) -> None:
        put(tmp_path, {"run/systemd/timesync/synchronized": ""})
        for system in ("linux", "win32", "darwin"):
            found = doctor.check_clock(tmp_path, system, NOW_S, jumped_s)
            assert found.state is ATTENTION and f"{jumped_s:+.1f} s" in found.sentence


class TestDisk:
    NEEDED_PER_S = recorded_bytes_per_s(RigConfig())

    @pytest.mark.parametrize(
        ("per_s", "longest_s", "free_bytes", "state", "words"),
        [
            (11.0 * NEEDED_PER_S, 0.9, 2 * 10**9, OK, "has room for"),
            (9.0 * NEEDED_PER_S, 0.01, 2 * 10**9, ATTENTION, "too slow: record on a local disk"),
            (1e9, 1.1, 2 * 10**9, ATTENTION, "too slow: record on a local disk"),
            (1e9, 0.001, 10**9, ATTENTION, "has room for 5 h"),
        ],
    )
    def test_a_disk_is_judged_by_what_a_session_needs(
        self,
        tmp_path: Path,
        per_s: float,
        longest_s: float,
        free_bytes: int,
        state: doctor.State,
        words: str,
    ) -> None:
        assert 18 * 2 * 1000 < self.NEEDED_PER_S < 100_000
        found = doctor.check_disk(tmp_path, lambda _: (per_s, longest_s, free_bytes))
        assert found.state is state and words in f"{found.sentence}: {found.cure}"

    def test_the_speed_is_measured_and_nothing_stays(self, tmp_path: Path) -> None:
        per_s, longest_s, free_bytes = doctor.measure_disk(tmp_path)
        assert per_s > 0 and longest_s > 0 and free_bytes > 0
        assert list(tmp_path.iterdir()) == []

    def test_a_folder_that_cannot_be_written_is_named(self) -> None:
        found = doctor.check_disk(Path("/proc"), doctor.measure_disk)
        assert found.state is ATTENTION and "--out" in found.cure

    def test_a_file_system_without_locks_is_named(self, tmp_path: Path) -> None:
        mounts = "disk / ext4 rw 0 0\nhost:/e /lab\\040data nfs4 rw 0 0\nshm /dev/shm tmpfs rw\n"
        put(tmp_path, {"proc/mounts": mounts})
        folder = Path("/lab data/sessions")
        found = doctor.check_locks(tmp_path, folder, lambda _: "No locks available")
        assert found.state is ATTENTION
        assert "/lab data/sessions (nfs4) has none (No locks available)" in found.sentence
        assert "copy the session there afterwards" in found.cure
        assert (
            doctor.check_locks(tmp_path, Path("/home/x"), lambda _: "").sentence
            == "/home/x (ext4) has them"
        )
        assert doctor.locking_error(tmp_path) == ""

    def test_shared_memory_that_is_missing_or_too_small_is_named(self, tmp_path: Path) -> None:
        assert doctor.check_shared_memory([tmp_path]).state is OK
        found = doctor.check_shared_memory([tmp_path, tmp_path / "dev/shm"])
        assert found.state is ATTENTION and "dev/shm has no 16 MiB" in found.sentence
        assert f"size=1G {tmp_path}/dev/shm" in found.cure

    def test_a_runtime_folder_that_is_open_to_others_is_named(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("RIGCTL_RUNTIME", str(tmp_path))
        (tmp_path / f"rigctl-{os.getuid()}").mkdir(mode=0o755)
        found = doctor.find_engines()
        assert isinstance(found, Finding) and found.state is ATTENTION
        assert "is open to other users" in found.sentence and "chmod 700" in found.cure


class TestCrashes:
    def test_the_newest_crash_is_named_for_a_week(self, tmp_path: Path) -> None:
        old, new, quiet = (tmp_path / name for name in ("rigctl-crash-1.txt", "e1.log", "e2.log"))
        old.write_text("report")
        new.write_text("Traceback (most recent call last):\n")
        quiet.write_text("rigctl: the port vanished\n")
        os.utime(old, (NOW_S - 9 * DAY_S,) * 2)
        os.utime(new, (NOW_S - 2 * DAY_S,) * 2)
        found = doctor.check_crash(tmp_path, [new, quiet], NOW_S)
        assert found.state is ATTENTION and found.sentence == f"2.0 days ago, {new}"
        assert "delete it" in found.cure
        assert doctor.check_crash(tmp_path, [quiet], NOW_S).state is OK
        assert doctor.check_crash(tmp_path, [], NOW_S - 8 * DAY_S).state is ATTENTION
        none = doctor.check_crash(tmp_path / "none", [quiet], NOW_S)
        assert none.sentence == "none is recorded"

    @pytest.mark.skipif(sys.platform == "win32", reason="signals")
    def test_an_engine_that_native_code_killed_has_left_its_log(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("RIGCTL_RUNTIME", str(tmp_path))
        found = doctor.find_engines()
        assert not isinstance(found, Finding)
        folder = found[0]
        client = EngineClient.start("virtual", paced=False, seed=1)
        engine, process = client.engine_file, client.process
        assert process is not None
        assert doctor.engine_logs(folder, [engine]) == []
        process.send_signal(signal.SIGSEGV)
        process.wait()
        client.close()
        (left,) = doctor.engine_logs(folder, [])
        assert left.name == f"{engine.name}{LOG}"
        crash = doctor.check_crash(tmp_path, [left], left.stat().st_mtime)
        assert crash.state is ATTENTION and str(left) in crash.sentence

    def test_the_reports_of_the_window_are_looked_for_where_it_writes_them(self) -> None:
        from gui.shell.help_page import REPORTS
        from gui.shell.user_settings import UserSettings

        folder = UserSettings.of_user().folder / REPORTS
        assert doctor.crash_reports_folder() == folder

    def test_a_session_that_was_not_closed_is_named(self, tmp_path: Path) -> None:
        assert doctor.check_last_session([tmp_path, tmp_path / "none"]).state is OK
        session = tmp_path / "monday"
        session.mkdir()
        lock = WriterLock(session)
        assert "is being recorded" in doctor.check_last_session([tmp_path]).sentence
        text = (session / LOCK_FILE).read_text()
        lock.release()
        (session / LOCK_FILE).write_text(text.replace(str(os.getpid()), str(2**22 + 1)))
        found = doctor.check_last_session([tmp_path])
        assert found.state is ATTENTION and found.sentence == f"{session} was not closed"
        assert f"rigctl recover {session}" in found.cure
        (session / LOCK_FILE).write_text("77\nelsewhere\n")
        assert doctor.check_last_session([tmp_path]).state is UNKNOWN


class TestBoards:
    def board(self, kind: str, build_hash: str) -> PortReport:
        identity = BoardIdentity(
            board=kind,
            firmware_version="0.4",
            build_hash=build_hash,
            wire_version=4,
            boot_count=1,
            reset_cause=1,
            details={},
        )
        return PortReport("/dev/ttyACM0", "Arduino Mega", identity)

    def test_another_build_is_named_with_the_line_that_flashes_it(self) -> None:
        own, build = image_hash("drum"), doctor.installed_build
        found = doctor.check_board(self.board("drum", own), build)
        assert found.state is OK and own in found.sentence
        found = doctor.check_board(self.board("taxels", "00c0ffee"), build)
        assert found.state is ATTENTION and image_hash("taxels") in found.sentence
        assert found.cure == "rigctl flash taxels --port /dev/ttyACM0"
        assert doctor.check_board(self.board("taxels", "00c0ffee"), lambda _: "").state is OK
        # The finger's build differs by its model.
        assert doctor.check_board(self.board("finger", "00c0ffee"), build).state is OK

    @pytest.mark.parametrize(
        ("error", "state", "cure"),
        [
            (
                "the drum board's firmware 0.3 speaks register map 3, this program map 4: "
                "to give it this installation's firmware, `rigctl flash drum`",
                ATTENTION,
                "rigctl flash drum --port COM4",
            ),
            (
                "the finger board's firmware 0.1 speaks wire version 1 with 12 taxels in batches "
                "of 8, this program version 2 with 9 in batches of 8: "
                "to give it this installation's firmware, `rigctl flash finger`",
                ATTENTION,
                "rigctl flash finger --port COM4",
            ),
            ("no rigctl board answered", UNKNOWN, "rigctl flash --help"),
            ("the port is in use: close the program that holds it", ATTENTION, "close the program"),
        ],
    )
    def test_a_port_without_its_board_is_told(
        self, error: str, state: doctor.State, cure: str
    ) -> None:
        found = doctor.check_board(PortReport("COM4", "", error=error), doctor.installed_build)
        assert found.state is state and cure in found.cure
        assert "this program" not in found.cure

    def test_boards_that_an_engine_uses_are_left_alone(self) -> None:
        engine = doctor.EngineFile("e1", 4711, 0, "", "/lab/rig.toml", "")
        (found,) = doctor.examine_boards([engine], _no_ports)
        assert (
            found.state is UNKNOWN
            and "4711" in found.sentence
            and "/lab/rig.toml" in found.sentence
        )


FINE = Finding("clock", OK, "is synchronised")
MAYBE = Finding("Qt", UNKNOWN, "loads", "log in")
WRONG = Finding("fonts", ATTENTION, "there is none", "sudo apt install fonts-dejavu-core")


@pytest.mark.parametrize(("found", "code"), [([FINE, MAYBE], 0), ([FINE, WRONG, MAYBE], 1)])
def test_json_holds_what_the_lines_say(
    found: list[Finding], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert doctor.print_findings(iter(found), as_json=False) == code
    lines = capsys.readouterr().out.splitlines()
    assert doctor.print_findings(iter(found), as_json=True) == code
    told = json.loads(capsys.readouterr().out)
    assert told["ok"] is (code == 0)
    assert len(lines) == len(told["findings"]) == len(found)
    for line, one in zip(lines, told["findings"], strict=True):
        cure = f": {one['cure']}" if one["cure"] else ""
        assert line == f"{one['state']:<9}  {one['name']}: {one['sentence']}{cure}"


@pytest.mark.parametrize("system", ["win32", "darwin"])
def test_what_does_not_apply_to_a_system_is_said_in_a_line(tmp_path: Path, system: str) -> None:
    found = [
        *doctor.examine_system(tmp_path, system),
        doctor.check_fonts(tmp_path, tmp_path, system),
        doctor.check_qt(system, {}),
        doctor.check_clock(tmp_path, system, NOW_S, 0.0),
    ]
    assert all(one.state is OK and system in one.sentence for one in found)


def test_what_cannot_be_read_is_unknown_and_no_traceback(tmp_path: Path) -> None:
    """A folder stands where each file is expected: reading it fails for every user."""
    for name in (
        "etc/passwd",
        "etc/group",
        "proc/1/comm",
        "proc/mounts/x",
        "etc/udev/rules.d/85-brltty.rules",
    ):
        (tmp_path / name).mkdir(parents=True)
    found = list(doctor.examine_system(tmp_path, "linux"))
    assert [one.name for one in found] == ["port permissions", "brltty", "ModemManager"]
    assert all(one.state is UNKNOWN and "cannot be checked" in one.sentence for one in found)
    clock = doctor.tried("clock", lambda: doctor.check_clock(tmp_path, "linux", NOW_S, 0.0))
    assert clock.state is UNKNOWN
    assert doctor.file_system(tmp_path, tmp_path) == ""


def test_a_real_computer_is_examined_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    found = doctor.examine(tmp_path / "new/sessions", probe=_no_ports)
    code = doctor.print_findings(found, as_json=True)
    told = json.loads(capsys.readouterr().out)
    states = {one["name"]: one["state"] for one in told["findings"]}
    assert code == int("attention" in states.values())
    assert list(states) == [
        "Python",
        "packages",
        "plug-in",
        "virtual boards",
        "Qt",
        "fonts",
        "port permissions",
        "brltty",
        "ModemManager",
        "disk",
        "file locks",
        "shared memory",
        "last crash",
        "last session",
        "clock",
        "boards",
    ]
    assert list(tmp_path.iterdir()) == []


async def _no_ports(loop: object) -> list[PortReport]:
    """Answer as on a computer without serial ports: this one's may belong to others."""
    return []
