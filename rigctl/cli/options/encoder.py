"""Options that ``encode`` and ``analyse`` share: encoder, taxel ranges, cache, workers."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.cli.options.arguments import (
    a_path,
    add_more_workers,
    number,
    path_or_name,
    worker_type,
    workers_of,
)
from rigctl.cli.options.progress import ProgressLine

if TYPE_CHECKING:
    from rigctl.analysis.cache import Resources
    from rigctl.analysis.executors import Executor
    from rigctl.analysis.spike_counts import RangesOver
    from rigctl.encoding.normalisation import Normalisation
    from rigctl.encoding.parameters import EncoderParameters


READINGS = ("counts", "conductance")


def add_encoder(parser: argparse.ArgumentParser) -> None:
    """Add the options of the encoder, the reference force and the taxel ranges."""
    group = parser.add_argument_group("the encoder")
    group.add_argument("--preset", default="default", metavar="NAME", help="encoder preset")
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="change a parameter of the preset, such as sa_gain=120; may be repeated",
    )
    group.add_argument(
        "--reading",
        choices=READINGS,
        default=READINGS[0],
        help="what the encoder takes of a taxel: its counts (default, as in the paper), or the "
        "conductance without the load of the other taxels of its input",
    )
    group.add_argument(
        "--ranges",
        type=path_or_name("--ranges"),
        default="all",
        metavar="all|training|FILE",
        help="measure the taxel ranges in all trials (default) or only in those at the paper's "
        "training speeds and forces, or take them from a spikes.h5 or model file",
    )
    group.add_argument(
        "--reference-force",
        type=number("--reference-force", 1, 100_000),
        metavar="G",
        help="force to which the SA rates of the other forces are scaled (500)",
    )


def add_resources(parser: argparse.ArgumentParser) -> None:
    """Add the options of the workers and the cache."""
    workers = parser.add_mutually_exclusive_group()
    workers.add_argument(
        "--workers",
        type=worker_type(),
        default=1,
        metavar="N",
        help="processors to use on this computer (1)",
    )
    workers.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="use the workers of a Dask scheduler, such as tcp://host:8786; they must see the "
        "sessions' folders",
    )
    add_more_workers(parser, default=1)
    cache = parser.add_mutually_exclusive_group()
    cache.add_argument(
        "--cache",
        type=a_path("--cache"),
        metavar="DIR",
        help="folder that keeps encoded conditions for later runs (at most 4 GiB; the least "
        "recently used are removed first; remove the folder to clear it). Default: rigctl in the "
        "system's cache folder, on Linux $XDG_CACHE_HOME or ~/.cache",
    )
    cache.add_argument("--no-cache", action="store_true", help="neither read nor write the cache")


def parameters_of(args: argparse.Namespace) -> EncoderParameters:
    """Return the chosen encoder parameters. Raises WrongUse."""
    from rigctl.encoding.parameters import override, preset

    base = preset(args.preset)
    if args.reading != base.reading:
        base = override(base, [f"reading={args.reading}"])
    return override(base, args.set) if args.set else base


def reference_force_of(args: argparse.Namespace) -> float:
    """Return the chosen reference force in g, or the paper's."""
    from rigctl.encoding.force_matrix import REFERENCE_FORCE_G

    return REFERENCE_FORCE_G if args.reference_force is None else float(args.reference_force)


def ranges_of(args: argparse.Namespace) -> RangesOver | Normalisation:
    """Return the chosen taxel ranges.

    Raises SessionError for a file without ranges, or with another order of taxels.
    """
    from rigctl.analysis.spike_counts import RangesOver
    from rigctl.analysis.trial_set import check_file_wiring
    from rigctl.session.files.encoder_group import load_ranges

    if args.ranges in list(RangesOver):
        return RangesOver(args.ranges)
    ranges = load_ranges(Path(args.ranges))
    check_file_wiring(Path(args.ranges), [Path(name) for name in args.sessions])
    return ranges


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
        from rigctl.analysis.dask_executor import dask_executor

        return dask_executor(args.dask)
    from rigctl.analysis.executors import local_executor

    return local_executor(workers)
