"""Stream a running rig over the Lab Streaming Layer.

Join the engine that runs, of the drum or the moving finger, and offer its samples, spikes,
stimulation pulses and events as LSL streams until it ends; LabRecorder and other programs find
them. It only reads: neither the rig nor its record waits for it. Only programs of this computer
see the streams, unless --network is given. Times are those of the samples on this computer's LSL
clock. Exit code 0: the engine has ended.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.cli.arguments import a_path, add_option, path_or_name, whole_number
from rigctl.encoder.reading import FULL_SCALE
from rigctl.engine.live_file import LiveFileReader, TaxelWindow
from rigctl.engine.rpc.client import NO_ENGINE, EngineClient
from rigctl.engine.rpc.engine_files import EngineFile, rig_name, running_engines, runtime_folder
from rigctl.engine.rpc.messages import parse_status
from rigctl.errors import LinkLost, WrongUse
from rigctl.experiments import DRUM_EXPERIMENT, EXPERIMENTS
from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from rigctl.analysis.settings import StimulationSettings

LOOK_S = 0.01
NO_EVENTS = (None, "status")
CLOCKS_DIFFER = 1e-4
"""By what share the clocks of rig and computer may differ, so that an early sample is forgotten."""
MACHINE_ONLY = "[multicast]\nResolveScope = machine\n"
"""With a ListenAddress of this computer, of several streams only the newest would be found."""
MISSING = "LSL needs pylsl: run `pip install 'rigctl[lsl]'`"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    words = "the engine's rig, where several run: virtual, firmware, a rig.toml or a finger.toml"
    add_option(parser, "--rig", path_or_name, help_text=words)
    parser.add_argument(
        "--network", action="store_true", help="let other computers of the network see the streams"
    )
    add_option(parser, "--process", whole_number(1), help_text=argparse.SUPPRESS)
    words = "analysis file (TOML) with the channels and limits of the pulses"
    add_option(parser, "--settings", a_path, "FILE", words)


def run(args: argparse.Namespace) -> int:
    """Stream until the engine ends. Raises WrongUse without an engine or without pylsl."""
    from rigctl.analysis.settings import AnalysisSettings, load_settings

    lsl = load_lsl()
    if not args.network:
        lsl.set_config_content(MACHINE_ONLY)
    settings = AnalysisSettings() if args.settings is None else load_settings(args.settings)
    engine = _only_engine(args.rig, args.process)
    client = EngineClient.join(engine)
    live: LiveFileReader = EXPERIMENTS[engine.experiment].load("live")(Path(engine.live))
    try:
        names = _train_names(client, engine, live)
        is_drum = engine.experiment == DRUM_EXPERIMENT
        scale = parse_status(client.request("status")).full_scale if is_drum else FULL_SCALE
        streams = LiveStreams(lsl, engine.rig, live.n_taxels, names, settings.stimulation, scale)
        print(f"streams of {engine.rig}: {', '.join(streams.names)}", flush=True)
        streams.send(client, live)
    finally:
        live.close()
        client.close()
    return 0


def load_lsl() -> Any:
    """Return pylsl, which reads its settings when it is first used. Raises WrongUse without it."""
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:  # it raises the latter without its library
        raise WrongUse(f"{MISSING} ({str(error).splitlines()[0]})") from None
    return pylsl


def _only_engine(rig: str | None, process: int | None) -> EngineFile:
    """Return the engine that runs, of this rig or process if one is named. Raises WrongUse."""
    engines = running_engines(runtime_folder())
    fitting = [engine for engine in engines if rig is None or engine.rig == rig_name(rig)]
    fitting = [engine for engine in fitting if process in (None, engine.pid)]
    if len(fitting) == 1:
        return fitting[0]
    if not engines:
        raise WrongUse(NO_ENGINE)
    running = ", ".join(engine.rig for engine in engines)
    raise WrongUse(f"name the rig of one running engine with --rig: {running}")


def _train_names(client: EngineClient, engine: EngineFile, live: LiveFileReader) -> list[str]:
    """Return the name of each train, in the order of the live data's columns."""
    if engine.experiment != DRUM_EXPERIMENT:
        return [f"SA-{taxel}" for taxel in range(1, live.n_taxels + 1)]
    named = parse_status(client.request("status")).sensor_layout.train_names()
    return [name for name, _ in sorted(named, key=lambda one: one[1])]


