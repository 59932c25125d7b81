"""The options of an analysis, declared once: command line and window make theirs from here."""

from __future__ import annotations

from dataclasses import Field, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.analysis.further_analyses import OFFERED as ALSO
from rigctl.analysis.further_tasks import OFFERED
from rigctl.encoder.parameters import PRESETS, override, preset
from rigctl.errors import WrongUse
from rigctl.protocol.plan import MAX_SEED

if TYPE_CHECKING:
    from rigctl.analysis.settings import AnalysisSettings
    from rigctl.analysis.spike_counts import RangesOver
    from rigctl.analysis.tasks import SweepSettings
    from rigctl.analysis.training import ModelRequest
    from rigctl.encoder.normalisation import Normalisation
    from rigctl.encoder.parameters import EncoderParameters

DRUM, FINGER = "drum", "realtime"
"""Experiments whose sessions are analysed."""
MAX_NUMBER = 1_000_000_000
"""Of trials, taxels, components: what they choose from is smaller."""
MAX_DRAWS = 100_000
ENCODER, MODEL = "the encoder", "a model for rigctl classify"
TASKS = (("", "All that fit the sessions"), *OFFERED)
REPRESENTATIONS = (
    ("", "None"),
    ("original", "Original"),
    ("speed", "Speed Scaled"),
    ("force", "Force Scaled"),
    ("speed_force", "Speed and Force Scaled"),
    ("force_blind", "Force Scaled, texture-blind"),
    ("speed_force_blind", "Speed and Force Scaled, texture-blind"),
    ("divided", "Divided"),
    ("speed_divided", "Speed Scaled and Divided"),
    ("calibrated", "Calibrated"),
    ("speed_calibrated", "Speed Scaled and Calibrated"),
    ("loadcell", "Load Cell"),
    ("speed_loadcell", "Speed Scaled and Load Cell"),
)


def option(
    default: Any,
    doc: str,
    metavar: str = "",
    *,
    low: float = 0,
    high: float = MAX_NUMBER,
    choices: tuple[str, ...] = (),
    group: str = "",
    drum: bool = True,
    **window: Any,
) -> Any:
    """Declare an option; its annotation says what it holds, and a tuple may be repeated.

    ``doc``: its help on the command line; ``group``: the options that it stands among there;
    ``drum``: whether it has a meaning for the drum alone. ``window``: its ``title`` there, with
    ``hint`` for the tooltip, ``usual`` for what stands in the field at first, and ``offered`` for
    the values to choose from and what people read for them.
    """
    shown = {"title": "", "hint": "", "usual": None, "offered": (), **window}
    limits = {"low": low, "high": high, "choices": choices}
    parser = {"doc": doc, "metavar": metavar, "group": group, "drum": drum}
    return field(default=default, metadata={**parser, **limits, **shown})


@dataclass(frozen=True)
class EncoderOptions:
    """How readings become spikes: options of ``rigctl encode`` and ``rigctl analyse``."""

    sessions: tuple[Path, ...] = ()
    preset: str = option(
        "default", "encoder preset", "NAME", group=ENCODER, title="Encoder",
        offered=tuple((name, name) for name in PRESETS),
    )  # fmt: skip
    set: tuple[str, ...] = option(
        (), "change a parameter of the preset, such as sa_gain=120; may be repeated",
        "NAME=VALUE", group=ENCODER,
    )  # fmt: skip
    reading: str = option(
        "counts",
        "what the encoder takes of a taxel: its counts (default, as in the paper), or the "
        "conductance without the load of the other taxels of its input",
        choices=("counts", "conductance"), group=ENCODER, drum=False,
    )  # fmt: skip
    ranges: Path | str = option(
        "all",
        "measure the taxel ranges in all trials (default) or only in those at the paper's "
        "training speeds and forces, or take them from a spikes.h5 or model file; ranges over all "
        "trials know the untrained force: --also ranges shows both",
        "all|training|FILE", group=ENCODER,
    )  # fmt: skip
    reference_force: float | None = option(
        None, "force to which the SA rates of the other forces are scaled (500), or a depth in mm "
        "(the middle one)", "G", low=0.001,
        high=100_000, group=ENCODER, title="Reference force",
        hint="Force to which the SA rates of the other forces are scaled; of depths, one in mm",
        usual=500.0,
    )  # fmt: skip

    settings: Path | None = option(
        None,
        "analysis file (TOML) with conditions, groups, shares, windows and thresholds that "
        "differ from the paper's; every report of rigctl analyse holds one, analysis.toml",
        "FILE", drum=False, title="Constants",
        hint="Analysis file with other conditions, groups, shares, windows and reference force",
        usual="the paper's",
    )  # fmt: skip

    @property
    def parameters(self) -> EncoderParameters:
        """The encoder's parameters. Raises WrongUse for a preset or parameter that is not there."""
        base = preset(self.preset)
        if self.reading != base.reading:
            base = override(base, [f"reading={self.reading}"])
        return override(base, self.set) if self.set else base

    @cached_property
    def analysis(self) -> AnalysisSettings:
        """The constants of the analysis file, or the paper's; options come before both.

        Raises ConfigError.
        """
        from rigctl.analysis.settings import AnalysisSettings, load_settings

        settings = AnalysisSettings() if self.settings is None else load_settings(self.settings)
        if self.reference_force is None:
            return settings
        return settings.with_reference_force(self.reference_force)

    @property
    def taxel_ranges(self) -> RangesOver | Normalisation:
        """The chosen taxel ranges.

        Raises SessionError for a file without ranges, or with another order of taxels.
        """
        from rigctl.analysis.spike_counts import RangesOver
        from rigctl.analysis.trial_set import check_file_wiring
        from rigctl.session.analysis_file import load_ranges

        if self.ranges in list(RangesOver):
            return RangesOver(self.ranges)
        ranges = load_ranges(Path(self.ranges))
        check_file_wiring(Path(self.ranges), self.sessions)
        return ranges


