"""A request to run stages of the finger's protocol, and the session that is opened for it."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from rigctl.config.resources import find_finger_protocol
from rigctl.config.text_file import refuse_link_outside
from rigctl.encoder.force_gain import ForceScaling
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT
from rigctl.engine.rpc.commands import PathText, Seed, Word
from rigctl.engine.run_request import (
    SaidOfSession,
    check_disk_space,
    check_same_rig,
    chosen_folder,
    session_header,
)
from rigctl.errors import SessionError, WrongUse
from rigctl.finger.analysis.classifier import COVERAGE, ERROR_RATE, FingerClassifier
from rigctl.finger.board_messages import N_TAXELS
from rigctl.finger.model_file import FingerModel, load_finger_model
from rigctl.finger.plan import FingerPlan, load_finger_protocol
from rigctl.finger.recorder import FingerRecorder
from rigctl.finger.rig import FingerRig
from rigctl.finger.session import FingerSession
from rigctl.finger.values import MODEL_KIND, ScanKind, Stage
from rigctl.session import layout
from rigctl.session.header import SessionHeader
from rigctl.session.recorder import keep_private
from rigctl.session.sensor_layout import SensorLayout
from rigctl.session.sensor_passport import SensorPassport, gain_source
from rigctl.values import BoardIdentity, Verdict

DEFAULT_PROTOCOL = "paper"
"""Kind of the event that says which model names the scans of a session."""
Share = Annotated[float, Meta(gt=0, lt=1)]


class FingerRunRequest(SaidOfSession, frozen=True, forbid_unknown_fields=True):
    """Stages of a protocol to record into a new folder, or a session to resume.

    ``stages``: names. ``model``: a file, needed by the stages calibrate and run. ``out`` and
    ``resume`` are folders; ``yes`` answers every question on a simulated rig. ``error_rate``: share
    of wrong ones among the early answers, ``coverage``: share of texture sets that hold the true
    one; both as the session's calibration supports them.
    """

    stages: Annotated[tuple[Word, ...], Meta(max_length=8)] = ()
    protocol: PathText = DEFAULT_PROTOCOL
    model: PathText | None = None
    out: PathText | None = None
    resume: PathText | None = None
    seed: Seed | None = None
    yes: bool = False
    error_rate: Share = ERROR_RATE
    coverage: Share = COVERAGE

    def __post_init__(self) -> None:
        if bool(self.stages) == (self.resume is not None):
            raise WrongUse("give stages to record or a session to resume, not both")
        known = [stage.value for stage in Stage]
        for stage in self.stages:
            if stage not in known:
                raise WrongUse(f"there is no stage {stage}: the stages are {', '.join(known)}")

    def about_session(self, rig: FingerRig) -> dict[str, Any]:
        """Return what the session says of itself: what the rig's file says, unless told here."""
        about = rig.config.about
        return {"operator": about.operator, "sensor": about.sensor, **self.about}


@dataclass(frozen=True, slots=True)
class OpenedFingerRun:
    """A plan, the recorder of its session, its classifier, and the results of earlier sittings.

    ``header``: that of the first part; later parts have other ranges. ``done``: trials committed
    before; ``attempts``: number of previous attempts at each trial; ``scans``: the highest number
    of a scan so far. ``ranges``: those of the training scans committed before, which the others
    must have, too; None without one. ``named``: texture and answer of each scan classified
    before. ``coverage``: that of the request. ``missing``: a sentence for each part that cannot be
    read and for scans that are left out: they are made again.
    """

    plan: FingerPlan
    recorder: FingerRecorder
    header: SessionHeader
    classifier: FingerClassifier | None
    unattended: bool
    resumed: bool = False
    done: frozenset[int] = frozenset()
    attempts: Mapping[int, int] = field(default_factory=dict)
    scans: int = 0
    ranges: Normalisation | None = None
    named: tuple[tuple[str, str], ...] = ()
    coverage: float = COVERAGE
    model_digest: str = ""
    rejected: int = 0
    missing: tuple[str, ...] = ()

    @property
    def reference_um_per_s(self) -> int:
        """Reference speed of scaled time."""
        return round(1000 * self.plan.protocol.reference_mm_s)


