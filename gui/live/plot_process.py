"""Run a user's Python file on the samples that come: the process behind the page of own plots.

Each line on the standard input asks for one answer: the curves of the samples since the last one.
What the file prints goes to the terminal of the window.
"""

from __future__ import annotations

import faulthandler
import os
import runpy
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np

from rigctl.engine.live_file import LiveFileReader, LiveReader, TaxelWindow
from rigctl.errors import RigFault
from rigctl.finger.live_file import FingerLiveReader

CALL_S, LOAD_S = 5.0, 60.0
"""A file that takes longer for a block, or to load with what it imports, is ended."""
SHOWN = 10_000
"""Samples, 10 s of them."""
MOST_CURVES = 12
FUNCTION = "curves"
FORM = f"{FUNCTION}(block) returns {{name: (values, unit)}}"


class Curve(msgspec.Struct):
    """Unit and values of a curve, one for each sample; None where there is none."""

    unit: str
    values: list[float | None]


class Answer(msgspec.Struct):
    """Loop times of new samples and their curves by name; or what is wrong with the file."""

    time_s: list[float]
    curves: dict[str, Curve]
    failure: str = ""


def serve(path: str, live: Path, requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer until the window ends; tell what is wrong with the file, and end."""
    function: Any = None
    try:
        faulthandler.dump_traceback_later(LOAD_S, exit=True, file=answers)
        function = runpy.run_path(path).get(FUNCTION)
        if not callable(function):
            raise TypeError(f"it has no {FUNCTION}(block)")
        faulthandler.cancel_dump_traceback_later()
        for answer in _curves(function, _open_live(live), requests, answers):
            answers.write(msgspec.json.encode(answer) + b"\n")
            answers.flush()
    except BaseException as error:  # noqa: BLE001 - whatever the user's file raises is shown
        faulthandler.cancel_dump_traceback_later()
        failure = Answer([], {}, _sentence(path, function, error))
        answers.write(msgspec.json.encode(failure) + b"\n")
        answers.flush()


def _open_live(path: Path) -> LiveFileReader:
    """Open the live data of a drum or of a finger. Raises RigFault for another file."""
    try:
        return LiveReader(path)
    except RigFault:
        return FingerLiveReader(path)


def _curves(
    function: Callable[[TaxelWindow], Any], live: LiveFileReader, requests: BinaryIO, said: BinaryIO
) -> Any:
    """Yield an answer for each request."""
    seen, units = live.taxel_head, None
    for _ in requests:
        block = live.taxels_since(seen)
        if not len(block):
            yield Answer([], {})
            continue
        seen = block.first + len(block)
        faulthandler.dump_traceback_later(CALL_S, exit=True, file=said)
        made = read_curves(function(block), len(block))
        faulthandler.cancel_dump_traceback_later()
        now = {name: curve.unit for name, curve in made.items()}
        if units not in (None, now):
            raise ValueError(f"other curves or units than before: {', '.join(now)}")
        units = now
        yield Answer(block.time_s[-SHOWN:].tolist(), made)


def read_curves(made: Any, n: int) -> dict[str, Curve]:
    """Return what a file made of ``n`` samples. Raises TypeError, ValueError for what it is not."""
    if not isinstance(made, Mapping) or len(made) > MOST_CURVES:
        raise TypeError(f"{FORM}, at most {MOST_CURVES}")
    curves = {}
    for name, pair in made.items():
        if not isinstance(pair, tuple) or len(pair) != 2:
            raise TypeError(f"{FORM}: {name!r} is no pair")
        values = np.asarray(pair[0], float)
        if values.shape not in ((), (1,), (n,)):
            raise ValueError(f"{name!r} has the shape {values.shape}: one value, or {n}")
        shown = np.broadcast_to(values, n)[-SHOWN:]
        curves[str(name)] = Curve(str(pair[1]), shown.tolist())
    return curves


def _sentence(path: str, function: Any, error: BaseException) -> str:
    """Return file, line and error; the line of the function where the error is in what it made."""
    lines = [
        one.lineno for one in traceback.extract_tb(error.__traceback__) if one.filename == path
    ]
    if isinstance(error, SyntaxError) and error.filename == path:
        lines.append(error.lineno)
    if not lines and hasattr(function, "__code__"):
        lines.append(function.__code__.co_firstlineno)
    place = f"{Path(path).name}, line {lines[-1]}" if lines else Path(path).name
    text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    return f"{place}: {text}. Correct the file and save it"


def main() -> None:
    """Serve the file and the live data that the command line names."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    if hasattr(os, "nice"):
        os.nice(10)  # the engine and the window come first
    serve(sys.argv[1], Path(sys.argv[2]), sys.stdin.buffer, answers)


if __name__ == "__main__":
    main()
