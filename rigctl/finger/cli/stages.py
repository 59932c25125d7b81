"""Record the stages of the experiment, and train and calibrate its classifiers in between."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from rigctl.cli.arguments import about_options, ask_own_fields
from rigctl.cli.engine_process import utc_now
from rigctl.cli.progress import ProgressLine, clock
from rigctl.cli.run import EXIT_CODES, TOLD_EVENTS, RunWatcher, send_lsl
from rigctl.cli.verify import print_missing, print_session
from rigctl.engine.rpc.client import FINGER_ENGINE_COMMAND, EngineClient
from rigctl.errors import CheckFailed, WrongUse
from rigctl.finger.config import load_finger_config
from rigctl.finger.latency import KINDS, LIMITS_MS
from rigctl.finger.model_file import load_finger_model
from rigctl.finger.model_files import SPEED_SCALED, model_path
from rigctl.finger.open_rig import SIMULATED
from rigctl.finger.session import FingerSession
from rigctl.finger.status import (
    FingerEngineStatus,
    FingerRunStatus,
    parse_finger_status,
)
from rigctl.finger.values import RUN_FIRST_SLIDE, PredictionRow, ScanKind


def answer_lines(folder: Path) -> Iterator[str]:
    """Yield a sentence on the sets, the unknown plates, the early answers and the latencies."""
    with FingerSession.open(folder) as session:
        rows = session.committed().tolist()
        textures = [str(session.trials["texture"][i]) for i in rows]
        answers = [session.predictions(i) for i in rows]
        latencies = session.latencies
    pairs = [(t, found) for t, found in zip(textures, answers, strict=True) if found]
    if pairs:
        yield _sets_line([(texture, found[-1]) for texture, found in pairs])
        yield _early_line(pairs)
    for kind in KINDS:
        ms = latencies["ms"][latencies["kind"] == kind]
        if len(ms):
            middle, high, longest = np.percentile(ms, [50, 99, 100])
            over = [
                f"; TOO SLOW: {percent:g} % must be within {limit:g} ms"
                for percent, limit in LIMITS_MS.get(kind, ())
                if np.percentile(ms, percent) > limit
            ]
            yield (
                f"from a velocity to {kind}: {middle:.1f} ms, 99 % within {high:.1f} ms, "
                f"longest {longest:.1f} ms, n = {len(ms)}" + "".join(over)
            )


def _sets_line(pairs: list[tuple[str, PredictionRow]]) -> str:
    held = sum(texture in answer.texture_set for texture, answer in pairs)
    sizes = [len(answer.texture_set) for _, answer in pairs]
    unknown = sum(not answer.known for _, answer in pairs)
    known = max(len(answer.probabilities) for _, answer in pairs)
    empty = sum(size == known for size in sizes)
    failed = f"; FAILURE: {empty} hold all textures and say nothing" if empty else ""
    return (
        f"sets of textures: {held} of {len(pairs)} hold the true one, mean size "
        f"{np.mean(sizes):.1f} of {known}{failed}; unlike every trained plate: {unknown}"
    )


def _early_line(pairs: list[tuple[str, tuple[PredictionRow, ...]]]) -> str:
    firsts = [(t, next((a for a in found if a.decided), None)) for t, found in pairs]
    decided = [(texture, answer) for texture, answer in firsts if answer is not None]
    if not decided:
        return "early answers: none, the calibration supports none at the error rate asked for"
    right = sum(texture == answer.texture for texture, answer in decided)
    mm = np.mean([answer.distance_mm for _, answer in decided])
    return (
        f"early answers: {len(decided)} scans, after {mm:.0f} mm on average, {right} of them right"
    )


PERSON_EVENTS = ("stage", "instruction", "trial", "log", "board")
"""Events that a person follows while sliding; a simulation is too fast to be followed."""


def train(args: argparse.Namespace) -> int:
    """Record normalisation and training scans and train the classifiers."""
    from rigctl.finger.models import train_models

    folder, code = _recorded(args, ("normalise", "train"), session=0)
    for path in train_models(folder, args.components, utc_now()):
        print(f"model: {path}")
    return code


def calibrate(args: argparse.Namespace) -> int:
    """Record calibration scans and write the models with the mean of this session."""
    from rigctl.finger.models import calibrate_models

    model = model_path(args.model, SPEED_SCALED)  # either will do: it takes the ranges only
    folder, code = _recorded(args, ("calibrate",), session=1, model=model)
    for path in calibrate_models(args.model, folder):
        print(f"model: {path}")
    return code


def classify(args: argparse.Namespace) -> int:
    """Record scans that the classifier names while the finger moves."""
    model = model_path(args.model, args.representation or SPEED_SCALED)
    _check_representation(model, args.representation)
    first_slide = RUN_FIRST_SLIDE
    folder, code = _recorded(args, ("run",), session=1, model=model, first_slide=first_slide)
    for line in answer_lines(folder):
        print(line)
    return code


def _check_representation(model: Path, wanted: str | None) -> None:
    """Say which representation names the scans. Raises WrongUse where another was asked for."""
    name = load_finger_model(model).representation
    if wanted is not None and ScanKind(name).key != wanted:
        raise WrongUse(
            f"{model} is a model of {name}, not of {wanted}: name the other file, or the folder of "
            "the calibration"
        )
    print(f"the scans are named by {model} ({name})", flush=True)


def demo(args: argparse.Namespace) -> int:
    """Train, calibrate and run with the virtual finger."""
    if args.out.exists():
        raise WrongUse(f"{args.out} exists already: give another folder with --out")
    common = [f"--rig={args.rig}", f"--protocol={args.protocol}", f"--seed={args.seed}", "--yes"]
    steps: tuple[tuple[str, list[str]], ...] = (
        ("train", []),
        ("calibrate", [f"--model={args.out / 'train'}"]),
        ("run", [f"--model={args.out / 'calibrate'}"]),
    )
    for part, options in steps:
        words = [part, *common, f"--out={args.out / part}", *options]
        code = _run_part(words)
        if code:
            return code
    return 0


def _run_part(words: Sequence[str]) -> int:
    from rigctl.cli import main

    print(f"==> rigctl realtime {words[0]}", flush=True)
    return main(["realtime", *words])


def _recorded(
    args: argparse.Namespace,
    stages: Sequence[str],
    *,
    session: int,
    model: Path | None = None,
    first_slide: int = 0,
) -> tuple[Path, int]:
    """Record the stages, unless the session to resume is complete; return folder and exit code."""
    if args.resume is not None:
        print_missing(args.resume)
        _check_resumed(args, stages)
        if _is_complete(args.resume):
            return args.resume, 0
    ended = _record(args, stages, session=session, model=model, first_slide=first_slide)
    return Path(str(ended.session)), _exit_code(ended)


def _check_resumed(args: argparse.Namespace, stages: Sequence[str]) -> None:
    """Raise WrongUse for options that a resumed session has itself, or for another command's."""
    for name in ("out", "protocol"):
        if getattr(args, name) is not None:
            raise WrongUse(f"--{name} is that of the session to resume: leave it out")
    with FingerSession.open(args.resume) as session:
        recorded = session.header.stages
    if tuple(recorded) != tuple(stages):
        raise WrongUse(
            f"{args.resume} has the stages {', '.join(recorded)}: resume it with the command that "
            f"records them, this one records {', '.join(stages)}"
        )


