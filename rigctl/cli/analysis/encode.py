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

from rigctl.cli.options.arguments import a_path, whole_number
from rigctl.cli.options.encoder import (
    add_encoder,
    add_resources,
    parameters_of,
    ranges_of,
    reference_force_of,
    resources_of,
)

if TYPE_CHECKING:
    from rigctl.analysis.data.cache import Cache
    from rigctl.analysis.features.encoded_sessions import Encoded


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "sessions", nargs="+", type=a_path("SESSION"), metavar="SESSION", help="session folders"
    )
    parser.add_argument(
        "--out", type=a_path("--out"), required=True, metavar="DIR", help="new folder"
    )
    parser.add_argument(
        "--scaled-by",
        choices=("none", "texture", "blind"),
        default="none",
        help="factor on the SA current: none; C of the trial's own texture; or, blind to the "
        "texture, the mean of C over all textures (the file contains C in every case)",
    )
    add_encoder(parser)
    add_resources(parser)
    parser.add_argument(
        "--trial",
        type=whole_number("--trial", 0),
        metavar="ID",
        help="also draw one taxel of this trial: DIR/taxel.*",
    )
    parser.add_argument(
        "--taxel", type=whole_number("--taxel", 1), metavar="N", help="taxel to draw, from 1"
    )


def run(args: argparse.Namespace) -> int:
    """Write the file; the last line on standard output names it."""
    from rigctl.analysis.features.encoded_sessions import EncodeRequest, ScaledBy, encode_sessions

    request = EncodeRequest(
        tuple(Path(name) for name in args.sessions),
        Path(args.out),
        parameters_of(args),
        reference_g=reference_force_of(args),
        ranges=ranges_of(args),
        scaled_by=ScaledBy(args.scaled_by),
        trial=args.trial,
        taxel=args.taxel,
    )
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    with resources_of(args) as resources:
        encoded = encode_sessions(request, now, resources)
    print("\n".join(_summary(encoded, resources.cache)), flush=True)
    return 0


def _summary(encoded: Encoded, cache: Cache) -> list[str]:
    """Return the remarks, a sentence about C, the work done, and the path of the file."""
    from rigctl.analysis.data.notes import summarise_notes
    from rigctl.analysis.features.c_outcome import force_sentence

    lines = [f"note: {note}" for note in summarise_notes(encoded.remarks, rest_in="spikes.h5")]
    if encoded.force is not None:
        lines.append(force_sentence(encoded.force))
    tasks = cache.hits + cache.misses
    lines.append(f"{encoded.trials:,} trials, {encoded.spikes:,} spikes")
    lines.append(f"{cache.misses} of {tasks} tasks computed, {cache.hits} read from the cache")
    return [*lines, f"spikes: {encoded.file}"]
