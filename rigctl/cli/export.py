"""Write sessions for other programs: NWB, MATLAB, Parquet, Neo, CSV.

An export holds the readings, what the rig did, trials, events and spikes on one clock, whole or of
chosen trials and taxels. It appears whole or not at all, and never in the place of anything. That
data are simulated stands in every file. The spikes are those of `rigctl encode`.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from rigctl.analysis.notes import summarise_notes
from rigctl.analysis.options import EncoderOptions
from rigctl.cli import INTERRUPTED
from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.encoder_options import add_declared, options_of
from rigctl.cli.progress import Interrupts, ProgressLine
from rigctl.plugins import installed

FORMATS = ("nwb", "matlab", "parquet", "neo", "csv")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    from rigctl.exchange.export.selection import (
        USUAL,
        Representation,
        parse_numbers,
        parse_representations,
    )

    add_option(parser, "sessions", a_path, "SESSION", "session folders", nargs="+")
    others = [one.name for one in installed("exporter")]
    formats = tuple(dict.fromkeys((*FORMATS, *others)))
    parser.add_argument("--to", choices=formats, required=True, help="the format")
    add_option(
        parser,
        "--out",
        a_path,
        "TARGET",
        "new file or folder; of several sessions the folder of all (beside each session)",
    )
    add_option(parser, "--trials", parse_numbers, "IDS", "only these trials, such as 1-100,205")
    add_option(parser, "--taxels", parse_numbers, "NUMBERS", "only these taxels, from 1")
    add_option(
        parser,
        "--representations",
        parse_representations,
        "NAMES",
        f"what stands for a trial: some of {', '.join(Representation)} ({','.join(USUAL)}); counts "
        "are spikes in the paper's windows, unscaled and scaled by the speed",
        default=USUAL,
    )
    add_declared(parser, EncoderOptions)


def run(args: argparse.Namespace) -> int:
    """Export one session after the other; print where each export is."""
    from rigctl.exchange.export.formats import choose_targets, export_session
    from rigctl.exchange.export.selection import Selection

    selection = Selection(
        args.trials or frozenset(), args.taxels or frozenset(), args.representations
    )
    options = options_of(args, EncoderOptions)
    targets = choose_targets(args.sessions, args.to, args.out)
    line = ProgressLine(sys.stderr)
    with Interrupts(limit=1) as interrupts:
        show = partial(_show, line, interrupts)
        for session, target in zip(args.sessions, targets, strict=True):
            try:
                export = export_session(session, args.to, target, selection, options, show)
            except KeyboardInterrupt:
                line.end()
                print(f"rigctl: interrupted; {target} was not made", file=sys.stderr)
                return INTERRUPTED
            line.end()
            _print(session, export.remarks)
            print(f"export: {target}")
    return 0


def _show(line: ProgressLine, interrupts: Interrupts, stage: str, done: int, total: int) -> None:
    """Show the progress. Raises KeyboardInterrupt where the user wants the end."""
    if interrupts.requested():
        raise KeyboardInterrupt
    line.show_stage(stage, done, max(1, total))


def _print(session: Path, remarks: tuple[str, ...]) -> None:
    for note in summarise_notes(remarks, rest_in="the session"):
        print(f"note: {session}: {note}", file=sys.stderr)
