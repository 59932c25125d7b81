"""Write a trained model as the header of the classifier on the finger board."""

from __future__ import annotations

import argparse
from pathlib import Path

from rigctl.cli.arguments import a_path, add_option
from rigctl.errors import WrongUse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the part."""
    add_option(parser, "model", a_path, "MODEL", "session with a trained model, or a model file")
    add_option(parser, "--out", a_path, "FILE.h", required=True)


def run(args: argparse.Namespace) -> int:
    """Write the header and print how to build it in."""
    from rigctl.finger.analysis.classifier import board_coefficients, centred_stages
    from rigctl.finger.board_messages import model_header
    from rigctl.finger.model_file import load_finger_model
    from rigctl.finger.model_files import SPEED_SCALED, model_path
    from rigctl.finger.values import ScanKind

    path = model_path(args.model, SPEED_SCALED)
    model = load_finger_model(path)
    if not ScanKind(model.representation).is_speed_scaled:
        raise WrongUse(
            f"{path} is a model of {model.representation} features, the board's are of scaled "
            "time: give model-speed-scaled.h5"
        )
    stage = centred_stages(model)[-1]
    coefficients, intercepts = board_coefficients(model)
    header = model_header(stage.mean, stage.axes, coefficients, intercepts, model.textures)
    source = "simulated scans" if model.training.simulated else "scans"
    note = f"// Trained on {model.training.trials} {source}.\n"
    _write(args.out, note + header)
    centred = "calibration" if model.calibration is not None else "training"
    print(
        f"{args.out}: {len(model.textures)} textures, {stage.axes.shape[1]} components, the mean "
        f"of the {centred}\nbuild the firmware with -DFINGER_MODEL='\"{args.out.resolve()}\"'"
    )
    return 0


def _write(file: Path, text: str) -> None:
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise WrongUse(f"cannot write {file}: {error.strerror}") from error
