"""Words that ``encode`` and ``analyse`` have in common: encoder, taxel ranges, cache, workers."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigctl.analysis.data.cache import Cache
    from rigctl.analysis.execution.executor import Executor
    from rigctl.analysis.features.spike_counts import RangesOver
    from rigctl.encoding.normalisation import Normalisation
    from rigctl.encoding.parameters import EncoderParameters


def add_encoder(parser: argparse.ArgumentParser) -> None:
    """Preset, single parameters, force of reference and taxel ranges."""
    group = parser.add_argument_group("the encoder")
    group.add_argument("--preset", default="default", metavar="NAME", help="encoder preset")
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="change one of its parameters, as sa_gain=120; may be repeated",
    )
    group.add_argument(
        "--ranges",
        default="all",
        metavar="all|training|FILE",
        help="taxel ranges over all trials (default), over those at the paper's training speeds "
        "and forces alone, or of a spikes.h5 or model file",
    )
    group.add_argument(
        "--reference-force",
        type=float,
        default=500.0,
        metavar="G",
        help="force whose SA rates the others are scaled to (500)",
    )


def add_means(parser: argparse.ArgumentParser) -> None:
    """Workers and cache."""
    crew = parser.add_mutually_exclusive_group()
    crew.add_argument("--workers", type=int, default=1, metavar="N", help="processes here (1)")
    crew.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="workers of a Dask scheduler, as tcp://host:8786; they must see the folders",
    )
    cache = parser.add_mutually_exclusive_group()
    cache.add_argument(
        "--cache",
        type=Path,
        metavar="DIR",
        help="where encoded conditions are kept, so that a second run repeats none of them (up to "
        "4 GiB, the longest unused go first); default $XDG_CACHE_HOME/rigctl or ~/.cache/rigctl. "
        "To clear it, remove the folder",
    )
    cache.add_argument("--no-cache", action="store_true", help="neither use nor keep anything")


def parameters_of(args: argparse.Namespace) -> EncoderParameters:
    """The encoder asked for. Raises WrongUse."""
    from rigctl.encoding.parameters import changed, preset

    base = preset(args.preset)
    return changed(base, args.set) if args.set else base


def ranges_of(args: argparse.Namespace) -> RangesOver | Normalisation:
    """The taxel ranges asked for.

    Raises SessionError for a file that has none, or whose taxels are in another order.
    """
    from rigctl.analysis.data.wiring_check import check_file
    from rigctl.analysis.features.spike_counts import RangesOver
    from rigctl.session.files.encoder_group import load_ranges

    if args.ranges in list(RangesOver):
        return RangesOver(args.ranges)
    ranges = load_ranges(Path(args.ranges))
    check_file(Path(args.ranges), [Path(name) for name in args.sessions])
    return ranges


def cache_of(args: argparse.Namespace) -> Cache:
    """The cache asked for."""
    from rigctl.analysis.data.cache import Cache, cache_folder

    return Cache(None if args.no_cache else args.cache or cache_folder())


def crew_of(args: argparse.Namespace) -> AbstractContextManager[Executor]:
    """Who does the work. Raises WrongUse."""
    from rigctl.errors import WrongUse

    if args.workers < 1:
        raise WrongUse("--workers must be at least 1")
    if args.dask is not None:
        from rigctl.analysis.execution.dask_executor import dask_executor

        return dask_executor(args.dask)
    from rigctl.analysis.execution.executor import processes

    return processes(args.workers)
