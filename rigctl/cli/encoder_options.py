"""Options that ``encode`` and ``analyse`` share: encoder, taxel ranges, cache, workers."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import Field, fields
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from rigctl.analysis.options import EncoderOptions, declared
from rigctl.cli.arguments import (
    WORKERS,
    a_path,
    add_more_workers,
    add_option,
    number,
    path_or_name,
    whole_number,
    workers_of,
)
from rigctl.cli.progress import ProgressLine

if TYPE_CHECKING:
    from rigctl.analysis.cache import Resources
    from rigctl.analysis.executors import Executor


_Options = TypeVar("_Options", bound=EncoderOptions)


def add_declared(parser: argparse.ArgumentParser, kind: type[EncoderOptions]) -> None:
    """Add the options that a struct declares."""
    groups: dict[str, Any] = {"": parser}
    for name, one in declared(kind).items():
        title = one.metadata["group"]
        if title not in groups:
            groups[title] = parser.add_argument_group(title)
        option = f"--{name.replace('_', '-')}"
        groups[title].add_argument(option, help=one.metadata["doc"], **_how(option, one))


def options_of(args: argparse.Namespace, kind: type[_Options]) -> _Options:
    """Return the options that were given, as their struct."""
    names = [one.name for one in fields(kind)]
    given = {name: value for name in names if (value := getattr(args, name)) is not None}
    lists = {name: tuple(value) for name, value in given.items() if isinstance(value, list)}
    return kind(**{**given, **lists})


def _how(option: str, one: Field[Any]) -> dict[str, Any]:
    """Return how argparse reads an option."""
    declared_as = one.metadata
    if one.type == "bool":
        return {"action": "store_true"}
    if declared_as["choices"]:
        return {"choices": declared_as["choices"], "default": one.default}
    how: dict[str, Any] = {"metavar": declared_as["metavar"], "default": one.default}
    kind = str(one.type).removesuffix(" | None")
    if kind == "tuple[str, ...]":
        return {**how, "action": "append", "default": []}
    if kind == "int":
        limits = int(declared_as["low"]), int(declared_as["high"])
        how["type"] = partial(whole_number(*limits), option)
    elif kind == "float":
        how["type"] = partial(number(declared_as["low"], declared_as["high"]), option)
    elif kind == "Path":
        how["type"] = partial(a_path, option)
    elif kind == "Path | str":
        how["type"] = partial(path_or_name, option)
    return how


def add_resources(parser: argparse.ArgumentParser) -> None:
    """Add the options of the workers and the cache."""
    workers = parser.add_mutually_exclusive_group()
    add_option(
        workers, "--workers", WORKERS, "N", "processors to use on this computer (1)", default=1
    )
    workers.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="use the workers of a Dask scheduler, such as tcp://host:8786; they must see the "
        "sessions' folders",
    )
    add_more_workers(parser, default=1)
    cache = parser.add_mutually_exclusive_group()
    add_option(
        cache,
        "--cache",
        a_path,
        "DIR",
        "folder that keeps encoded conditions for later runs (at most 4 GiB; the least "
        "recently used are removed first; remove the folder to clear it). Default: rigctl in the "
        "system's cache folder, on Linux $XDG_CACHE_HOME or ~/.cache",
    )
    cache.add_argument("--no-cache", action="store_true", help="neither read nor write the cache")


@contextmanager
def resources_of(args: argparse.Namespace) -> Iterator[Resources]:
    """Yield the chosen workers and cache, with a progress line. Raises WrongUse."""
    from rigctl.analysis.cache import Cache, Resources, cache_folder

    cache = Cache(None if args.no_cache else args.cache or cache_folder())
    line = ProgressLine(sys.stderr)
    try:
        with _executor(args) as executor:
            yield Resources(executor, cache, line.show_stage)
    finally:
        line.end()
        cache.trim()


def _executor(args: argparse.Namespace) -> AbstractContextManager[Executor]:
    workers = workers_of(args)
    if args.dask is not None:
        from rigctl.analysis.executors import dask_executor

        return dask_executor(args.dask)
    from rigctl.analysis.executors import local_executor

    return local_executor(workers)
