"""Compare the paper's Table 1 with several reports of analyse.

Show reports of independent sets side by side: accuracies beside the paper's, whether each
comparison of its Table 1 holds in each set, and measurements where not.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("reports", nargs="+", metavar="REPORT", help="report folders of analyse")
    parser.add_argument("--out", required=True, metavar="DIR", help="new folder")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")


def run(args: argparse.Namespace) -> int:
    """Write the page and print what holds and the path of the page."""
    import json

    from rigctl import __version__
    from rigctl.analysis.report.several_reports import summary_sentences, write_comparisons

    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    out = Path(args.out)
    folders = [Path(name) for name in args.reports]
    found = write_comparisons(folders, out, f"rigctl {__version__}, {now}")
    if args.json:
        print(json.dumps(found, allow_nan=False))
    else:
        print("\n".join([*summary_sentences(found), f"page: {out / 'orders.html'}"]))
    return 0
