"""Draw ``docs/images/architecture.svg``: ``python -m tests.architecture.picture [--check]``.

Each row is a room: its name, its number of modules, and what its docstring says. A dot says that
the room of its row imports the room of its column. The rooms have the order of the import contract
in ``pyproject.toml``, so every dot is above the diagonal.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from html import escape

from tests.architecture.imports import CHECKOUT, Module, import_graph, load_modules

PICTURE = "docs/images/architecture.svg"
ROW, CELL, NAME, TEXT = 34, 34, 190, 560
TOP, LEFT = 130, 20
CAPTION = (
    "A dot: the room of this row imports the room of this column.",
    "No dot is below the diagonal: imports run down.",
)
STYLE = (
    "text{font-family:sans-serif;font-size:13px;fill:#1b1f24}.name{font-weight:600}"
    ".size{fill:#57606a;font-size:11px}"
)


def rooms() -> list[str]:
    """Return the rooms from the highest to the lowest, as the import contract names them."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = project["tool"]["importlinter"]["contracts"][0]["layers"]
    return [name.strip() for layer in layers for name in layer.split("|")]


def render() -> str:
    """Return the picture as SVG text."""
    modules, names = load_modules(), rooms()
    edges = _edges(modules, names)
    width = LEFT + NAME + TEXT + CELL * len(names) + 40
    height = TOP + ROW * len(names) + 20
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" role="img">',
        "<title>Rooms of rigctl and the imports between them</title>",
        f'<style>{STYLE}</style><rect width="{width}" height="{height}" fill="#fff"/>',
    ]
    for line, text in enumerate(CAPTION):
        parts.append(f'<text x="{LEFT + NAME}" y="{TOP - 30 + 18 * line}">{text}</text>')
    for row, name in enumerate(names):
        parts += _row(row, name, names, modules, edges)
    return "\n".join([*parts, "</svg>"]) + "\n"


def _edges(modules: dict[str, Module], names: list[str]) -> set[tuple[str, str]]:
    return {
        (_room_of(module, names), _room_of(other, names))
        for module, imported in import_graph(modules).items()
        for other in imported
    }


def _room_of(module: str, names: list[str]) -> str:
    return next((name for name in names if f"{module}.".startswith(f"{name}.")), "rigctl")


def _row(
    row: int,
    name: str,
    names: list[str],
    modules: dict[str, Module],
    edges: set[tuple[str, str]],
) -> list[str]:
    y, middle = TOP + ROW * row, TOP + ROW * row + ROW / 2
    inside = [m for m in modules.values() if _room_of(m.name, names) == name]
    files = sum(not m.is_package for m in inside)
    size = f"{files} module{'s' if files > 1 else ''}"
    summary = escape(modules[name].summary.replace("`", ""))
    shade = "#f6f8fa" if row % 2 else "#fff"
    grid = LEFT + NAME + TEXT
    parts = [
        f'<rect x="{LEFT}" y="{y}" width="{NAME + TEXT + CELL * len(names)}" height="{ROW}" '
        f'fill="{shade}"/>',
        f'<text class="name" x="{LEFT + 6}" y="{middle - 3}">{escape(name)}</text>',
        f'<text class="size" x="{LEFT + 6}" y="{middle + 12}">{size}</text>',
        f'<text x="{LEFT + NAME}" y="{middle + 5}">{summary}</text>',
        f'<text transform="translate({grid + CELL * row + CELL / 2 + 4},{TOP - 8}) rotate(-60)">'
        f"{escape(name.removeprefix('rigctl.'))}</text>",
        f'<rect x="{grid + CELL * row}" y="{y}" width="{CELL}" height="{ROW}" fill="#d0d7de"/>',
    ]
    for column, other in enumerate(names):
        if other != name and (name, other) in edges:
            x = grid + CELL * column + CELL / 2
            parts.append(f'<circle cx="{x}" cy="{middle}" r="8" fill="#0969da"/>')
    return parts


def main(arguments: list[str]) -> int:
    """Write the picture, or with ``--check`` say whether it is up to date."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--check", action="store_true")
    path, text = CHECKOUT / PICTURE, render()
    if parser.parse_args(arguments).check:
        return 0 if path.is_file() and path.read_text(encoding="utf-8") == text else 1
    path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