@dataclass(frozen=True)
class AnalysisOptions(EncoderOptions):
    """The options of ``rigctl analyse``; the window has those with a title."""

    out: Path = Path()
    experiment: str = option(
        DRUM,
        "realtime: sessions of the moving finger, training sessions and new ones in pairs, for "
        "Figures 4B, 4C and S5 (default: drum)",
        choices=(DRUM, FINGER), drum=False,
    )  # fmt: skip
    iterations: int | None = option(
        None, "random draws (20; realtime: 100 of each data set)", "N", low=1, high=MAX_DRAWS,
        drum=False, title="Draws", hint="Number of random splits into training and test trials",
        usual=20,
    )  # fmt: skip
    k_max: int | None = option(
        None, "principal components, at most (50)", "K", low=1, title="Components",
        hint="Largest number of principal components", usual=50,
    )  # fmt: skip
    engine: str = option(
        "own",
        "own: one decomposition per fold; sklearn: a pipeline per number of components, which "
        "is slower and gives the same results",
        choices=("own", "sklearn"),
        offered=(("own", "rigctl's own (fast)"), ("sklearn", "scikit-learn (slow)")), drum=False,
        title="Engine",
    )  # fmt: skip
    task: tuple[str, ...] = option(
        (),
        "textures, groups, extrapolation, leave-speed-out, leave-force-out or leave-mount-out; "
        "may be repeated (default: all that fit the sessions)",
        "TASK", title="Tasks", offered=TASKS,
    )  # fmt: skip
    seed: int = option(
        0, "seed of the draws (0)", "SEED", high=MAX_SEED, drum=False, title="Seed",
        hint="Seed of the draws",
    )  # fmt: skip
    c: Path | None = option(
        None, "take C from a model or spikes.h5 instead of a search, and measure its rate error",
        "FILE", title="C from",
        hint="Model file that C is taken from; the analysis measures its rate error",
        usual="found by a search",
    )  # fmt: skip
    passport: Path | None = option(
        None, "sensor.json of rigctl calibrate sensor, for Calibrated representations of sessions "
        "that do not carry one", "FILE", title="Sensor",
        hint="sensor.json of a calibration, in the place of those that the sessions carry",
        usual="of the sessions",
    )  # fmt: skip
    sensitivity: bool = option(
        False, "add a table of all encoder presets, with 10 components and the same draws",
        title="Compare all encoder presets",
    )  # fmt: skip
    also: tuple[str, ...] = option(
        (), f"a further analysis: {', '.join(name for name, _ in ALSO[1:])}; may be repeated",
        "NAME", title="Also measure", offered=ALSO,
        hint="An analysis beside the tasks, on the same trials and draws",
    )  # fmt: skip
    trial: int | None = option(None, "trial in the figure of one taxel", metavar="ID")
    taxel: int | None = option(None, "taxel in that figure, from 1", metavar="N", low=1)
    start: float = option(
        0.0, "time in the trial at which that figure begins (0); it shows a second", "S", high=3600,
    )  # fmt: skip
    save_model: Path | None = option(
        None, "save a model trained on all trials", "FILE", group=MODEL,
    )  # fmt: skip
    representation: str | None = option(
        None, 'such as "Original" (default: "Speed Scaled")', "NAME", group=MODEL,
        title="Save model", hint="Representation of a model that is trained on all trials",
        offered=REPRESENTATIONS,
    )  # fmt: skip
    components: int | None = option(
        None, "principal components (50)", "K", low=1, group=MODEL,
    )  # fmt: skip

    @property
    def sweep(self) -> SweepSettings:
        """The draws of the drum's report, and its tasks. Raises ConfigError."""
        from rigctl.analysis.pca_lda import SweepEngine
        from rigctl.analysis.tasks import SweepSettings

        draws = self.analysis.draws
        iterations = draws.count if self.iterations is None else self.iterations
        k_max = draws.components if self.k_max is None else self.k_max
        return SweepSettings(iterations, k_max, self.seed, SweepEngine(self.engine), self.task)

    @property
    def model(self) -> ModelRequest | None:
        """The requested model, if any. Raises WrongUse for its options without a file."""
        from rigctl.analysis.training import ModelRequest

        options = ("representation", "components")
        given = {name: value for name in options if (value := getattr(self, name)) is not None}
        if self.save_model is not None:
            return ModelRequest(self.save_model, **given)
        if given:
            raise WrongUse(
                f"--{next(iter(given))} belongs to a model: name its file with --save-model"
            )
        return None


def declared(kind: type[EncoderOptions]) -> dict[str, Field[Any]]:
    """Return the declared options by name, in the order of the command line."""
    return {one.name: one for one in fields(kind) if one.metadata}
