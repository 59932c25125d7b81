"""Record until the process is killed or the disk is full, and print the trials on disk.

``python -m tests.session.endless_writer FOLDER [resume] [limit=BYTES]``
"""

from __future__ import annotations

import resource
import sys
from itertools import count
from pathlib import Path

from rigctl.errors import RigctlError
from rigctl.session.recorder import Recorder
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan


def main() -> int:
    folder, options = Path(sys.argv[1]), sys.argv[2:]
    for option in options:
        if option.startswith("limit="):
            resource.setrlimit(resource.RLIMIT_FSIZE, (int(option[6:]), resource.RLIM_INFINITY))
    try:
        with Recorder(folder, header(), PROTOCOL, RIG, resume="resume" in options) as rec:
            record(rec)
    except RigctlError as error:
        print(f"error {error}", flush=True)
        return error.exit_code
    return 0


def record(rec: Recorder) -> None:
    trials = plan().trials
    rec.begin_part("start", "A")
    bench = SyntheticRig(rec)
    for number in count():
        bench.trial(trials[number % len(trials)])
        if number % 3 == 0:
            rec.wait_written()
            print(f"trials {number + 1}", flush=True)
        if number == 20:
            rec.begin_part("plate change", "B")


if __name__ == "__main__":
    sys.exit(main())
