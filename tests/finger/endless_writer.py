"""Record scans of the finger until the process is killed, and print the attempts on disk.

The first sitting commits each trial of the plan once; all other attempts are rejected.

``python -m tests.session.endless_finger_writer FOLDER [resume]``
"""

from __future__ import annotations

import sys
from itertools import count
from pathlib import Path

from rigctl.values import Verdict
from tests.finger.finger_building import SyntheticFinger, plan, recorder


def main() -> None:
    trials = plan().trials
    resume = "resume" in sys.argv
    with recorder(Path(sys.argv[1]), resume=resume) as rec:
        rec.begin_part("start")
        with SyntheticFinger(rec) as finger:
            for number in count():
                first = number < len(trials) and not resume
                verdict = Verdict.COMMITTED if first else Verdict.REJECTED
                finger.trial(trials[number % len(trials)], verdict, 1 + number // len(trials))
                rec.wait_written()
                print(f"trials {number + 1}", flush=True)


if __name__ == "__main__":
    main()
