"""The boards' firmware compiled for this computer: loading, and independence of boards."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rigctl import host_build
from rigctl.bench.bench import Bench
from rigctl.bench.boards.drum_cosimulation import DrumCosimulation
from rigctl.bench.boards.drum_firmware import DrumFirmware
from rigctl.bench.boards.taxels import TaxelFirmware
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.virtual_rig import open_virtual_rig
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import State
from rigctl.config.resources import checkout
from rigctl.errors import RigFault

ROOT = checkout()
assert ROOT is not None
COMPILER_SOURCES = (
    r"install a C\+\+ compiler \(g\+\+ or clang\+\+\) or `pip install ziglang`, then run python"
)


def one_sentence(error: pytest.ExceptionInfo[BaseException]) -> bool:
    return "\n" not in str(error.value)


@pytest.mark.parametrize("board", [DrumFirmware, TaxelFirmware])
def test_a_missing_library_names_both_sources_of_a_compiler(
    tmp_path: Path, board: type[DrumFirmware | TaxelFirmware]
) -> None:
    with pytest.raises(
        RigFault, match=rf"none\.so: .*is not compiled: {COMPILER_SOURCES}"
    ) as error:
        board(tmp_path / "none.so")
    assert one_sentence(error)


def test_a_library_for_another_system_is_refused_by_name(tmp_path: Path) -> None:
    foreign = tmp_path / "virtual-drum.so"
    foreign.write_bytes(b"\x7fELF of another machine")
    with pytest.raises(RigFault, match=r"virtual-drum\.so: .*not made for this system") as error:
        DrumFirmware(foreign)
    assert one_sentence(error)
    other = host_build.dynamic_library_path("taxels")
    with pytest.raises(RigFault, match=r"virtual-taxels.*not made for this system"):
        DrumFirmware(other)


def test_a_stale_library_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stale = tmp_path / "virtual-drum.so"
    made_of = host_build.digest("drum")
    content = host_build.dynamic_library_path("drum").read_bytes()
    stale.write_bytes(content.replace(made_of.encode(), b"0" * len(made_of)))
    with pytest.raises(
        RigFault, match=r"virtual-drum\.so: .*other sources than arduino/ holds"
    ) as error:
        DrumFirmware(stale)
    assert one_sentence(error)


def test_without_a_compiler_the_build_names_both_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setattr(host_build.shutil, "which", lambda name: None)
    monkeypatch.setattr(host_build.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(host_build.BuildFailed, match=f"no C\\+\\+ compiler.*{COMPILER_SOURCES}"):
        host_build.compiler()
    monkeypatch.setattr(host_build.importlib.util, "find_spec", lambda name: object())
    assert host_build.compiler() == [sys.executable, "-m", "ziglang", "c++"]


def test_a_compile_error_shows_the_compilers_message(tmp_path: Path) -> None:
    with pytest.raises(host_build.BuildFailed, match="could not compile the drum board"):
        host_build.build("drum", tmp_path / "broken.so", ["UNIT_TEST_OF=(", "State=42"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("board", ["drum", "taxels"])
def test_virtual_boards_and_chips_are_the_same_firmware(board: str) -> None:
    """Both contain the hash of the same sources, as computed by the images' Makefile."""
    output = subprocess.run(
        ["make", "-s", "-n", "-W", f"{board}/board.h", "-C", ROOT / "arduino", board],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert f"-DBUILD_HASH=0x{host_build.image_hash(board)}UL" in output


def test_several_boards_in_one_process_share_nothing() -> None:
    rigs = [DrumCosimulation(Bench(WorldParameters(), seed)) for seed in (1, 2)]
    for drum in rigs:
        drum.firmware.io.heartbeat_on = 1
        drum.run(400)
    command = BY_NAME["command"].address
    assert rigs[0].firmware.write(command, [Command.ARM, 1]) == 0
    for drum in rigs:
        drum.run(1000)
    states = [State(drum.firmware.io.state) for drum in rigs]
    assert states == [State.RETRACT, State.IDLE]
    alone = DrumCosimulation(Bench(WorldParameters(), 2))
    alone.firmware.io.heartbeat_on = 1
    for until_ms in (400, 1000):
        alone.run(until_ms)
    assert alone.firmware.read(16, 40) == rigs[1].firmware.read(16, 40)
    for drum in (*rigs, alone):
        drum.firmware.close()


def test_a_closed_rig_can_be_closed_again() -> None:
    rig = open_virtual_rig()
    rig.close()
    rig.close()
    rig.advance(1_000_000)
    assert rig.time_us == 1_000_000
