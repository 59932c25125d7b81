"""Another program's streams: ``sender_of_lsl.py NAME`` sends until its standard input ends.

``NAME samples`` has three channels at 200 Hz, whose first one counts; ``NAME cues`` has a text for
each line of the input.
"""

import sys
import threading

import pylsl

RATE_HZ = 200


def described(
    name: str, kind: str, channels: list[str], rate_hz: float, form: str
) -> pylsl.StreamInfo:
    """Return the description of a stream, with the names of its channels."""
    info = pylsl.StreamInfo(name, kind, len(channels), rate_hz, form, name)
    info.set_channel_labels(channels)
    info.set_channel_units(["mV"] * len(channels))
    return info


name = sys.argv[1]
samples = pylsl.StreamOutlet(
    described(f"{name} samples", "EMG", ["count", "thumb", "wrist"], RATE_HZ, "float32")
)
cues = pylsl.StreamOutlet(described(f"{name} cues", "Markers", ["cue"], 0.0, "string"))
ended = threading.Event()


def read() -> None:
    """Send each line as a cue."""
    for line in sys.stdin:
        cues.push_sample([line.strip()], pylsl.local_clock())
    ended.set()


threading.Thread(target=read, daemon=True).start()
print("sending", flush=True)
count = 0
while not ended.wait(1 / RATE_HZ):
    samples.push_sample([float(count), 0.5 * count, -1.0], pylsl.local_clock())
    count += 1
