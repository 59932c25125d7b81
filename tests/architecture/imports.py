"""Modules of ``rigctl`` and ``gui`` and the imports between them, read from the source text."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
PACKAGES = ("rigctl", "gui")


@dataclass(frozen=True)
class Module:
    """One module: dotted name, path in the checkout and syntax tree."""

    name: str
    path: Path
    tree: ast.Module

    @property
    def summary(self) -> str:
        """First line of the docstring; empty where there is none."""
        return (ast.get_docstring(self.tree) or "").partition("\n")[0]

    @property
    def is_package(self) -> bool:
        """Whether this is the ``__init__`` of a package."""
        return self.path.name == "__init__.py"


@cache
def load_modules() -> dict[str, Module]:
    """Return every module by its dotted name."""
    paths = sorted(path for package in PACKAGES for path in (CHECKOUT / package).rglob("*.py"))
    return {module.name: module for module in map(_load, paths)}


def _load(path: Path) -> Module:
    text = path.read_text(encoding="utf-8")
    parts = path.relative_to(CHECKOUT).with_suffix("").parts
    name = ".".join(parts).removesuffix(".__init__")
    return Module(name, path.relative_to(CHECKOUT), ast.parse(text))


def import_graph(modules: dict[str, Module]) -> dict[str, set[str]]:
    """Return the modules that each module imports, inside functions too."""
    return {name: set(_imports(module.tree, modules)) for name, module in modules.items()}


def _imports(tree: ast.Module, modules: dict[str, Module]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            for alias in node.names:
                submodule = f"{node.module}.{alias.name}"
                if submodule in modules:
                    yield submodule
                elif node.module in modules:
                    yield node.module


def import_cycles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of modules that import each other."""
    reachable = {name: _reachable(name, graph) for name in graph}
    circular = {name for name in graph if name in reachable[name]}
    groups = {
        frozenset(other for other in reachable[name] if name in reachable[other])
        for name in circular
    }
    return sorted(sorted(group) for group in groups)


def _reachable(start: str, graph: dict[str, set[str]]) -> set[str]:
    reached: set[str] = set()
    waiting = list(graph[start])
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting.extend(graph[name])
    return reached
