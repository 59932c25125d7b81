"""What an image takes of its chip's flash, RAM and stack; exit code 1 above three quarters.

    python3 budgets.py taxels IMAGE

Flash and RAM are the image's sections. The stack is the worst case that the machine code
allows: the deepest chain of calls from ``main``, and below it the deepest interrupt routine
(all of them, where one lets others in). Calls through a pointer count as the deepest function
that nothing calls by name. Only the standard library and avr-binutils are needed.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

LIMIT = 0.75
CODE_BEGINS = "__bad_interrupt"  # in front of it: vectors, constants, the start of the C runtime
VECTOR = re.compile(r"__vector_\d+")
LEAVES = ("ret", "reti", "jmp", "rjmp", "ijmp", "eijmp")
FUNCTION = re.compile(r"^[0-9a-f]+ <(.+)>:$")
INSTRUCTION = re.compile(r"^ +[0-9a-f]+:\t[0-9a-f ]+\t(\w+)\t?([^;]*)(?:;.*<([^>+]+)(\+0x\w+)?>)?")


class Chip(NamedTuple):
    """What a board has: flash without its bootloader, RAM, and a return address, bytes."""

    flash: int
    ram: int
    return_address: int


CHIPS = {"drum": Chip(262144 - 8192, 8192, 3), "taxels": Chip(32768 - 512, 2048, 2)}


class Use(NamedTuple):
    """Bytes taken, and bytes there are."""

    taken: int
    room: int

    @property
    def share(self) -> float:
        """Taken of what there is."""
        return self.taken / self.room


@dataclass
class Function:
    """Frame size of a function, and its calls: names with the bytes of the return address."""

    frame: int = 0
    goes_to: list[tuple[str, int]] = field(default_factory=list)
    calls_pointers: bool = False
    lets_interrupts_in: bool = False


class RecursionFound(Exception):
    """A function that may call itself has no worst case."""


def main(board: str, image: str) -> int:
    """Print one line for an image; 1 where a budget is broken."""
    try:
        uses = budgets(board, image)
    except RecursionFound as found:
        print(f"{image}: no bound of the stack, recursion: {found}", file=sys.stderr)
        return 1
    texts = [
        f"{name} {use.taken:,} of {use.room:,} bytes ({use.share:.0%})"
        for name, use in uses.items()
    ]
    print(f"{board}: {', '.join(texts)}")
    over = [name for name, use in uses.items() if use.share > LIMIT]
    if over:
        print(f"{image}: more than {LIMIT:.0%} of {', '.join(over)}", file=sys.stderr)
    return bool(over)


def budgets(board: str, image: str) -> dict[str, Use]:
    """Flash, RAM and stack of an image."""
    chip, sections = CHIPS[board], _sections(image)
    variables = sum(sections.get(name, 0) for name in (".data", ".bss", ".noinit"))
    return {
        "flash": Use(sections[".text"] + sections.get(".data", 0), chip.flash),
        "RAM": Use(variables, chip.ram),
        "stack": Use(deepest(disassembly(image), chip.return_address), chip.ram - variables),
    }


def deepest(lines: list[str], return_address: int) -> int:
    """Bytes of the deepest stack that this machine code can reach. Raises RecursionFound."""
    functions = read(lines, return_address)
    pointed_to = _without_a_caller(functions)
    for function in functions.values():
        if function.calls_pointers:
            function.goes_to += [(name, return_address) for name in pointed_to]
    known: dict[str, int] = {}
    routines = {
        name: return_address + _depth(functions, name, (), known)
        for name in functions
        if VECTOR.fullmatch(name)
    }
    nested = any(functions[n].lets_interrupts_in for r in routines for n in _reach(functions, r))
    below = sum(routines.values()) if nested else max(routines.values(), default=0)
    return return_address + _depth(functions, "main", (), known) + below


def _without_a_caller(functions: dict[str, Function]) -> list[str]:
    """Functions that nothing calls by name, so that only a pointer can lead to them."""
    named = {to for function in functions.values() for to, _ in function.goes_to}
    others = sorted(functions.keys() - named - {"main", CODE_BEGINS})
    return [name for name in others if not VECTOR.fullmatch(name)]


def read(lines: list[str], return_address: int) -> dict[str, Function]:
    """Functions of a disassembly by name."""
    functions: dict[str, Function] = {}
    name, last, opened = "", "ret", 0
    for line in lines:
        if (start := FUNCTION.match(line)) and (functions or start[1] == CODE_BEGINS):
            if last not in LEAVES:  # runs on into the next one
                functions[name].goes_to.append((start[1], 0))
            name, opened = start[1], 0
            functions[name] = Function()
        elif functions and (step := INSTRUCTION.match(line)):
            last = step[1]
            opened = _take(functions[name], name, step, opened, return_address)
    return functions


def _take(
    function: Function, name: str, step: re.Match[str], opened: int, return_address: int
) -> int:
    """Add one instruction; returns for how many more the stack pointer's copy is being moved."""
    what, operands, target = step[1], step[2].replace(" ", "").strip(), step[3]
    if what == "push":
        function.frame += 1
    elif what == "rcall" and operands == ".+0":
        function.frame += return_address  # makes room, goes nowhere
    elif what in ("icall", "eicall"):
        function.calls_pointers = True
    elif what == "sei":
        function.lets_interrupts_in = True
    elif target and target != name and what in ("call", "rcall"):
        function.goes_to.append((target, return_address))
    elif target and target != name:
        function.goes_to.append((target, 0))
    elif target and what in ("call", "rcall") and not step[4]:
        if not name.startswith("__"):
            raise RecursionFound(name)
        function.frame += return_address  # the compiler's arithmetic does its work twice
    if what == "in" and operands == "r29,0x3e":
        return 2
    if opened:
        function.frame += _room_made(what, operands)
    return max(0, opened - 1)


def _room_made(what: str, operands: str) -> int:
    """Bytes by which an instruction lowers the copy of the stack pointer in r29:r28."""
    register, _, value = operands.partition(",")
    if (what, register) in (("sbiw", "r28"), ("subi", "r28")):
        return int(value, 16)
    return int(value, 16) << 8 if (what, register) == ("sbci", "r29") else 0


def _depth(
    functions: dict[str, Function], name: str, above: tuple[str, ...], known: dict[str, int]
) -> int:
    """Bytes from a function's own frame on downwards, its return address not included."""
    if name in known:
        return known[name]
    function = functions[name]
    below = 0
    for target, address in function.goes_to:
        if target in (*above, name):
            if address:
                raise RecursionFound(" → ".join((*above, name, target)))
            continue  # a jump back, as in the compiler's own arithmetic
        if target in functions:
            below = max(below, address + _depth(functions, target, (*above, name), known))
    known[name] = function.frame + below
    return known[name]


def _reach(functions: dict[str, Function], name: str) -> Iterator[str]:
    seen, waiting = set(), [name]
    while waiting:
        at = waiting.pop()
        if at in seen or at not in functions:
            continue
        seen.add(at)
        waiting += [target for target, _ in functions[at].goes_to]
        yield at


def disassembly(image: str) -> list[str]:
    """Lines of the image's machine code."""
    return _run("avr-objdump", "-d", image)


def _sections(image: str) -> dict[str, int]:
    rows = [line.split() for line in _run("avr-size", "-A", image)]
    return {row[0]: int(row[1]) for row in rows if len(row) == 3 and row[1].isdigit()}


def _run(*command: str) -> list[str]:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
