"""Compare the paper's Table 1 with several reports of analyse.

Show the reports of independent data sets side by side: the accuracies beside the paper's, which
comparisons of Table 1 hold in which set, and measurements for those that do not hold.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime

from rigctl.cli.arguments import a_path, add_option


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "reports", a_path, "REPORT", "report folders of analyse", nargs="+")
    add_option(parser, "--out", a_path, "DIR", "new folder", required=True)
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")


def run(args: argparse.Namespace) -> int:
    """Write the page; print which comparisons hold, and the path of the page."""
    import json

    from rigctl import __version__
    from rigctl.analysis.report.several_reports import (
        load_reports,
        missing_sentences,
        summary_sentences,
        write_comparisons,
    )

    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    out = args.out
    comparisons = write_comparisons(args.reports, out, f"rigctl {__version__}, {now}")
    if args.json:
        print(json.dumps(comparisons, allow_nan=False))
    else:
        notes = [f"note: {line}" for line in missing_sentences(load_reports(args.reports))]
        print("\n".join([*notes, *summary_sentences(comparisons), f"page: {out / 'orders.html'}"]))
    return 0
