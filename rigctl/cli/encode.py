"""Write the spikes of sessions and the force matrix C as plain arrays.

Encode the trials of one or several sessions into spikes: exact sample indices in compressed
sparse rows, with C, window counts, every parameter and the source of each trial. OUT/spikes.h5
appears whole or not at all; after an interruption the next run continues from the cache.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from rigctl.analysis.options import EncoderOptions
from rigctl.cli.arguments import a_path, add_option, number, whole_number
from rigctl.cli.encoder_options import add_declared, add_resources, options_of, resources_of
from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from rigctl.analysis.cache import Cache
    from rigctl.analysis.encoded_sessions import Encoded
    from rigctl.analysis.taxel import EncodeRequest


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "sessions", a_path, "SESSION", "session folders", nargs="+")
    add_option(parser, "--out", a_path, "DIR", "new folder for the spikes")
    parser.add_argument(
        "--scaled-by",
        choices=("none", "texture", "blind"),
        default="none",
        help="factor on the SA current: none; C of the trial's own texture; or, blind to the "
        "texture, the mean of C over all textures (the file contains C in every case)",
    )
    add_declared(parser, EncoderOptions)
    add_resources(parser)
    _add_taxel(parser)


def _add_taxel(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "one taxel of one trial, from the reading to its spikes (the paper's Fig. 2D, Movie S2)"
    )
    add_option(
        group,
        "--trial",
        whole_number(0),
        "ID",
        "number of the trial (the nearest to that of Fig. 2C); with --out: DIR/taxel.*",
    )
    add_option(
        group, "--taxel", whole_number(1), "N", "number of the taxel, from 1 (the most active one)"
    )
    files = (
        ("--figure", "new .svg, .png or .pdf of every signal"),
        ("--csv", "new table of every signal, a line a sample of the whole trial"),
        ("--stimulation", "new .csv or .json of the trial's spikes as pulses of a stimulator"),
        ("--movie", "new .gif or .mp4 in which the signals grow, or .png of its last frame"),
    )
    for name, words in files:
        add_option(group, name, a_path, "FILE", words)
    add_option(
        group,
        "--start",
        number(0, 3600),
        "S",
        "time in the trial at which figure and movie begin (0)",
        default=0.0,
    )
    add_option(
        group,
        "--seconds",
        number(0.01, 3600),
        "S",
        "how much of the trial they show (1); a movie plays for 10 s",
        default=1.0,
    )


def run(args: argparse.Namespace) -> int:
    """Write the files; the last lines on standard output name them."""
    from rigctl.analysis.encoded_sessions import encode_sessions
    from rigctl.analysis.taxel import encode_taxel

    request = _request(args)
    if args.out is None and not request.files:
        raise WrongUse(
            "nothing to write: give --out DIR for the spikes of all trials, or --figure, --csv, "
            "--movie or --stimulation FILE for one trial"
        )
    request.check_files()
    if args.out is not None:
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        with resources_of(args) as resources:
            encoded = encode_sessions(request, args.out, now, resources)
        print("\n".join(_summary(encoded, resources.cache)), flush=True)
    if request.files:
        with resources_of(args) as resources:
            remarks = encode_taxel(request, resources)
        if args.out is None:
            print("\n".join(f"note: {remark}" for remark in remarks), end="\n" if remarks else "")
        print("\n".join(f"{file}: {file.stat().st_size / 1e6:.2f} MB" for file in request.files))
    return 0


def _request(args: argparse.Namespace) -> EncodeRequest:
    from rigctl.analysis.force_scaling import ScaledBy
    from rigctl.analysis.taxel import EncodeRequest

    options = options_of(args, EncoderOptions)
    return EncodeRequest(
        options.sessions,
        options.parameters,
        settings=options.analysis,
        ranges=options.taxel_ranges,
        scaled_by=ScaledBy(args.scaled_by),
        trial=args.trial,
        taxel=args.taxel,
        start_s=args.start,
        seconds=args.seconds,
        figure=args.figure,
        csv=args.csv,
        movie=args.movie,
        stimulation=args.stimulation,
    )


def _summary(encoded: Encoded, cache: Cache) -> list[str]:
    """Return the remarks, a sentence about C, the work done, and the path of the file."""
    from rigctl.analysis.force_scaling import force_sentence
    from rigctl.analysis.notes import summarise_notes

    lines = [f"note: {note}" for note in summarise_notes(encoded.remarks, rest_in="spikes.h5")]
    if encoded.force is not None:
        lines.append(force_sentence(encoded.force))
    tasks = cache.hits + cache.misses
    lines.append(f"{encoded.trials:,} trials, {encoded.spikes:,} spikes")
    lines.append(f"{cache.misses} of {tasks} tasks computed, {cache.hits} read from the cache")
    return [*lines, f"spikes: {encoded.file}"]
