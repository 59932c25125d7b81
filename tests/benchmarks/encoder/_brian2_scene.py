"""Simulate the encoder's neurons in Brian2. Arguments: TARGET INPUT OUTPUT STRICT THREADS.

The Python of the peers runs it. INPUT.npy holds k·x of every neuron, float64 (n_samples,
n_neurons). TARGET is cpp or cython. STRICT 1 switches off fast-math and fused multiply-add, so that
spike times can be equal.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from typing import Any

import numpy as np

EQUATIONS = """
dv/dt = (0.04*v**2 + 5*v + 140 - u + drive(t, i)) / ms : 1
du/dt = 0.02*(0.2*v - u) / ms : 1
"""


def main(target: str, source: str, destination: str, strict: str, threads: str) -> None:
    import brian2 as b

    b.prefs.logging.console_log_level = "ERROR"
    if strict == "1":
        flags = ["-w", "-O3", "-fno-fast-math", "-ffp-contract=off"]
        b.prefs.codegen.cpp.extra_compile_args_gcc = flags
    if int(threads) > 1:
        b.prefs.devices.cpp_standalone.openmp_threads = int(threads)
    if target == "cpp":
        b.set_device("cpp_standalone", directory=tempfile.mkdtemp())
    else:
        b.prefs.codegen.target = "cython"
    drive = np.load(source)
    b.defaultclock.dt = 0.25 * b.ms
    neurons = b.NeuronGroup(
        drive.shape[1],
        EQUATIONS,
        threshold="v >= 30",
        reset="v = -65; u += 6",
        method="euler",
        namespace={"drive": b.TimedArray(drive, dt=1 * b.ms)},
    )
    neurons.v, neurons.u = -70, -14
    spikes = b.SpikeMonitor(neurons)
    seconds = run(b, b.Network(neurons, spikes), target, len(drive))
    steps = np.round(np.asarray(spikes.t / b.ms) * 4).astype(np.int64)
    np.savez(destination, neuron=np.asarray(spikes.i), sample=steps // 4)
    print(json.dumps({"seconds": seconds, "spikes": len(steps), "brian2": b.__version__}))


def run(b: Any, network: Any, target: str, n_samples: int) -> float:
    """Return the seconds of the simulation, without code generation and compilation."""
    if target == "cpp":
        network.run(n_samples * b.ms)
        return float(b.device._last_run_time)
    network.store()
    network.run(1 * b.ms)
    network.restore()
    start = time.perf_counter()
    network.run(n_samples * b.ms)
    return time.perf_counter() - start


if __name__ == "__main__":
    main(*sys.argv[1:])