def _is_complete(folder: Path) -> bool:
    """Return whether every planned scan is committed: its model may still have to be made."""
    with FingerSession.open(folder) as session:
        return len(session.committed()) == session.header.trials_planned


def _record(
    args: argparse.Namespace,
    stages: Sequence[str],
    *,
    session: int,
    model: Path | None = None,
    first_slide: int = 0,
) -> FingerRunStatus:
    """Run the stages on an engine of their own and return the run's last status."""
    if str(args.rig).endswith(".toml"):
        ask_own_fields(args, load_finger_config(Path(args.rig)).about.ask)
    options = [word for stage in stages for word in ("--stage", stage)]
    seed = args.seed or 0
    if args.resume is not None:
        options, seed, session, made = _resumed(args.resume)
        first_slide += made
    options += ["--session", str(session if args.session is None else args.session)]
    options += ["--first-slide", str(first_slide)]
    named = {
        "--model": model,
        "--protocol": args.protocol,
        "--out": args.out,
        "--world": args.world,
        "--order-seed": args.seed,
        "--error-rate": getattr(args, "error_rate", None),
        "--coverage": getattr(args, "coverage", None),
    }
    options += [f"{name}={value}" for name, value in named.items() if value is not None]
    options += about_options(args)
    options += ["--yes"] if args.yes else []
    client = EngineClient.start(
        args.rig, paced=args.paced, seed=seed, run=options, command=FINGER_ENGINE_COMMAND
    )
    send_lsl(client, args)
    progress = ProgressLine(sys.stderr)
    told: tuple[str, ...] = TOLD_EVENTS
    if args.paced or args.rig not in SIMULATED:
        told += PERSON_EVENTS
    ended = RunWatcher(client, progress, parse_finger_status, _status_line, told).watch().run
    print(_summary(ended))
    print_session(Path(str(ended.session)))
    if ended.state in EXIT_CODES:
        raise SystemExit(EXIT_CODES[ended.state])
    return ended


def _resumed(folder: Path) -> tuple[list[str], int, int, int]:
    """Return the options of a session to resume, its seed and session, and the slides so far."""
    with FingerSession.open(folder) as session:
        simulation, made = session.header.simulation, session.slides
    seed, number = int(simulation.get("seed", 0)), int(simulation.get("session", 0))
    return [f"--resume={folder}"], seed, number, made


def _exit_code(run: FingerRunStatus) -> int:
    return 0 if run.trials_committed == run.trials_planned else CheckFailed.exit_code


def _status_line(status: FingerEngineStatus, elapsed_wall_s: float) -> str:
    """Return the line for one status; the pace so far turns loop time into wall time."""
    run = status.run
    parts = [f"{run.trials_committed}/{run.trials_planned} scans", run.state]
    if run.scan is not None:
        parts.append(f"{run.scan.stage}: plate {run.scan.texture}, {run.scan.profile}")
    if run.trials_rejected:
        parts.append(f"{run.trials_rejected} rejected")
    if run.classified:
        parts.append(f"{run.correct} of {run.classified} named correctly")
    if run.eta_s is not None and run.elapsed_s > 0:
        parts.append(f"{clock(run.eta_s * elapsed_wall_s / run.elapsed_s)} left")
    return " · ".join(parts)


def _summary(run: FingerRunStatus) -> str:
    lines = [
        f"{run.trials_committed} of {run.trials_planned} scans committed, "
        f"{run.trials_rejected} attempts rejected: {run.text}"
    ]
    if run.classified:
        share = run.correct / run.classified
        lines.append(f"named correctly: {run.correct} of {run.classified} ({share:.1%})")
    return "\n".join(lines)
