"""Texts that people write: protocols, rigs, worlds, analysis files, maps, calibrations, tracks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rigctl.analysis.settings import (
    AnalysisSettings,
    differences_from_paper,
    load_settings,
    to_toml,
)
from rigctl.bench.world_file import NOMINAL_WORLD, format_world, load_world
from rigctl.cli.check import describe, table
from rigctl.config.resources import finger_protocols, protocols
from rigctl.config.rig_config import RigConfig, load_config
from rigctl.config.toml_edit import set_keys
from rigctl.exchange.column_map import load_map
from rigctl.exchange.labels import parse_label
from rigctl.finger.cli.check import describe_finger, finger_table
from rigctl.finger.config import load_finger_config
from rigctl.finger.open_rig import open_finger_rig
from rigctl.finger.plan import load_finger_protocol
from rigctl.finger.trackers.open_tracker import read_track
from rigctl.finger.trackers.plate_frame import PlateFrame
from rigctl.finger.values import Stage
from rigctl.protocol.loader import load_protocol
from tests.fuzz.kind import Kind, Place
from tests.fuzz.mutations.bytes import BYTES
from tests.fuzz.mutations.texts import TEXT

MAP = r"""name = "theirs"
[sensor]
name = "skin 2"
rows = 1
columns = 3
layers = ["top"]
[files]
pattern = '(?P<texture>[a-z]+)_(?P<speed>-?\d+)cm_(?P<force>[\d.]+)N_(?P<repeat>\d+)'
delimiter = ","
[time]
column = "t"
unit = "ms"
[taxels]
columns = ["a..c"]
unit = "mV"
low = 0
high = 4000
[labels]
speed_unit = "cm/s"
force_unit = "kPa"
area_mm2 = 100
mount_column = "m"
[trials]
column = "run"
[textures]
felt = "felt 2"
[quality]
max_gap_s = 0.5
outlier_sigma = 12
"""
FINGER_RIG = """[about]
name = "bench 2"
operator = "Jörg"
[finger]
port = "/dev/ttyACM7"
[tracker]
source = "udp:7000"
frame = "frame.toml"
"""
TRACK = "time_ms,x,y,z,valid\n" + "".join(f"{8 * n},{n / 2},1.5,-2e1,1\n" for n in range(50))
STEPS = """
[[steps]]
at = "every"
trials = 3
kind = "rest"
seconds = 2
[[steps]]
at = "start"
kind = "message"
text = "begin"
wait = true
"""


def built_in(folder: Callable[[], Path], name: str, more: str = "") -> Callable[[Path], None]:
    """Return a builder that copies a protocol of the program."""

    def build(case: Path) -> None:
        (case / "file.toml").write_text((folder() / name).read_text() + more)

    return build


def text(content: Callable[[], str], name: str = "file.toml") -> Callable[[Path], None]:
    """Return a builder that writes a text."""

    def build(case: Path) -> None:
        (case / name).write_text(content(), encoding="utf-8")

    return build


def check_protocol(folder: Path) -> object:
    """Plan a protocol of the drum and describe it, as ``rigctl check`` does."""
    return table(describe(load_protocol(folder / "file.toml").plan(None)))


def read_analysis_file(folder: Path) -> object:
    """Read an analysis file, name what is not the paper's, and write it again."""
    settings = load_settings(folder / "file.toml")
    return differences_from_paper(settings), to_toml(settings)


def check_finger_protocol(folder: Path) -> object:
    """Plan a protocol of the finger and describe it."""
    plan = load_finger_protocol(folder / "file.toml").plan(list(Stage), None)
    return finger_table(describe_finger(plan))


def read_rig(folder: Path) -> object:
    """Load a rig, write it again, and set a key of it as a calibration does."""
    path = folder / "file.toml"
    written = load_config(path).with_order().to_toml()
    return written, set_keys(path.read_text(encoding="utf-8"), "loadcell", {"tare_counts": 5})


def read_finger_rig(folder: Path) -> object:
    """Load a rig of the finger."""
    return load_finger_config(folder / "file.toml")


def read_world(folder: Path) -> object:
    """Load a simulated bench and its rig."""
    world = load_world(folder / "file.toml")
    return world.rig_config(), world.header_fields(), format_world(world.parameters)


def read_map(folder: Path) -> object:
    """Load a map and read the label of a file name with it."""
    mapping = load_map(folder / "file.toml")
    name = Path("felt_-12cm_" + "0" * 39 + "1.5N_3.csv")
    return parse_label(name, mapping.labels, {}, str(name))


def read_frame(folder: Path) -> object:
    """Load the place of a plate as a real rig of the finger does, which then finds no board."""
    rig = open_finger_rig(str(folder / "file.toml"))
    rig.close()
    return rig.frame


def read_recorded_track(folder: Path) -> object:
    """Read a recorded track."""
    return read_track(folder / "track.csv")


def build_frame(folder: Path) -> None:
    """Write a rig of the finger and its plate frame."""
    (folder / "file.toml").write_text(FINGER_RIG, encoding="utf-8")
    (folder / "frame.toml").write_text(PlateFrame().to_toml(), encoding="utf-8")


TOML = (Place("file.toml", TEXT),)
TEXT_KINDS = (
    Kind(
        "protocol", built_in(protocols, "paper.toml", STEPS), TOML, (check_protocol,), guided=True
    ),
    Kind(
        "finger-protocol",
        built_in(finger_protocols, "paper.toml"),
        TOML,
        (check_finger_protocol,),
        guided=True,
    ),
    Kind("rig", text(RigConfig().to_toml), TOML, (read_rig,), guided=True),
    Kind(
        "analysis-file",
        text(lambda: to_toml(AnalysisSettings())),
        TOML,
        (read_analysis_file,),
        guided=True,
    ),
    Kind("finger-rig", text(lambda: FINGER_RIG), TOML, (read_finger_rig,), guided=True),
    Kind(
        "world",
        text(lambda: format_world(NOMINAL_WORLD.parameters)),
        TOML,
        (read_world,),
        guided=True,
    ),
    Kind("import-map", text(lambda: MAP), TOML, (read_map,), guided=True),
    Kind("calibration", build_frame, (Place("frame.toml", TEXT),), (read_frame,), guided=True),
    Kind(
        "track",
        text(lambda: TRACK, "track.csv"),
        (Place("track.csv", (*TEXT, *BYTES)),),
        (read_recorded_track,),
        guided=True,
    ),
)
