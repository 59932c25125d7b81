"""Write the spikes of sessions and the force matrix C as plain arrays.

Encode the trials of one or several sessions into spikes: exact sample indices in compressed
sparse rows, with C, window counts, every parameter and the source of each trial. OUT/spikes.h5
appears whole or not at all; after an interruption the next run continues from the cache.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.cli.options.encoder import (
    add_encoder,
    add_resources,
    parameters_of,
    ranges_of,
    resources_of,
)

if TYPE_CHECKING:
    from rigctl.analysis.data.cache import Cache
    from rigctl.analysis.features.encoded_sessions import Encoded


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("sessions", nargs="+", metavar="SESSION", help="session folders")
    parser.add_argument("--out", required=True, metavar="DIR", help="new folder")
    parser.add_argument(
        "--scaled-by",
        choices=("none", "texture", "blind"),
        default="none",
        help="factor on the SA current: none; texture: C of the trial's own texture; blind: mean "
        "of C over textures (the file holds C in any case)",
    )
    add_encoder(parser)
    add_resources(parser)
    parser.add_argument(
        "--trial", type=int, metavar="ID", help="also draw one taxel of this trial: DIR/taxel.*"
    )
    parser.add_argument("--taxel", type=int, metavar="N", help="its taxel, from 1")


def run(args: argparse.Namespace) -> int:
    """Write the file; the last line on standard output names it."""
    from rigctl.analysis.features.encoded_sessions import EncodeRequest, ScaledBy, encode_sessions

    request = EncodeRequest(
        tuple(Path(name) for name in args.sessions),
        Path(args.out),
        parameters_of(args),
        args.reference_force,
        ranges_of(args),
        ScaledBy(args.scaled_by),
        args.trial,
        args.taxel,
    )
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    with resources_of(args) as resources:
        found = encode_sessions(request, now, resources)
    print("\n".join(_summary(found, resources.cache)), flush=True)
    return 0


def _summary(found: Encoded, cache: Cache) -> list[str]:
    """Return the remarks, a sentence about C, the work done, and the path of the file."""
    from rigctl.analysis.features.representations import force_sentence

    lines = [f"note: {remark}" for remark in found.remarks]
    if found.force is not None:
        lines.append(force_sentence(found.force))
    tasks = cache.hits + cache.misses
    lines.append(f"{found.trials:,} trials, {found.spikes:,} spikes")
    lines.append(f"{cache.misses} of {tasks} tasks computed, {cache.hits} read from the cache")
    return [*lines, f"spikes: {found.file}"]