class LiveStreams:
    """Outlets for the samples, spikes, pulses and events of one engine."""

    def __init__(
        self,
        lsl: Any,
        rig: str,
        n_taxels: int,
        trains: Sequence[str],
        settings: StimulationSettings,
        full_scale: int = FULL_SCALE,
    ) -> None:
        from rigctl.analysis.stimulation import PulseTrain

        self._lsl, self._full_scale = lsl, full_scale
        self._counts = np.int16 if full_scale <= np.iinfo(np.int16).max else np.int32
        self._pulses = [PulseTrain(settings) for _ in trains]
        self._offset_s, self._sent_s = np.inf, -np.inf
        self.names = [f"rigctl {rig} {what}" for what in ("taxels", "spikes", "pulses", "events")]
        taxels, spikes, pulses, events = self.names
        of_trains = " ".join(trains)
        labels = [f"taxel {n + 1}" for n in range(n_taxels)]
        self._taxels = self._outlet(taxels, "Tactile", labels, self._counts.__name__, "counts")
        self._spikes = self._outlet(spikes, "Spikes", ["train"], "int16", of_trains)
        labels = ["train", "amplitude in microamperes"]
        self._stimuli = self._outlet(pulses, "Stimulation", labels, "float32", of_trains)
        self._events = self._outlet(events, "Markers", ["event"], "string", "")

    def _outlet(self, name: str, kind: str, channels: list[str], form: str, unit: str) -> Any:
        """Return a new outlet; the samples come at the board's rate, all else when it happens."""
        rate_hz = SAMPLE_RATE_HZ if kind == "Tactile" else self._lsl.IRREGULAR_RATE
        info = self._lsl.StreamInfo(name, kind, len(channels), rate_hz, form, f"{name} source")
        described = info.desc().append_child("channels")
        for label in channels:
            channel = described.append_child("channel")
            channel.append_child_value("label", label)
            channel.append_child_value("unit", unit)
            channel.append_child_value("type", kind)
        return self._lsl.StreamOutlet(info, max_buffered=60)

    def send(self, client: EngineClient, live: LiveFileReader) -> None:
        """Send what comes until the engine ends; it does not go on for these streams alone."""
        seen = live.taxel_head
        with suppress(LinkLost):
            while True:
                events = [one for one in client.wait(LOOK_S) if one.get("event") not in NO_EVENTS]
                self._send_events(events)
                if events and not client.request("clients")["clients"]:
                    client.request("leave")
                block = live.taxels_since(seen)
                if len(block):
                    seen = block.first + len(block)
                    self.send_block(block)

    def send_block(self, block: TaxelWindow) -> None:
        """Send the samples and spikes of a block, and the pulses that the spikes make."""
        times_s = self._lsl_times_s(block.time_s)
        self._taxels.push_chunk(block.samples.astype(self._counts), times_s.tolist())
        rows, trains = block.spikes.nonzero()
        if not len(rows):
            return
        self._spikes.push_chunk(trains.astype(np.int16)[:, None], times_s[rows].tolist())
        for row, train in zip(rows.tolist(), trains.tolist(), strict=True):
            reading = block.samples[row, train % block.samples.shape[1]] / self._full_scale
            at_us = round(block.time_s[row] * 1e6)
            if ua := self._pulses[train].amplitude_ua(at_us, float(reading)):
                self._stimuli.push_sample([float(train), ua], times_s[row])

    def _send_events(self, events: Iterable[dict[str, Any]]) -> None:
        for event in events:
            self._events.push_sample([f"{event['event']}: {event.get('text', '')}"])

    def _lsl_times_s(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the LSL times of samples: the offset of the clocks is that of the least delay."""
        newest_s = self._lsl.local_clock() - time_s[-1]
        passed_s = float(time_s[-1] - time_s[0]) + 1 / SAMPLE_RATE_HZ
        self._offset_s = min(self._offset_s + CLOCKS_DIFFER * passed_s, float(newest_s))
        times_s = np.maximum(time_s + self._offset_s, self._sent_s)
        self._sent_s = float(times_s[-1])
        return times_s
