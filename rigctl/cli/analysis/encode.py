"""``rigctl encode``: recorded sessions to a file of spikes, force matrix and window counts."""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.cli.options.encoder import (
    add_encoder,
    add_means,
    cache_of,
    crew_of,
    parameters_of,
    ranges_of,
)
from rigctl.cli.options.stages import StageLine


def add_parser(subparsers: Any) -> None:
    """Describe the command line."""
    parser = subparsers.add_parser(
        "encode",
        help="spikes of sessions, with the force matrix C, in a file of plain arrays",
        description="Encode the trials of sessions, of one day or several, into spikes: exact "
        "samples in compressed sparse rows, with C, window counts, every parameter and where each "
        "trial comes from. OUT/spikes.h5 appears whole or not at all; what was encoded before an "
        "interruption is kept in the cache, so that the next run goes on from there.",
    )
    parser.add_argument("sessions", nargs="+", metavar="SESSION", help="session folders")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder to be made")
    parser.add_argument(
        "--scaled-by",
        choices=("none", "texture", "blind"),
        default="none",
        help="C on the SA current of the spikes: none; texture: of the trial's own texture; "
        "blind: mean over textures (C itself is in the file in any case)",
    )
    add_encoder(parser)
    add_means(parser)
    parser.add_argument(
        "--trial", type=int, metavar="ID", help="also draw one taxel of this trial: DIR/taxel.*"
    )
    parser.add_argument("--taxel", type=int, metavar="N", help="its taxel, from 1")


def run(args: argparse.Namespace) -> int:
    """Write the file; the last line on standard output says where it is."""
    from rigctl.analysis.features.encoded_sessions import EncodeRequest, ScaledBy, encode_sessions
    from rigctl.analysis.features.spike_counts import Resources

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
    kept, line = cache_of(args), StageLine(sys.stderr)
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    try:
        with crew_of(args) as crew:
            found = encode_sessions(request, now, Resources(crew, kept, line.show))
    finally:
        line.end()
        kept.trim()
    print("\n".join(summary(found, kept)), flush=True)
    return 0


def summary(found: Any, kept: Any) -> list[str]:
    """Remarks, what C came to, what was done anew, and where the file is."""
    from rigctl.analysis.features.representations import force_sentence

    lines = [f"note: {remark}" for remark in found.remarks]
    if found.force is not None:
        lines.append(force_sentence(found.force))
    pieces = kept.found + kept.missed
    lines.append(f"{found.trials:,} trials, {found.spikes:,} spikes")
    lines.append(
        f"{kept.missed} of {pieces} pieces of work done, {kept.found} taken from the cache"
    )
    return [*lines, f"spikes: {found.file}"]
