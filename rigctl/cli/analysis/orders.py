"""``rigctl orders``: whether the orders of the paper's Table 1 stand, over several reports."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import Any


def add_parser(subparsers: Any) -> None:
    """Describe the command line."""
    parser = subparsers.add_parser(
        "orders",
        help="the orders of the paper's Table 1 over several reports of analyse",
        description="Put reports of independent sets side by side: accuracies beside the paper's, "
        "whether each order of its Table 1 stands in each set, and what was measured where not.",
    )
    parser.add_argument("reports", nargs="+", metavar="REPORT", help="folders made by analyse")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder to be made")
    parser.add_argument("--json", action="store_true", help="the summary as JSON")


def run(args: argparse.Namespace) -> int:
    """Write the page; the lines on standard output say what stands and where it is."""
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
