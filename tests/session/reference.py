"""The tables of docs/reference/session.md; ``python -m tests.session.reference`` prints them."""

from __future__ import annotations

from rigctl.finger.layout import FINGER_LAYOUT
from rigctl.session import layout
from rigctl.session.layout import DRUM_LAYOUT

LAYOUTS = (DRUM_LAYOUT, FINGER_LAYOUT)


def table(of: layout.TableLayout) -> str:
    lines = [
        f"### `{of.path}`: {of.doc}",
        "",
        "| column | type | unit | meaning |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| `{c.name}` | {kind(c.type_code)} | {c.unit or '–'} | {c.doc} |"
        for c in of.columns
        if not c.optional
    ]
    return "\n".join(lines)


def arrays(of: layout.SessionLayout) -> str:
    lines = ["| data set | shape | type | unit | meaning |", "|---|---|---|---|---|"]
    for array in of.arrays:
        shape = "(n, n_taxels)" if array.per_taxel else "(n,)"
        row = (f"`{array.path}`", shape, kind(array.type_code), array.unit or "–", array.doc)
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines)


def kind(code: str) -> str:
    names = {"u": "uint", "i": "int", "f": "float"}
    if code.startswith("S"):
        return f"text, {code[1:]} bytes"
    return f"{names[code[0]]}{8 * int(code[1:])}"


if __name__ == "__main__":
    for of in LAYOUTS:
        print(f"\n## {of.experiment}\n\n{arrays(of)}")
        for each in of.tables:
            print(f"\n{table(each)}")
