"""Make a bundle to cite of sessions and their figures, or its figures again.

A bundle is an RO-Crate: the sessions, the report of `rigctl analyse`, every parameter, the versions
of the software, and the checksum of each file. `rigctl verify BUNDLE` proves it; with --remake its
figures are made again from what is in it, and compared.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime

from rigctl.analysis.options import AnalysisOptions
from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.encoder_options import add_declared, add_resources, options_of, resources_of
from rigctl.errors import WrongUse

EQUAL, DIFFERENT = 0, 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "sessions", a_path, "SESSION", "session folders, or one bundle", nargs="+")
    add_option(parser, "--out", a_path, "DIR", "new folder", required=True)
    parser.add_argument(
        "--remake", action="store_true", help="make the report of a bundle again, into --out"
    )
    parser.add_argument("--title", default="", type=str.strip, help="title to cite")
    parser.add_argument(
        "--creator", default=[], action="append", metavar="NAME", help="may be repeated"
    )
    parser.add_argument("--license", default="", metavar="URL", help="such as its SPDX address")
    add_declared(parser, AnalysisOptions)
    add_resources(parser)


def run(args: argparse.Namespace) -> int:
    """Make the bundle and print its digest, or compare the figures that were made again."""
    from rigctl.exchange.bundle import Citation, bundle_digest, make_bundle

    if args.remake:
        return _remake(args)
    options = options_of(args, AnalysisOptions)
    citation = Citation(args.title, tuple(args.creator), args.license)
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    with resources_of(args) as resources:
        bundle = make_bundle(options, args.out, citation, now, resources)
    print(f"bundle: {bundle}")
    print(f"digest: {bundle_digest(bundle)} (cite this line: `rigctl verify` compares it)")
    return 0


def _remake(args: argparse.Namespace) -> int:
    from rigctl.exchange.bundle import remake

    if len(args.sessions) != 1:
        raise WrongUse("--remake takes one bundle")
    with resources_of(args) as resources:
        made = remake(args.sessions[0], args.out, resources)
    print(
        "\n".join(f"different: {name}" for name in made.different), end="\n" * bool(made.different)
    )
    total = len(made.equal) + len(made.different)
    print(f"{len(made.equal)} of {total} figures are equal to the bit")
    print(f"report: {made.folder}")
    return DIFFERENT if made.different else EQUAL
