"""``rigctl classify MODEL SESSION…``: predict the texture of every trial with a trained model."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from rigctl.cli.options.progress import ProgressLine


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser."""
    parser = subparsers.add_parser(
        "classify",
        help="predict the textures of a session with a trained model",
        description="Encode the trials of sessions as those of the model were encoded, and predict "
        "the texture of each with its posterior. rigctl analyse --save-model makes models.",
    )
    parser.add_argument("model", type=Path, metavar="MODEL", help="a model file")
    parser.add_argument("sessions", nargs="+", type=Path, metavar="SESSION", help="folders")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="write the predictions: JSON to .json, else CSV"
    )
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes (1)")


def run(args: argparse.Namespace) -> int:
    """Print or write the predictions; the last line gives the share that is right."""
    from rigctl.analysis.classification.classify_sessions import classify
    from rigctl.analysis.classification.predictions import as_csv, as_dict, as_text
    from rigctl.analysis.data.cache import Cache, Resources
    from rigctl.analysis.execution.executor import local_executor
    from rigctl.errors import WrongUse
    from rigctl.session.files.model_file import check_output_path, load_model

    if args.workers < 1:
        raise WrongUse("--workers must be at least 1")
    if args.out is not None:
        check_output_path(args.out)
    model = load_model(args.model)
    line = ProgressLine(sys.stderr)
    try:
        with local_executor(args.workers) as executor:
            resources = Resources(executor, Cache(), line.show_stage)
            found = classify(model, args.sessions, resources)
    finally:
        line.end()
    plain = json.dumps(as_dict(found), allow_nan=False, ensure_ascii=False)
    if args.out is not None:
        _write(args.out, plain + "\n" if args.out.suffix == ".json" else as_csv(found))
    print(plain if args.json else as_text(found, every_trial=args.out is None))
    if args.out is not None and not args.json:
        print(f"answers: {args.out}")
    return 0


def _write(path: Path, text: str) -> None:
    """Write the file whole or not at all. Raises DiskFault."""
    from rigctl.errors import DiskFault

    partial = path.with_name(f"{path.name}.partial")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.rename(path)
    except OSError as error:
        raise DiskFault(f"{path} cannot be written: {error.strerror or error}") from error
    finally:
        partial.unlink(missing_ok=True)
