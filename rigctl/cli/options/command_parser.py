"""The parser of one command, which loads the command's module only for words of that command."""

from __future__ import annotations

import argparse
import ast
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

PACKAGE = "rigctl.cli"


class CommandParser(argparse.ArgumentParser):
    """The parser of a command, whose ``module`` adds its arguments when words are parsed.

    Without a module it is a plain parser, such as that of a part of a command.
    """

    def __init__(self, *args: Any, module: str = "", **options: Any) -> None:
        super().__init__(*args, **options)
        self._module = module
        self._is_intermixed = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Load the command, then parse its words.

        Options may stand between a word and an optional one: argparse by itself takes the latter
        for left out, and then refuses it.
        """
        self.load()
        words = [action.nargs for action in self._get_positional_actions()]
        if self._is_intermixed or len(words) < 2 or words[-1] != "?":
            return super().parse_known_args(args, namespace)
        self._is_intermixed = True  # it calls this method for the options, then for the words
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._is_intermixed = False

    def load(self) -> None:
        """Add the description and the arguments of the command, once."""
        if not self._module:
            return
        command: Any = import_module(self._module, PACKAGE)
        self._module = ""
        self.description = command.__doc__.partition("\n\n")[2] or None
        command.add_arguments(self)


def read_summary(module: str) -> str:
    """Return the first line of a module's docstring as it stands in a list, without loading it."""
    spec = find_spec(module, PACKAGE)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(module)
    source = Path(spec.origin).read_bytes()
    summary = (ast.get_docstring(ast.parse(source)) or "").partition("\n\n")[0]
    return summary[:1].lower() + summary[1:].rstrip(".")