def open_finger_run(
    request: FingerRunRequest, rig: FingerRig, board: BoardIdentity, start_utc: str
) -> OpenedFingerRun:
    """Read protocol and model, check the disk and lock the folder.

    Raises ProtocolError, SessionError, WrongUse or DiskFault before anything is recorded.
    """
    unattended = request.yes and rig.simulated
    if request.resume is not None:
        return _resume(Path(request.resume), request, rig, board, start_utc)
    protocol = load_finger_protocol(find_finger_protocol(request.protocol))
    rig.check_plates(protocol.textures)
    plan = protocol.plan([Stage(name) for name in request.stages], request.seed)
    about = request.about_session(rig)
    classifier = _classifier(plan, request, about["sensor"], rig.passport)
    folder = chosen_folder(request.out, start_utc, f"finger-{request.stages[-1]}")
    check_disk_space(folder, plan.bytes_estimate)
    header = _header(plan, rig, board, start_utc, classifier, about)
    recorder = _open_recorder(folder, header, protocol.text, rig, resume=False)
    return OpenedFingerRun(
        plan,
        recorder,
        header,
        classifier,
        unattended,
        coverage=request.coverage,
        model_digest=model_digest(request.model),
    )


def _open_recorder(
    folder: Path, header: SessionHeader, protocol: str, rig: FingerRig, resume: bool
) -> FingerRecorder:
    if rig.config.recording.private:
        keep_private(folder)
    return FingerRecorder(folder, header, protocol, rig.config.text, resume=resume)


def _resume(
    folder: Path, request: FingerRunRequest, rig: FingerRig, board: BoardIdentity, start_utc: str
) -> OpenedFingerRun:
    with FingerSession.open(folder) as session:
        header, attempts = session.header, Counter(session.trials["trial_id"].tolist())
        done = frozenset(session.trials["trial_id"][session.committed()].tolist())
        missing = tuple(session.describe_missing())
        scans = int(session.trials["scan"].max(initial=0))
        ranges = _ranges_of_scans(session)
        named = _named_scans(session)
        models = session.events_of(MODEL_KIND)
        rejected = int(np.sum(session.trials["verdict"] == Verdict.REJECTED.value))
    about = request.about_session(rig)
    _check_rig(folder, header, rig, about["sensor"])
    refuse_link_outside(folder / layout.PROTOCOL_FILE)
    protocol = load_finger_protocol(folder / layout.PROTOCOL_FILE)
    plan = protocol.plan([Stage(name) for name in header.stages], header.seed)
    if len(done) == len(plan.trials):
        raise SessionError(f"{folder} is complete: every planned scan is committed")
    classifier = _classifier(plan, request, about["sensor"], rig.passport)
    if classifier and ranges and not ranges.has_ranges_of(classifier.model.normalisation):
        raise WrongUse(
            f"{folder} was begun with another model than {request.model}: its taxel ranges differ"
        )
    digest = model_digest(request.model)
    if models and models[-1].data["digest"] != digest:
        raise WrongUse(
            f"{folder} was begun with another model than {request.model}: resume it with the "
            f"{models[-1].data['representation']} model that named its scans"
        )
    remaining = 1 - len(done) / len(plan.trials)
    check_disk_space(folder, round(remaining * plan.bytes_estimate))
    new = _header(plan, rig, board, start_utc, classifier, about)
    recorder = _open_recorder(folder, new, protocol.text, rig, resume=True)
    unattended = request.yes and rig.simulated
    return OpenedFingerRun(
        plan,
        recorder,
        new,
        classifier,
        unattended,
        resumed=True,
        done=done,
        attempts=attempts,
        scans=scans,
        ranges=ranges,
        named=named,
        coverage=request.coverage,
        model_digest=digest,
        rejected=rejected,
        missing=missing,
    )


