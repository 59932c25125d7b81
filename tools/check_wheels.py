"""Check wheels as far as any one computer can: contents, processor, symbols and libraries needed.

``python -m tools.check_wheels FOLDER`` prints a line a wheel and exits with 1 where one is wrong.
Where there are Wine and QEMU, the boards of Windows and of Linux on ARM run there for a second, and
must do what those of this computer do. A wheel that passes has still to be run on its own system.
"""

from __future__ import annotations

import ctypes
import io
import os
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import pefile
from elftools.elf.elffile import ELFFile
from macholib.MachO import MachO

ROOT = Path(__file__).resolve().parents[1]
BOARDS = ("drum", "taxels", "finger")
CONTENTS = (
    "rigctl/py.typed",
    "rigctl/_data/protocols/paper.toml",
    "rigctl/_data/protocols/finger/paper.toml",
    "rigctl/_data/arduino/drum/drum.ino",
    "rigctl/_data/arduino/taxels/taxels.ino",
    "rigctl/_data/arduino/finger/finger.ino",
    "rigctl/_data/firmware/drum.hex",
    "rigctl/_data/firmware/taxels.hex",
    "rigctl/_data/wiring/wiring-mega.svg",
    "rigctl/_data/wiring/wiring-uno.svg",
    "rigctl/_data/wiring/wiring-teensy.svg",
    "rigctl/_data/site/docs/README.html",
    "share/applications/rigctl.desktop",
    "share/icons/hicolor/scalable/apps/rigctl.svg",
    "gui/app.py",
)
PROCESSORS = {"x86_64": "x86_64", "aarch64": "aarch64", "amd64": "x86_64", "arm64": "aarch64"}
ELF_MACHINES = {"EM_X86_64": "x86_64", "EM_AARCH64": "aarch64"}
PE_MACHINES = {0x8664: "x86_64", 0xAA64: "aarch64"}
MACH_MACHINES = {0x01000007: "x86_64", 0x0100000C: "aarch64"}
SYSTEM_LIBRARIES = re.compile(
    r"lib(c|m|pthread|dl)\.so\.\d|ld-linux.*|/usr/lib/libSystem\.B\.dylib"
    r"|(?i:kernel32|ntdll|msvcrt|api-ms-win-crt-.*)\.dll"
)


class Emulator(NamedTuple):
    """What runs programs of another system here: Zig's target, the emulator and its options."""

    target: str
    name: str
    options: tuple[str, ...] = ()

    def command(self) -> list[str]:
        """Return the words before a program; empty where the emulator is not installed."""
        program = shutil.which(self.name) or shutil.which(self.name, path="/usr/lib/wine")
        return [program, *self.options] if program else []


EMULATORS = {
    "win_amd64": Emulator("x86_64-windows-gnu", "wine64"),
    "manylinux_2_17_aarch64": Emulator(
        "aarch64-linux-gnu.2.17", "qemu-aarch64", ("-L", "/usr/aarch64-linux-gnu")
    ),
}
"""By the platform of a wheel."""
POLL = bytes.fromhex("0103001000284411")
"""The request with which the engine polls the drum."""
Library = tuple[str, set[str], set[str]]
"""Of a compiled library: its processor, the libraries that it needs, the symbols it exports."""


def complaints(wheel: Path) -> Iterator[str]:
    """Yield a sentence for each thing that is wrong with a wheel."""
    processor = PROCESSORS[next(name for name in PROCESSORS if wheel.stem.endswith(name))]
    with zipfile.ZipFile(wheel) as file:
        names = {re.sub(r"^rigctl-[^/]+\.data/data/", "", name) for name in file.namelist()}
        yield from (f"{name} is missing" for name in CONTENTS if name not in names)
        found = [name for name in names if name.startswith("rigctl/_data/boards/")]
        if len(found) != len(BOARDS):
            yield f"it has the boards {found or 'not at all'}"
        for name in found:
            board = Path(name).stem.removeprefix("virtual-")
            yield from wrong_library(name, processor, exported(board), read(name, file.read(name)))


def wrong_library(name: str, processor: str, symbols: set[str], library: Library) -> Iterator[str]:
    """Yield what is wrong with a library that should export some symbols."""
    machine, needed, exports = library
    if machine != processor:
        yield f"{name} is for {machine}"
    foreign = [each for each in sorted(needed) if not SYSTEM_LIBRARIES.fullmatch(each)]
    if foreign:
        yield f"{name} needs {', '.join(foreign)}"
    if missing := symbols - exports:
        yield f"{name} does not export {', '.join(sorted(missing))}"


def exported(board: str) -> set[str]:
    """Return what a board's library exports on this computer."""
    found = list((ROOT / "build" / "host").glob(f"virtual-{board}.so"))
    return {
        name for name in read(found[0].name, found[0].read_bytes())[2] if name.startswith(board)
    }


