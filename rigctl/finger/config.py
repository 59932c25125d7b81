"""Read a ``finger.toml``: the ports of a rig of the moving finger."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from rigctl.config.rig_config import About, RecordingConfig, RunConfig, check_recording
from rigctl.config.toml_reader import TomlText, read_section, text
from rigctl.errors import ConfigError


@dataclass(frozen=True, slots=True)
class FingerPort:
    """The finger board and its sensor."""

    port: str = text("", "port of the finger board; empty: search all ports")
    passport: str = text(
        "",
        "sensor.json of `calibrate sensor --reading counts`, beside this file; sessions carry it",
    )


@dataclass(frozen=True, slots=True)
class TrackerConfig:
    """The tracker that measures where the finger is."""

    source: str = text("", "serial:PORT, udp:PORT, imu:PORT, file:PATH or vive[:SERIAL]")
    frame: str = text("", "file with the place of the plate, from `rigctl realtime frame`")


@dataclass(frozen=True, slots=True)
class FingerConfig:
    """A rig of the moving finger; ``text`` is the file's content."""

    about: About = field(default_factory=About)
    finger: FingerPort = field(default_factory=FingerPort)
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    recording: RecordingConfig = field(default_factory=RecordingConfig)
    run: RunConfig = field(default_factory=RunConfig)
    text: str = ""


def load_finger_config(path: Path) -> FingerConfig:
    """Load a ``finger.toml``. Raises ConfigError with file, line and key."""
    content = TomlText.read(path, ConfigError)
    root = content.root
    recording = root.table("recording")
    config = FingerConfig(
        about=read_section(root.table("about"), About),
        finger=read_section(root.table("finger"), FingerPort),
        tracker=read_section(root.table("tracker"), TrackerConfig),
        recording=read_section(recording, RecordingConfig),
        run=read_section(root.table("run"), RunConfig),
        text=content.source,
    )
    root.finish()
    check_recording(config.recording, recording)
    return config
