"""Predict the textures of a session with a trained model.

Encode the trials as the model's training trials were encoded, and predict the texture of each
with its posterior. rigctl analyse --save-model makes models.
"""

from __future__ import annotations

import argparse
import json

from rigctl.cli.arguments import WORKERS, a_path, add_more_workers, add_option
from rigctl.cli.encoder_options import resources_of
from rigctl.config.toml_edit import replace_file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "model", a_path, "MODEL", "a model file")
    add_option(parser, "sessions", a_path, "SESSION", "folders", nargs="+")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_option(parser, "--out", a_path, "FILE", "write the predictions: JSON to .json, else CSV")
    add_option(
        parser,
        "--passport",
        a_path,
        "FILE",
        "sensor.json of the sensor, for a Calibrated model and sessions that do not carry one",
    )
    add_option(parser, "--workers", WORKERS, "N", "processors to use (1)", default=1)
    add_more_workers(parser, default=1)
    parser.set_defaults(dask=None, no_cache=True)  # options that resources_of reads


def run(args: argparse.Namespace) -> int:
    """Print or write the predictions and their accuracy."""
    from rigctl.analysis.classify_sessions import as_dict, as_text, classify, prediction_rows
    from rigctl.analysis.result_tables import to_csv
    from rigctl.session.analysis_file import check_output_path
    from rigctl.session.model_file import load_model
    from rigctl.session.sensor_passport import load_passport

    if args.out is not None:
        check_output_path(args.out)
    model = load_model(args.model)
    named = args.passport
    passport = None if named is None else load_passport(named, model.n_taxels)
    with resources_of(args) as resources:
        found = classify(model, args.sessions, resources, passport)
    as_json = json.dumps(as_dict(found), allow_nan=False, ensure_ascii=False)
    if args.out is not None:
        is_json = args.out.suffix == ".json"
        replace_file(args.out, as_json + "\n" if is_json else to_csv(prediction_rows(found)))
    print(as_json if args.json else as_text(found, every_trial=args.out is None))
    if args.out is not None and not args.json:
        print(f"predictions: {args.out}")
    return 0