def read(name: str, content: bytes) -> Library:
    """Read a compiled library of any of the systems."""
    readers = {".so": read_elf, ".dll": read_pe, ".dylib": read_mach}
    return readers[Path(name).suffix](content)


def read_elf(content: bytes) -> Library:
    """Read a library of Linux."""
    elf = ELFFile(io.BytesIO(content))
    needed = {tag.needed for tag in elf.get_section_by_name(".dynamic").iter_tags("DT_NEEDED")}
    symbols = elf.get_section_by_name(".dynsym").iter_symbols()
    exports = {each.name for each in symbols if each["st_shndx"] != "SHN_UNDEF"}
    return ELF_MACHINES[elf["e_machine"]], needed, exports


def read_pe(content: bytes) -> Library:
    """Read a library of Windows."""
    pe = pefile.PE(data=content)
    needed = {entry.dll.decode() for entry in pe.DIRECTORY_ENTRY_IMPORT}
    exports = {symbol.name.decode() for symbol in pe.DIRECTORY_ENTRY_EXPORT.symbols}
    return PE_MACHINES[pe.FILE_HEADER.Machine], needed, exports


def read_mach(content: bytes) -> Library:
    """Read a library of macOS."""
    from macholib.SymbolTable import SymbolTable

    path = ROOT / "build" / "wheels" / "checked.dylib"  # macholib reads files only
    path.write_bytes(content)
    mach = MachO(str(path))
    header = mach.headers[0]
    needed = {data.rstrip(b"\0").decode() for load, _, data in header.commands if load.cmd == 0xC}
    exports = {name.decode().removeprefix("_") for _, name in SymbolTable(mach).extdefsyms}
    path.unlink()
    return MACH_MACHINES[header.header.cputype], needed, exports


def differing_boards(wheel: Path, emulator: Emulator) -> Iterator[str]:
    """Yield a sentence for each board of a wheel that does something else when emulated."""
    with TemporaryDirectory() as name, zipfile.ZipFile(wheel) as file:
        program = Path(name) / "run_board.exe"
        source = ROOT / "tools" / "run_board.c"
        compiler = [sys.executable, "-m", "ziglang", "cc", "-target", emulator.target]
        subprocess.run([*compiler, str(source), "-o", str(program)], check=True)
        environment = os.environ | {"WINEPREFIX": f"{name}/wine", "WINEDEBUG": "-all"}
        for place in (one for one in file.namelist() if one.startswith("rigctl/_data/boards/")):
            library = Path(name) / Path(place).name
            library.write_bytes(file.read(place))
            board = library.stem.removeprefix("virtual-")
            command = [*emulator.command(), str(program), f"./{library.name}", board, POLL.hex()]
            ran = subprocess.run(command, cwd=name, env=environment, capture_output=True)
            if ran.returncode or ran.stdout != run_here(board):
                yield f"{library.name} ends with {ran.returncode} and differs from this computer's"


def run_here(board: str) -> bytes:
    """Do with this computer's board what run_board.c does, and return its inputs and outputs."""
    library = ctypes.CDLL(str(ROOT / "build" / "host" / f"virtual-{board}.so"))
    call = {name: getattr(library, f"{board}_{name}") for name in ("open", "io", "boot", "run")}
    call["open"].restype = call["io"].restype = ctypes.c_void_p
    handle = ctypes.c_void_p(call["open"]())
    content = call["io"](handle)
    call["boot"](handle, 1)
    readings = (ctypes.c_uint16 * 1800)(*(i * 7 % 1024 for i in range(1800)))
    if board == "drum":
        half, end = ctypes.c_int64(8_000_000), ctypes.c_int64(16_000_000)
        call["run"](handle, half)
        library.drum_receive(handle, POLL, len(POLL), half)
        call["run"](handle, end)
    else:
        call["run"](handle, *{"taxels": (readings, 100), "finger": (1000,)}[board])
    return ctypes.string_at(content, getattr(library, f"{board}_io_size")())


def main(folder: str) -> int:
    """Check the wheels of a folder and return an exit code."""
    wheels = sorted(Path(folder).glob("*.whl"))
    found = {wheel: list(complaints(wheel)) for wheel in wheels}
    for wheel in wheels:
        emulator = EMULATORS.get(wheel.stem.split("-")[-1])
        if emulator is not None and emulator.command():
            found[wheel] += differing_boards(wheel, emulator)
            print(f"{wheel.name}: its boards have run under {emulator.name}")
        elif emulator is not None:
            print(f"{wheel.name}: its boards have NOT run: {emulator.name} is not installed")
    for wheel, wrong in found.items():
        print(f"{wheel.name}  {wheel.stat().st_size / 1e6:.1f} MB  {'; '.join(wrong) or 'right'}")
    return 1 if not wheels or any(found.values()) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