def model_digest(path: str | None) -> str:
    """Return the SHA-256 of a model's file, hexadecimal; empty without a model."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest() if path else ""


def _check_rig(folder: Path, header: SessionHeader, rig: FingerRig, sensor: str) -> None:
    """Raise SessionError where another rig, sensor or simulated world began the session."""
    check_same_rig(folder, header, rig.kind, rig.world)
    if header.sensor != sensor:
        raise SessionError(
            f"{folder} was recorded with the sensor {header.sensor!r}, this rig has {sensor!r}: "
            "resume it with its own (name it as at the start), or start a new session"
        )


def _ranges_of_scans(session: FingerSession) -> Normalisation | None:
    """Return the ranges of the scans committed after normalisation, None without one."""
    stages = session.trials["stage"]
    rows = [i for i in session.committed() if stages[i] != Stage.NORMALISE.value]
    return session.normalisation(rows[0]) if rows else None


def _named_scans(session: FingerSession) -> tuple[tuple[str, str], ...]:
    """Return texture and answer of the committed scans that have one."""
    rows = session.trials[session.committed()]
    pairs = zip(rows["texture"].tolist(), rows["predicted"].tolist(), strict=True)
    return tuple((str(texture), str(answer)) for texture, answer in pairs if answer)


def _classifier(
    plan: FingerPlan, request: FingerRunRequest, sensor: str, passport: SensorPassport | None
) -> FingerClassifier | None:
    """Return the classifier that the plan's stages need. Raises WrongUse for an unfit model."""
    stages = {trial.stage for trial in plan.trials}
    if not stages & {Stage.CALIBRATE, Stage.RUN}:
        if Stage.NORMALISE not in stages:
            raise WrongUse("training needs the ranges of the taxels: plan the stage normalise too")
        return None
    path = request.model
    if path is None:
        raise WrongUse("these stages use a trained model: name its file with --model")
    model = load_finger_model(Path(path))
    _check_model(model, plan, path, sensor)
    if stages >= {Stage.CALIBRATE, Stage.RUN}:
        raise WrongUse(
            "calibrate and run need a session each: the run uses the model that its session's "
            "`rigctl realtime calibrate` has made"
        )
    if Stage.RUN in stages and model.calibration is None:
        raise WrongUse(
            f"{path} is not calibrated for this session: run `rigctl realtime calibrate` first"
        )
    scaling = ScanKind(model.representation).force_scaling
    gain_source(scaling, passport, model.parameters.reading)
    return FingerClassifier(model, coverage=request.coverage, error_rate=request.error_rate)


def _check_model(model: FingerModel, plan: FingerPlan, path: str, sensor: str) -> None:
    if model.sensor != sensor:
        raise WrongUse(
            f"{path} was trained with the sensor {model.sensor!r}, this rig has {sensor!r}: train "
            "a model for it, or correct the sensor's name (about.sensor, or as given at the start)"
        )
    reference = round(1000 * plan.protocol.reference_mm_s)
    if model.reference_um_per_s != reference:
        raise WrongUse(
            f"{path} was trained at a reference speed of {model.reference_um_per_s / 1000:g} mm/s, "
            f"the protocol has {reference / 1000:g} mm/s: use its own protocol"
        )
    if model.parameters != DEFAULT:
        raise WrongUse(f"{path} has other neurons than the finger board: train it on its spikes")
    if model.n_taxels != N_TAXELS:
        raise WrongUse(f"{path} is for {model.n_taxels} taxels, the finger has {N_TAXELS}")
    missing = set(plan.protocol.textures) - set(model.textures)
    if missing:
        raise WrongUse(
            f"{path} does not know the plate {min(missing)}: it was trained on "
            f"{', '.join(model.textures)}"
        )


def _header(
    plan: FingerPlan,
    rig: FingerRig,
    board: BoardIdentity,
    start_utc: str,
    classifier: FingerClassifier | None,
    about: Mapping[str, Any],
) -> SessionHeader:
    ranges = classifier.model.normalisation if classifier is not None else None
    stages = dict.fromkeys(trial.stage.value for trial in plan.trials)
    scaling = ForceScaling.NONE
    if classifier is not None and Stage.RUN.value in stages:
        scaling = ScanKind(classifier.model.representation).force_scaling
    return session_header(
        plan,
        rig=rig.kind,
        simulated=rig.simulated,
        start_utc=start_utc,
        start_loop_s=rig.loop.time(),
        boards=(board,),
        **about,
        encoder_preset=DEFAULT.name,
        encoder_scaling=scaling,
        n_taxels=N_TAXELS,
        sensor_layout=SensorLayout.default(N_TAXELS),
        taxel_low=tuple(ranges.low.tolist()) if ranges else (),
        taxel_high=tuple(ranges.high.tolist()) if ranges else (),
        simulation={"seed": rig.seed, **rig.world} if rig.simulated else {},
        reference_um_per_s=round(1000 * plan.protocol.reference_mm_s),
        stages=tuple(stages),
        tracker={"name": rig.tracker.name, "frame": rig.frame.to_toml()},
        passport=rig.passport.to_values() if rig.passport else {},
        plugins=(rig.plugin.used(),) if rig.plugin else (),
    )
