"""Opens an NWB file with other people's readers, and prints as JSON what each of them read.

``python readers_of_nwb.py FILE.nwb`` in the environment of ``tests/exchange/readers.txt``.
"""

import hashlib
import json
import sys
from pathlib import Path

import numpy as np
import pynapple
from nwbinspector import inspect_nwbfile
from spikeinterface.extractors.nwbextractors import NwbSortingExtractor, NwbTimeSeriesExtractor


def digest(array):
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def main(path):
    sorting = NwbSortingExtractor(path, sampling_frequency=1000.0, t_start=0.0)
    trains = [sorting.get_unit_spike_train(unit) for unit in sorting.get_unit_ids()]
    taxels = NwbTimeSeriesExtractor(path, timeseries_path="acquisition/taxels")
    found = pynapple.load_file(path)
    units = found["units"]
    ticks = [np.rint(units[unit].t * 1000).astype(np.int64) for unit in units]
    said = {
        "inspector": [
            f"{m.importance.name} {m.check_function_name}" for m in inspect_nwbfile(path)
        ],
        "spikeinterface": {
            "taxels": digest(taxels.get_traces()),
            "spikes": [digest(train.astype(np.int64)) for train in trains],
        },
        "pynapple": {
            "taxels": digest(np.asarray(found["taxels"].values)),
            "spikes": [digest(train) for train in ticks],
            "trials": len(found["trials"]),
        },
    }
    print(json.dumps(said))


if __name__ == "__main__":
    main(str(Path(sys.argv[1])))
